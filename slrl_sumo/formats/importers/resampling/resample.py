"""From positions at the times of a recording to Trajectories of 0.4 s."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_smoothing_spline

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.resampling.gaps import GAP_PERIODS, check_waits, periods, split_notes
from slrl_sumo.formats.importers.resampling.headings import against_motion, checked_headings
from slrl_sumo.formats.importers.resampling.motion import heading_from_motion
from slrl_sumo.formats.importers.resampling.speeds import speed_notes
from slrl_sumo.formats.trajectories import Integers, Trajectories, track_names
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.types import DECISION_INTERVAL, MAX_POSITION, TYPE_NAMES, RoadUserType

TOP_SPEED = np.array([70.0, 17.0, 9.0])
"""Speed (m/s) by type above which a motion between two rows is a jump, at which the track is split."""

MOST_S, MOST_M = 1e10, MAX_POSITION
"""Highest time and position. Times may count from 1970."""

JUMP = 0.5
"""m; tolerance of a position in addition."""

PARKED_WITHIN = 1.0
"""m. A car or bicycle that never leaves a box of this size …"""

PARKED_FOR = 5.0
"""… though it is there for this many seconds, is parked."""

SMOOTHING = 0.004
"""s⁴, for marks in images. Motion of a period of 2 pi SMOOTHING^(1/4) = 1.6 s and less counts as noise. This moves
positions by 3 cm (root mean square) in HC and 6 cm in SDD; accelerations and yaw rates become plausible."""


@dataclass(frozen=True, eq=False)
class Samples:
    """N rows of U road users as a recording has them, in any order. Metres, seconds, radians; x east, y north."""

    file: str
    """For messages."""
    source: str
    """Data set and name of the recording."""
    user: Integers
    """Index of the road user, (N,)."""
    time: Floats
    x: Floats
    y: Floats
    heading: Floats
    """Headings, (N,); NaN for road users with headings from their motion."""
    period: float
    """s between two rows; of a road user with longer ones, its own counts (see `gaps.periods`)."""
    ids: tuple[str, ...]
    """(U,)"""
    type: NDArray[np.int8]
    """RoadUserType, (U,)."""
    length: Floats
    width: Floats
    still: Floats
    """Heading of road users without recorded headings that never move, (U,)."""
    smoothing: float = 0.0
    """s⁴ (see SMOOTHING) where positions are raw marks in images or of a tracker; headings then follow from motion.
    0 where the source is smoothed."""
    licence: str = ""
    notes: tuple[str, ...] = ()
    """What the importer has corrected or left out so far."""


def resample(samples: Samples) -> Trajectories:
    """Trajectories of 0.4 s from the first sample on, by interpolation between neighbouring rows of a road user.

    Road users of unknown class (type below 0) are left out, of two rows of a road user at one time the later one in
    the file counts. At gaps and jumps a road user continues in a new track (`id#1`); pieces between two frames are
    dropped. There is a gap where 1.5 periods of the road user pass without a row. Positions with `smoothing` are
    smoothed (penalised spline), others interpolated linearly. The notes tell what was corrected, split or left out, and
    where speeds are unusual. Raises InputError where positions, times or headings make no sense in metres, seconds and
    radians, or a road user is in two places again and again.
    """
    order, twice_note = _ordered(samples)
    user, time = samples.user[order], samples.time[order]
    x, y, heading = samples.x[order], samples.y[order], samples.heading[order]
    wait, step = np.diff(time), np.hypot(np.diff(x), np.diff(y))
    same = np.diff(user) == 0
    between = np.flatnonzero(same)
    period = periods(user[between], wait[between], samples.type, samples.period)
    close = same & (wait < GAP_PERIODS * period[user[:-1]])
    jump = close & (step > TOP_SPEED[samples.type[user[:-1]]] * wait + JUMP)
    check_waits(samples.file, samples.type[user[between]], wait[between], close[between], samples.period)
    _check_units(samples, user, time, x, y, close, jump)
    _, firsts = np.unique(user, return_index=True)
    still = samples.still.copy()
    still[user[firsts]] = np.where(np.isnan(heading[firsts]), still[user[firsts]], heading[firsts])
    if samples.smoothing:
        heading_notes = against_motion(user, x, y, heading, close & ~jump)
        heading = np.full(len(user), np.nan)
    else:
        heading, heading_notes = checked_headings(samples.file, user, time, x, y, heading, close & ~jump)

    # Runs without a gap, [start, end), and the frames within each.
    t0 = float(time.min())
    start = np.r_[0, np.flatnonzero(~close | jump) + 1]
    run_of_row = np.repeat(np.arange(len(start)), np.diff(np.r_[start, len(user)]))
    end = np.r_[start[1:], len(user)]
    first = np.ceil((time[start] - t0) / DECISION_INTERVAL - 1e-6).astype(np.int64)
    last = np.floor((time[end - 1] - t0) / DECISION_INTERVAL + 1e-6).astype(np.int64)
    kept = first <= last
    notes = (*samples.notes, *twice_note, *heading_notes, *split_notes(user[start], kept))
    start, end, first, count = start[kept], end[kept], first[kept], (last - first + 1)[kept]
    track = np.repeat(np.arange(len(start)), count)
    frame = np.arange(len(track)) - np.repeat(np.cumsum(count) - count, count) + first[track]
    when = np.clip(t0 + frame * DECISION_INTERVAL, time[start][track], time[end - 1][track])

    # Row before each frame, within its run, and how far the frame is from there to the next one.
    wide = float(time.max()) - t0 + 1.0  # runs one after another make one rising axis
    run = run_of_row[start][track]
    before = np.searchsorted(run_of_row * wide + (time - t0), run * wide + (when - t0), side="right") - 1
    before = np.clip(before, start[track], end[track] - 1)
    after = np.minimum(before + 1, end[track] - 1)
    share = np.where(after > before, (when - time[before]) / np.where(after > before, time[after] - time[before], 1), 0)
    new_x, new_y = x[before] + share * (x[after] - x[before]), y[before] + share * (y[after] - y[before])
    if samples.smoothing:
        _smooth(new_x, new_y, when, track, x, y, time, start, end, samples.smoothing / period[user[start]])

    users = user[start]
    given = ~np.isnan(heading[before])
    new_heading = heading_from_motion(new_x, new_y, track, samples.type[users], DECISION_INTERVAL, still[users])
    turned = wrap_angle(heading[before] + share * wrap_angle(heading[after] - heading[before]))
    tracks = Trajectories(
        track=track,
        frame=frame,
        x=new_x,
        y=new_y,
        heading=np.where(given, turned, new_heading),
        ids=track_names(samples.ids[u] for u in users.tolist()),
        type=samples.type[users],
        length=samples.length[users],
        width=samples.width[users],
        t0=t0,
        source=samples.source,
        licence=samples.licence,
        parked=_parked(samples)[users],
        notes=notes,
    )
    return replace(tracks, notes=(*speed_notes(tracks), *notes))


def _ordered(samples: Samples) -> tuple[Integers, tuple[str, ...]]:
    """The rows of known road users, by road user and time, one each, and a note on those that are dropped.

    Trackers write two rows of one time where they lose and find a road user: in TAF-BW 104 of 12,079, with positions
    0.6 m apart on average. The later one is that from which the source goes on.
    """
    for name, values, most in (("time", samples.time, MOST_S), ("x", samples.x, MOST_M), ("y", samples.y, MOST_M)):
        if not (within := np.abs(values) <= most).all():
            row = int(np.flatnonzero(~within)[0])
            raise InputError(
                f"{samples.file}: {name} of {samples.ids[samples.user[row]]!r} is {values[row]:g}; possible is {most:g}"
            )
    order = np.lexsort((samples.time, samples.user))
    order = order[samples.type[samples.user[order]] >= 0]
    user, time = samples.user[order], samples.time[order]
    twice = (np.diff(user) == 0) & (np.diff(time) < 1e-6)
    apart = twice & (np.hypot(np.diff(samples.x[order]), np.diff(samples.y[order])) > 0.01)
    if apart.sum() > 0.1 * len(order):
        row = int(np.flatnonzero(apart)[0])
        raise InputError(
            f"{samples.file}: {samples.ids[user[row]]!r} is twice at {time[row]:g} s, as in {int(apart.sum())} of "
            f"{len(order)} rows; check that every road user has an id of its own"
        )
    number = int(twice.sum())
    note = (f"{number} of {len(order)} rows twice for one road user and time, the first of each two dropped",)
    return order[~np.r_[twice, False]], note if number else ()


def _smooth(
    new_x: Floats,
    new_y: Floats,
    when: Floats,
    track: Integers,
    x: Floats,
    y: Floats,
    time: Floats,
    start: Integers,
    end: Integers,
    smoothing: Floats,
) -> None:
    """Put smoothed positions in place of interpolated ones, run by run; runs of less than 5 rows stay as they are."""
    frames = np.searchsorted(track, np.arange(len(start) + 1))
    for run, (s, e) in enumerate(zip(start.tolist(), end.tolist(), strict=True)):
        if e - s < 5:
            continue
        at = slice(frames[run], frames[run + 1])
        t = time[s:e] - time[s]
        for new, old in ((new_x, x), (new_y, y)):
            new[at] = make_smoothing_spline(t, old[s:e], lam=smoothing[run])(when[at] - time[s])


def _check_units(
    samples: Samples,
    user: Integers,
    time: Floats,
    x: Floats,
    y: Floats,
    close: NDArray[np.bool_],
    jump: NDArray[np.bool_],
) -> None:
    if jump.sum() > 0.05 * close.sum():
        row = int(np.flatnonzero(jump)[0])
        raise InputError(
            f"{samples.file}: {samples.ids[user[row]]!r} ({TYPE_NAMES[samples.type[user[row]]]}) and others move "
            f"{np.hypot(x[row + 1] - x[row], y[row + 1] - y[row]):.3g} m within {time[row + 1] - time[row]:.3g} s; "
            "check that positions are in metres and times or frame rate are right"
        )


def _parked(samples: Samples) -> NDArray[np.bool_]:
    """Whether each road user is parked, (U,)."""
    low, high = np.full((3, len(samples.ids)), np.inf), np.full((3, len(samples.ids)), -np.inf)
    for i, values in enumerate((samples.x, samples.y, samples.time)):
        np.minimum.at(low[i], samples.user, values)
        np.maximum.at(high[i], samples.user, values)
    wide, deep, there = high - low
    small = np.maximum(wide, deep) < PARKED_WITHIN
    parked: NDArray[np.bool_] = small & (there >= PARKED_FOR) & (samples.type != RoadUserType.PEDESTRIAN)
    return parked
