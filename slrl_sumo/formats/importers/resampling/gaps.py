"""Gaps in the rows of road users: greatest time to the next row, and notes on split tracks."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES

GAP_PERIODS = 1.5
"""Periods without a row from which there is a gap."""

LONGEST_PERIOD = 5.0
"""Periods of the recording that the period of one road user may have: cameras and scanners have rates from 2 to 10 Hz
and 5 to 25 Hz side by side. Beyond that the times are wrong, or it is seen now and then."""

FEWEST_WAITS = 5
"""Least number of waits from which the period of a road user, or else of its type, is estimated."""

MANY = 20
"""Waits of a type from which they are judged."""


def periods(user: Integers, wait: Floats, kind: NDArray[np.int8], period: float) -> Floats:
    """s between two rows of each road user, (U,): the median of its waits where that is longer than `period`.

    `user` and `wait` (W,) are the road users and s of all waits from row to row; `kind`: RoadUserType, (U,); `period`:
    s, of the recording. Road users with few waits have the period of their type. Where a median is above LONGEST_PERIOD
    periods, or 1 s, it is that of the recording.
    """
    of_type = np.array([_median(wait[kind[user] == k]) for k in range(len(TYPE_NAMES))])
    own = np.where(kind >= 0, of_type[kind], period)
    order = np.lexsort((wait, user))
    count = np.bincount(user, minlength=len(kind))
    first = np.cumsum(count) - count
    many = np.flatnonzero(count >= FEWEST_WAITS)
    own[many] = wait[order[first[many] + (count[many] - 1) // 2]]
    possible = own <= max(min(LONGEST_PERIOD * period, 1.0), period)
    return np.where(possible, np.maximum(own, period), period)


def _median(values: Floats) -> float:
    """The lower one of the two in the middle; 0 of none."""
    return float(np.sort(values)[(len(values) - 1) // 2]) if len(values) else 0.0


def check_waits(file: str, kind: NDArray[np.int8], wait: Floats, close: NDArray[np.bool_], period: float) -> None:
    """Raise InputError where most rows of a type follow the one before, of the same road user, after a gap.

    `kind`, `wait` (s) and `close`, (W,), are those of waits from row to row; `close`: there is no gap.
    """
    for k, name in enumerate(TYPE_NAMES):
        those = kind == k
        number = int(those.sum())
        if close[those].sum() < 0.5 * number and (number >= MANY or number == len(wait)):
            raise InputError(
                f"{file}: rows of a {name} follow each other every {np.median(wait[those]):.3g} s (median) instead of "
                f"{period:.3g} s; check that times or frame rate are right"
            )


def split_notes(user: Integers, kept: NDArray[np.bool_]) -> tuple[str, ...]:
    """A note, if any, on road users that gaps and jumps split, and on pieces that hold no whole interval.

    `user` and `kept`, (P,), are those of all pieces; pieces that are not kept lie between two moments of 0.4 s.
    """
    present, count = np.unique(user, return_counts=True)
    split, short = int((count > 1).sum()), int((~kept).sum())
    gone = len(present) - len(np.unique(user[kept]))
    texts = []
    if split:
        texts.append(f"{split} of {len(present)} road users split at gaps or jumps")
    if short:
        texts.append(
            f"{short} piece{'s' * (short > 1)} shorter than 0.4 s left out"
            + (f" ({gone} road user{'s' * (gone > 1)} altogether)" if gone else "")
        )
    return ("; ".join(texts),) if texts else ()
