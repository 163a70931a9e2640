"""Wraparound: road users that leave the scene return on its other side (paper, section 3.4)."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.geometry import Floats, to_ego, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN
from slrl_sumo.simulation.placement.insertion import boxes_of, insertions, safe_speed
from slrl_sumo.simulation.placement.spawn import starting_speed
from slrl_sumo.sumo.network.lanes import LanePoints

ENTRY_CANDIDATES = (24, 384)
"""Numbers of entry places that are tried for each returning road user; the second if the first places are occupied."""

ENTRY_ROOM = np.array([4.7, 2.3, 1.0])
"""Gap (m) between the circles around two boxes that a returning road user needs, by type."""

NO_EXITS = np.zeros((0, 4))

BEYOND, ASIDE = 12.0, 1.5
"""Distance (m) past a lane's end, and beside it, within which a road user off every surface has left at this end."""

ENTRANCE = np.array([15.0, 8.0, 2.0])
"""Distance (m) from the begin of a lane within which road users do not return, by type: SUMO's vehicles depart there,
and SUMO does not see a road user that returns in the same step."""


def left_scene(world: WorldState, roadmap: RoadMap, exits: Floats = NO_EXITS, *, rim: float = 0.0) -> NDArray[np.bool_]:
    """Whether each road user has left the scene, (n,).

    It is then more than `rim` m outside the network's bounding box, about 10 m away from every surface, or past the end
    of a lane at one of the `exits` (see Network.exits).
    """
    x0, y0, x1, y1 = roadmap.bounds
    inside = (world.x >= x0 - rim) & (world.x <= x1 + rim) & (world.y >= y0 - rim) & (world.y <= y1 + rim)
    gone = ~(inside & roadmap.near_surface(world.x, world.y))
    if len(exits):
        off = np.flatnonzero(roadmap.surface_at(world.x, world.y) == Surface.NONE)
        x, y, heading, half = exits.T
        ahead, aside = to_ego(world.x[off, None] - x, world.y[off, None] - y, heading)
        gone[off] |= ((ahead >= 0.0) & (ahead <= BEYOND) & (np.abs(aside) <= half + ASIDE)).any(axis=1)
    return gone


def reinsert(
    world: WorldState, gone: NDArray[np.bool_], others: WorldState, points: tuple[LanePoints, ...], roadmap: RoadMap
) -> WorldState:
    """`world` with the road users `gone` (n,) moved to the other side of the scene.

    The scene is a torus as in the paper: the position is shifted back along the heading by the extent of the scene,
    then moved to the nearest legal place of the type that leads into the same half-plane and is free of the road users
    of `world` and `others`; if no place is free, to the place with the widest gap. The speed is limited by the lane,
    and by the safe speeds behind the leader and before the junction; places with lower safe speeds come last.
    """
    x, y, heading, speed = world.x.copy(), world.y.copy(), world.heading.copy(), world.speed.copy()
    x0, y0, x1, y1 = roadmap.bounds
    crowd = boxes_of(world, others)
    for row in np.flatnonzero(gone).tolist():
        kind = int(world.type[row])
        source = points[kind]
        c, s = np.cos(heading[row]), np.sin(heading[row])
        extent = min((x1 - x0) / max(abs(c), 1e-6), (y1 - y0) / max(abs(s), 1e-6))
        wrapped_x = np.clip(x[row] - extent * c, x0, x1)
        wrapped_y = np.clip(y[row] - extent * s, y0, y1)
        for count in ENTRY_CANDIDATES:
            rows = source.nearest(np.array([wrapped_x]), np.array([wrapped_y]), count)[0]
            turn = np.abs(wrap_angle(source.heading[rows] - heading[row]))
            if kind == PEDESTRIAN:
                turn = np.minimum(turn, np.pi - turn)
            wish = np.minimum(speed[row], source.max_speed(rows))
            gap, slowest, fastest = insertions(source.x[rows], source.y[rows], source.heading[rows], crowd, row)
            if kind != PEDESTRIAN:
                fastest = np.minimum(fastest, safe_speed(source.rest_of_lane(rows)))
            free = (gap >= ENTRY_ROOM[kind]) & (source.offset[rows] >= ENTRANCE[kind])
            free &= slowest <= np.minimum(wish, fastest)
            away = np.hypot(source.x[rows] - wrapped_x, source.y[rows] - wrapped_y)
            # Use places on the other side only: near the place where the road user has left, it would leave again.
            near = away > np.hypot(source.x[rows] - x[row], source.y[rows] - y[row])
            free &= ~near
            if (free & (fastest >= wish) & (turn <= 0.5 * np.pi)).any():
                break
        # Priorities: the other side; room to stop, else the widest gap; the same direction; its speed; the distance to
        # the shifted point.
        crowded = np.where(free, -np.inf, -gap)
        order = np.lexsort((away, np.maximum(wish - fastest, 0.0), turn > 0.5 * np.pi, crowded, near))
        best = rows[order[0]]
        x[row], y[row] = source.x[best], source.y[best]
        direction = source.heading[best]
        if kind == PEDESTRIAN and abs(wrap_angle(direction - heading[row])) > 0.5 * np.pi:
            direction += np.pi
        heading[row] = wrap_angle(direction)
        speed[row] = min(wish[order[0]], fastest[order[0]])
        crowd[row, :4] = x[row], y[row], heading[row], speed[row]
    return replace(world, x=x, y=y, heading=heading, speed=speed)


def start_anew(
    world: WorldState,
    rows: NDArray[np.intp],
    others: WorldState,
    points: tuple[LanePoints, ...],
    max_speed: Floats,
    rng: np.random.Generator,
) -> WorldState:
    """`world` with its road users `rows` at newly drawn places, with room to stop, and with speeds as at the start.

    `max_speed`: by type, m/s, (3,). If no drawn place is free, the place with the widest gap is taken.
    """
    x, y, heading, speed = world.x.copy(), world.y.copy(), world.heading.copy(), world.speed.copy()
    acceleration, yaw_rate = world.acceleration.copy(), world.yaw_rate.copy()
    crowd = boxes_of(world, others)
    for row in rows.tolist():
        kind = int(world.type[row])
        source = points[kind]
        drawn = rng.integers(0, len(source), ENTRY_CANDIDATES[0])
        gap, slowest, fastest = insertions(source.x[drawn], source.y[drawn], source.heading[drawn], crowd, row)
        place = int(np.where(slowest <= fastest, np.minimum(gap, ENTRY_ROOM[kind]), -np.inf).argmax())
        best = int(drawn[place])
        x[row], y[row] = source.x[best], source.y[best]
        about = np.pi * int(rng.integers(0, 2)) if kind == PEDESTRIAN else 0.0
        heading[row] = wrap_angle(source.heading[best] + about)
        usual = starting_speed(max_speed[kind], source.lanes[source.lane[best]].max_speed, rng.uniform())
        speed[row] = min(usual, float(fastest[place]))
        acceleration[row] = yaw_rate[row] = 0.0
        crowd[row, :4] = x[row], y[row], heading[row], speed[row]
    return replace(world, x=x, y=y, heading=heading, speed=speed, acceleration=acceleration, yaw_rate=yaw_rate)
