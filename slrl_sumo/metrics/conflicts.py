"""Conflicts: encounters of road users that came close to a crash, found in trajectories."""

from dataclasses import dataclass, fields
from itertools import product

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.metrics.encounters import ENCOUNTER_PAUSE, TTC_LIMIT, touching_soon
from slrl_sumo.metrics.neighbours import Rows, row_pairs
from slrl_sumo.metrics.surrogate_safety import REAR_END, crossing_angle
from slrl_sumo.scene.geometry import Floats, boxes_overlap, wrap_angle
from slrl_sumo.scene.levels import FLAT, Levels, together
from slrl_sumo.scene.types import RoadUserType

PET_LIMIT = 1.0
"""Post-encroachment time (s) below which an encounter is a conflict."""
PET_STEP = 0.1
"""Time (s) between compared positions, which are interpolated."""


@dataclass(frozen=True, eq=False)
class Conflicts:
    """k encounters in the order of their tracks, each at the time of its smallest value."""

    a: Integers
    """Index of the first track, (k,)."""
    b: Integers
    """Index of the second track, greater than `a`, (k,)."""
    time: Floats
    """Time of the smallest value, s, (k,); for PET the arrival of the second road user."""
    x: Floats
    """Midway between the two centres then, m, (k,)."""
    y: Floats
    value: Floats
    """TTC or PET, s, (k,)."""
    closing: Floats
    """Relative speed then, m/s, (k,): SSAM's DeltaS. With `value` of a TTC conflict it gives the DRAC."""
    angle: Floats
    """Angle between the headings then, rad, in [0, pi], (k,)."""

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: NDArray[np.intp]) -> "Conflicts":
        """The encounters `rows`."""
        return Conflicts(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    def with_vehicles(self, trajectories: Trajectories) -> "Conflicts":
        """Encounters except those of two pedestrians, which pass each other within 1.5 s in everyday traffic."""
        kinds = trajectories.type
        walking = (kinds[self.a] == RoadUserType.PEDESTRIAN) & (kinds[self.b] == RoadUserType.PEDESTRIAN)
        return self.take(np.flatnonzero(~walking))


def velocities(trajectories: Trajectories) -> Floats:
    """Displacement of the last interval over dt, m/s, (R, 2); the first row of a track has the value of the second."""
    xy = np.column_stack([trajectories.x, trajectories.y])
    velocity = np.diff(xy, axis=0, prepend=xy[:1]) / trajectories.dt
    first = trajectories.starts[:-1]
    velocity[first] = 0.0
    longer = first[np.diff(trajectories.starts) > 1]
    velocity[longer] = velocity[longer + 1]
    return velocity


def boxes(trajectories: Trajectories) -> Floats:
    """The boxes of all rows, (R, 5): x, y (m), heading (rad), length, width (m)."""
    track = trajectories.track
    sizes = (trajectories.length[track], trajectories.width[track])
    return np.column_stack([trajectories.x, trajectories.y, trajectories.heading, *sizes])


def ttc_conflicts(trajectories: Trajectories, *, below: float = TTC_LIMIT, levels: Levels = FLAT) -> Conflicts:
    """Encounters with a time to collision (see `surrogate_safety.time_to_collision`) below `below` s, at any angle.

    Each encounter counts once, with its smallest value; 0 is an overlap. A pair that overlaps from the first common
    time on has not collided by driving: such an encounter is left out, as are those on different `levels`.
    """
    box, velocity = boxes(trajectories), velocities(trajectories)
    i, j, value = pairs_about_to_touch(box=box, velocity=velocity, frame=trajectories.frame, below=below, levels=levels)
    track_i, track_j = trajectories.track[i], trajectories.track[j]
    moments = Conflicts(
        a=np.minimum(track_i, track_j),
        b=np.maximum(track_i, track_j),
        time=np.asarray(trajectories.t0 + trajectories.frame[i] * trajectories.dt, np.float64),
        x=0.5 * (box[i, 0] + box[j, 0]),
        y=0.5 * (box[i, 1] + box[j, 1]),
        value=value,
        closing=np.hypot(*(velocity[i] - velocity[j]).T),
        angle=crossing_angle(box[i, 2], box[j, 2]),
    )
    return _encounters(moments, trajectories)


def pairs_about_to_touch(
    *, box: Floats, velocity: Floats, frame: Integers, below: float = TTC_LIMIT, levels: Levels = FLAT
) -> tuple[Rows, Rows, Floats]:
    """Pairs of rows of a frame with a time to collision below `below` s: their indices and this time (s), (k,) each.

    `box`: (R, 5), see `boxes`; `velocity`: m/s, (R, 2); `frame`: (R,), in any order. 0 s is an overlap. Pairs on
    different `levels` do not count.
    """
    reach = 0.5 * np.hypot(box[:, 3], box[:, 4]) + below * np.hypot(velocity[:, 0], velocity[:, 1])
    no_rows = np.zeros(0, np.intp)
    found: list[tuple[Rows, Rows, Floats]] = [(no_rows, no_rows, np.zeros(0))]
    for i, j in row_pairs(x=box[:, 0], y=box[:, 1], frame=frame, reach=reach):
        found.append(touching_soon(box=box, velocity=velocity, i=i, j=j, below=below, levels=levels))
    i, j, value = (np.concatenate(column) for column in zip(*found, strict=True))
    return i, j, value


def new_encounters(a: Integers, b: Integers, time: Floats) -> NDArray[np.bool_]:
    """Whether each of k moments, sorted by pair (a, b) and time (s), begins a new encounter of its pair, (k,)."""
    new = np.ones(len(a), np.bool_)
    new[1:] = (np.diff(a) != 0) | (np.diff(b) != 0) | (np.diff(time) > ENCOUNTER_PAUSE + 1e-9)
    return new


def pet_conflicts(trajectories: Trajectories, *, below: float = PET_LIMIT, levels: Levels = FLAT) -> Conflicts:
    """Encounters with a post-encroachment time (see `surrogate_safety.post_encroachment_time`) below `below` s.

    Only angles of 30° and more count: for a follower, this time is always its headway. Each encounter counts once; 0 is
    an overlap; encounters that begin with an overlap, or are on different `levels`, are left out. Positions are
    interpolated to 0.1 s, so that values are up to 0.2 s too long.
    """
    t, dt = trajectories, trajectories.dt
    box = boxes(t)
    # Row r represents the interval from row r to the next row of its track.
    begin = np.flatnonzero(np.diff(t.track) == 0)
    move = box[begin + 1, :2] - box[begin, :2]
    turn = wrap_angle(box[begin + 1, 2] - box[begin, 2])
    velocity = move / dt
    middle = box[begin, :2] + 0.5 * move
    reach = 0.5 * np.hypot(box[begin, 3], box[begin, 4]) + 0.5 * np.hypot(move[:, 0], move[:, 1])
    parts = max(1, round(dt / PET_STEP))
    shares = np.arange(parts + 1) / parts
    found = [_PlaceConflicts.none()]
    for lag in range(int(np.ceil(below / dt)) + 1):
        for i, j in row_pairs(x=middle[:, 0], y=middle[:, 1], frame=t.frame[begin], reach=reach, lag=lag):
            other = t.track[begin[i]] != t.track[begin[j]]
            at_begin = crossing_angle(box[begin[i], 2], box[begin[j], 2])
            at_end = crossing_angle(box[begin[i] + 1, 2], box[begin[j] + 1, 2])
            kept = other & (np.maximum(at_begin, at_end) >= REAR_END)
            i, j = i[kept], j[kept]
            for share_i, share_j in product(shares, shares):
                apart = (lag + share_j - share_i) * dt
                if abs(apart) > below - 1e-9:
                    continue
                at_i = _moved(box[begin[i]], move[i], turn[i], share_i)
                at_j = _moved(box[begin[j]], move[j], turn[j], share_j)
                angle = crossing_angle(at_i[:, 2], at_j[:, 2])
                here = np.flatnonzero((angle >= REAR_END) & boxes_overlap(at_i, at_j))
                if len(levels.x):
                    here = here[together(levels, at_i[here, :3], at_j[here, :3])]
                arrival = t.frame[begin[i[here]]] * dt + max(share_i, lag + share_j) * dt
                place = 0.5 * (at_i[here, :2] + at_j[here, :2])
                value = np.full(len(here), 0.0 if abs(apart) < 1e-9 else abs(apart))
                found.append(_PlaceConflicts(i[here], j[here], value, arrival, place, angle[here]))
    met = _PlaceConflicts(*(np.concatenate([getattr(part, f.name) for part in found]) for f in fields(_PlaceConflicts)))
    a, b = t.track[begin[met.i]], t.track[begin[met.j]]
    moments = Conflicts(
        a=np.minimum(a, b),
        b=np.maximum(a, b),
        time=t.t0 + met.arrival,
        x=met.place[:, 0],
        y=met.place[:, 1],
        value=met.apart,
        closing=np.hypot(*(velocity[met.i] - velocity[met.j]).T),
        angle=met.angle,
    )
    return _encounters(moments, t)


@dataclass(frozen=True, eq=False)
class _PlaceConflicts:
    """Places that two road users occupy within a short time: intervals, times (s), place (m) and angle (rad)."""

    i: Rows
    j: Rows
    apart: Floats
    arrival: Floats
    place: Floats
    angle: Floats

    @staticmethod
    def none() -> "_PlaceConflicts":
        no_rows, empty = np.zeros(0, np.intp), np.zeros(0)
        return _PlaceConflicts(no_rows, no_rows, empty, empty, np.zeros((0, 2)), empty)


def _moved(box: Floats, move: Floats, turn: Floats, share: float) -> Floats:
    """Boxes (n, 5) after a share of their interval."""
    at = box.copy()
    at[:, :2] += share * move
    at[:, 2] += share * turn
    return at


def _encounters(moments: Conflicts, t: Trajectories) -> Conflicts:
    """The moment with the smallest value of each encounter; the first of several equal moments."""
    m = moments.take(np.lexsort((moments.time, moments.b, moments.a)))
    if not len(m):
        return m
    fresh = new_encounters(m.a, m.b, m.time)
    group = np.cumsum(fresh) - 1
    together = t.t0 + t.dt * np.maximum(t.frame[t.starts[m.a]], t.frame[t.starts[m.b]])
    from_the_start = (m.value == 0.0) & (m.time <= together + 1e-9)
    innocent = np.logical_or.reduceat(from_the_start, np.flatnonzero(fresh))
    order = np.lexsort((m.time, m.value, group))
    best = order[np.flatnonzero(np.diff(group[order], prepend=-1))]
    return m.take(best[~innocent])
