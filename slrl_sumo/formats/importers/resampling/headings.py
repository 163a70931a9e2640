"""Check of recorded headings against motion: reversed headings are turned, other wrong headings replaced."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.scene.geometry import Floats, wrap_angle

JUDGED_SPEED = 2.0
"""Speed (m/s) above which the direction between two rows is the direction of motion."""

JUDGED_DISTANCE = 5.0
"""Least distance (m) above this speed for the check of a road user."""

OFF = 0.5
"""Angle (rad) between heading and motion above which the heading is wrong. Body slip of road traffic is below 0.2."""

ALL, FEW = 0.9, 0.1
"""Share of the distance in which a heading is reversed where it is turned as a whole, and in which it may be wrong."""


def checked_headings(
    file: str, user: Integers, time: Floats, x: Floats, y: Floats, heading: Floats, joined: NDArray[np.bool_]
) -> tuple[Floats, tuple[str, ...]]:
    """Headings (N,) of road users, rad, NaN where they must follow from the motion, and notes on what was changed.

    Rows (N,) are sorted by road user and time; `joined` (N - 1,) tells which rows the next one continues. Reversing is
    slow and short; a road user with a heading against its motion over nearly all of its way at more than JUDGED_SPEED
    has it reversed, and it is turned. Headings that differ from the motion otherwise, and those that are not given in
    every row, are NaN. Raises InputError where that is so for most road users: then the column is of another unit or
    sense.
    """
    users = int(user.max(initial=-1)) + 1
    step = np.hypot(np.diff(x), np.diff(y))
    fast = np.flatnonzero(joined & ~np.isnan(heading[:-1]) & (step > JUDGED_SPEED * np.diff(time)))
    off = np.abs(wrap_angle(np.arctan2(np.diff(y)[fast], np.diff(x)[fast]) - heading[fast]))
    way, wrong, against = (
        np.bincount(user[fast], step[fast] * part, minlength=users)
        for part in (np.ones(len(fast)), off > OFF, off > np.pi - OFF)
    )
    judged = way > JUDGED_DISTANCE
    turned = judged & (against > ALL * way)
    replaced = judged & ~turned & (wrong > FEW * way)
    if replaced.sum() > 0.5 * judged.sum():
        median = float(np.median(off[replaced[user[fast]]]))
        raise InputError(
            f"{file}: headings and motion differ by {np.degrees(median):.0f} degrees (median over moving "
            "road users); check unit and direction of the heading column"
        )
    partly = np.bincount(user[np.isnan(heading)], minlength=users) > 0
    notes = [
        f"{number} of {len(np.unique(user))} road users: {text}"
        for number, text in (
            (int(turned.sum()), "headings against the motion, turned"),
            (int(replaced.sum()), "headings that differ from the motion, replaced by those of the motion"),
        )
        if number
    ]
    heading = wrap_angle(heading + np.where(turned[user], np.pi, 0.0))
    return np.where((replaced | partly)[user], np.nan, heading), tuple(notes)


def against_motion(user: Integers, x: Floats, y: Floats, heading: Floats, joined: NDArray[np.bool_]) -> tuple[str, ...]:
    """A note on headings of noisy positions, which are not used: how many road users' are against most of their motion.

    Arguments as of `checked_headings`.
    """
    step = np.hypot(np.diff(x), np.diff(y))
    given = np.flatnonzero(joined & ~np.isnan(heading[:-1]))
    along = step[given] * np.cos(np.arctan2(np.diff(y)[given], np.diff(x)[given]) - heading[given])
    users = int(user.max(initial=-1)) + 1
    way, forwards = (np.bincount(user[given], part, minlength=users) for part in (step[given], along))
    number = int(((way > JUDGED_DISTANCE) & (forwards < 0)).sum())
    text = (
        f"{number} of {len(np.unique(user))} road users: headings against the motion, replaced by those of the motion"
    )
    return (text,) if number else ()
