"""Lateral positions of bicycles on paths that they share with pedestrians: they pass slower persons where there is
room."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.perception.leaders import SIDE_GAP
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.scene.route import AHEAD, HERE, POINTS, SPACING, RouteAhead, on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN, RoadUserType

EDGE = 0.1
"""Distance (m) that bicycles keep from the edges of a lane."""
SPARE = 0.1
"""Lateral clearance (m) from persons that bicycles seek, beyond that from which a person is no leader."""
FORESEEN = 6.0
"""Time (s) ahead in which persons in the way count."""
MIDDLE, STAY = 0.5, 0.2
"""Time (s) that a bicycle gives up for 1 m nearer to the middle of the lane, and for 1 m less of lateral motion."""
SIDEWAYS, STEEPEST = 0.8, 0.3
"""Greatest lateral speed (m/s), and greatest lateral motion (m per m ahead)."""
ALONG = 0.5
"""Cosine of the angle between a person's heading and a path above which the person walks along the path, or, if
negative, against it. Bicycles give way to persons that cross."""


class SharedPath(NamedTuple):
    """A bicycle on a path for pedestrians and bicycles, or one that has just left such a path."""

    row: int
    """Row of the bicycle in the world."""
    track: VehicleTrack
    room: float
    """Greatest lateral position (m), to the left and to the right of the middle; 0 after the path."""


def lateral_room(lane_width: float, width: float) -> float:
    """Greatest lateral position (m) of a vehicle of a `width` (m) on a lane of `lane_width` (m)."""
    return max(0.5 * (lane_width - width) - EDGE, 0.0)


def pass_persons(route: RouteAhead, world: WorldState, shared_paths: Sequence[SharedPath]) -> None:
    """Shift the paths of bicycles in `route` to lateral positions at which they pass persons, and update their tracks.

    The road users of `route` are the first ones of `world`. Bicycles that followed persons instead rode at 2.0 m/s on a
    path of 3 m with 180 persons an hour in each direction, where SUMO's ride at 5.4 m/s.
    """
    persons = np.flatnonzero(world.type == PEDESTRIAN) if shared_paths else np.zeros(0, np.intp)
    for row, track, room in shared_paths:
        now, speed = track.lateral_position, world.speed.item(row)
        wanted = _lateral_position(route, world, row, now, room, persons)
        slope = min(SIDEWAYS / max(speed, 1e-6), STEEPEST)
        if now or wanted:
            _shift(route, row, now, wanted, slope)
        step = slope * speed * track.history.elapsed
        track.lateral_position += min(max(wanted - now, -step), step)


def _lateral_position(
    route: RouteAhead, world: WorldState, row: int, now: float, room: float, persons: NDArray[np.intp]
) -> float:
    """The lateral position (m to the left) that is free of persons for longest, if the bicycle in `row` moves there.

    `now`: its present lateral position. With equal times, it is near the middle and near the present one.
    """
    if not room:
        return 0.0
    distance = np.hypot(world.x[persons] - world.x[row], world.y[persons] - world.y[row])
    near = persons[distance < AHEAD / SPACING * route.spacing[row]]
    if not len(near):
        return 0.0
    rows = np.full(len(near), row)
    along, offset, direction = (v[:, 0] for v in on_path(route, world.x[near, None], world.y[near, None], rows))
    turned = world.heading[near] - direction
    same = np.cos(turned)
    closing = np.maximum(route.desired_speed[row] - world.speed[near] * same, 1e-6)
    reach = 0.5 * (world.length[row] + world.length[near])
    # Times at which the bicycle gets beside each person and leaves it behind.
    begin, end = np.maximum(along - reach, 0.0) / closing, (along + reach) / closing
    counts = (end > 0.0) & (np.abs(same) > ALONG) & (begin < FORESEEN)
    begin, end, offset = begin[counts], np.minimum(end[counts], FORESEEN), offset[counts]
    drift = (world.speed[near] * np.sin(turned))[counts]
    need = 0.5 * (world.width[row] + world.width[near][counts]) + SIDE_GAP[RoadUserType.BICYCLE]
    places = np.concatenate([[0.0, min(max(now, -room), room)], offset - need - SPARE, offset + need + SPARE])
    places = places[np.abs(places) <= room]
    moved = places[:, None] - now
    first, last = (
        now + np.clip(moved, -SIDEWAYS * time, SIDEWAYS * time) - offset - drift * time for time in (begin, end)
    )
    blocked = (np.minimum(np.abs(first), np.abs(last)) < need) | (first * last < 0.0)
    free = np.where(blocked, begin, FORESEEN).min(axis=1, initial=FORESEEN)
    # Only a free position pays to be near the middle: else a bicycle beside a person would turn towards it.
    off_middle = np.where(free < FORESEEN, 0.0, MIDDLE * np.abs(places))
    return float(places[np.argmax(free - off_middle - STAY * np.abs(moved[:, 0]))])


def _shift(route: RouteAhead, row: int, now: float, wanted: float, slope: float) -> None:
    """Shift the path in `row` to the left by `now` (m) here, and by `wanted` (m) ahead, with `slope` (m/m) between."""
    x, y = route.x[row], route.y[row]
    dx, dy = np.gradient(x), np.gradient(y)
    length = np.maximum(np.hypot(dx, dy), 1e-6)
    most = slope * route.spacing[row] * np.maximum(np.arange(POINTS) - HERE, 0)
    left = now + np.clip(wanted - now, -most, most)
    x -= left * dy / length
    y += left * dx / length
