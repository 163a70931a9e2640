"""Road users that leave the scene come back on its other side (paper, section 3.4)."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats, to_ego, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.spawn import starting_speed
from slrl_sumo.sumo.lanes import LanePoints

CANDIDATES = (24, 384)
"""Numbers of entry places that are tried for each returning road user: the second where the first ones are taken."""

ROOM = np.array([4.7, 2.3, 1.0])
"""m between the circles around two boxes that a returning road user of each type needs to be able to stop."""

NO_EXITS = np.zeros((0, 4))

BEYOND, ASIDE = 12.0, 1.5
"""m behind a lane's end, and beside it, within which a road user off every surface has driven off that end."""

BRAKING = 2.0
"""m/s² with which a road user that starts anew must be able to stop before the nearest one."""


def left_scene(world: WorldState, roadmap: RoadMap, exits: Floats = NO_EXITS, *, rim: float = 0.0) -> NDArray[np.bool_]:
    """Which road users have left the scene, (n,): more than `rim` m outside the network's bounding box, about 10 m away
    from every surface, or off the end of a lane at one of the `exits` (see Network.exits)."""
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

    A torus as in the paper: the position is shifted back along the heading by the extent of the scene, then snapped to
    the nearest legal place of the type that leads into the same half-plane, free of the road users of `world` and
    `others`; where none is free, to the one with the widest gap. Speed is kept up to the limit there.
    """
    x, y, heading, speed = world.x.copy(), world.y.copy(), world.heading.copy(), world.speed.copy()
    x0, y0, x1, y1 = roadmap.bounds
    crowd_x, crowd_y = np.concatenate([x, others.x]), np.concatenate([y, others.y])
    radii = 0.5 * np.concatenate([np.hypot(world.length, world.width), np.hypot(others.length, others.width)])
    for row in np.flatnonzero(gone).tolist():
        kind = int(world.type[row])
        source = points[kind]
        c, s = np.cos(heading[row]), np.sin(heading[row])
        extent = min((x1 - x0) / max(abs(c), 1e-6), (y1 - y0) / max(abs(s), 1e-6))
        wrapped_x = np.clip(x[row] - extent * c, x0, x1)
        wrapped_y = np.clip(y[row] - extent * s, y0, y1)
        for count in CANDIDATES:
            rows = source.nearest(np.array([wrapped_x]), np.array([wrapped_y]), count)[0]
            turn = np.abs(wrap_angle(source.heading[rows] - heading[row]))
            if kind == RoadUserType.PEDESTRIAN:
                turn = np.minimum(turn, np.pi - turn)
            gap = _gaps(source.x[rows], source.y[rows], crowd_x, crowd_y, radii, row)
            if ((gap >= ROOM[kind]) & (turn <= 0.5 * np.pi)).any():
                break
        away = np.hypot(source.x[rows] - wrapped_x, source.y[rows] - wrapped_y)
        # By priority: room to stop, else as much as there is; the same direction; near the mirrored point.
        crowded = np.where(gap >= ROOM[kind], -np.inf, -gap)
        best = rows[np.lexsort((away, turn > 0.5 * np.pi, crowded))[0]]
        crowd_x[row], crowd_y[row] = x[row], y[row] = source.x[best], source.y[best]
        direction = source.heading[best]
        if kind == RoadUserType.PEDESTRIAN and abs(wrap_angle(direction - heading[row])) > 0.5 * np.pi:
            direction += np.pi
        heading[row] = wrap_angle(direction)
        speed[row] = min(speed[row], source.lanes[source.lane[best]].max_speed)
    return replace(world, x=x, y=y, heading=heading, speed=speed)


def start_anew(
    world: WorldState,
    rows: NDArray[np.intp],
    others: WorldState,
    points: tuple[LanePoints, ...],
    max_speed: Floats,
    rng: np.random.Generator,
) -> WorldState:
    """`world` with its road users `rows` at places drawn anew, with room to stop, under way as at the very start.

    `max_speed`: per type, m/s, (3,). Where no free place is among those drawn, the one with the widest gap is taken.
    """
    x, y, heading, speed = world.x.copy(), world.y.copy(), world.heading.copy(), world.speed.copy()
    acceleration, yaw_rate = world.acceleration.copy(), world.yaw_rate.copy()
    crowd_x, crowd_y = np.concatenate([x, others.x]), np.concatenate([y, others.y])
    radii = 0.5 * np.concatenate([np.hypot(world.length, world.width), np.hypot(others.length, others.width)])
    for row in rows.tolist():
        kind = int(world.type[row])
        source = points[kind]
        drawn = rng.integers(0, len(source), CANDIDATES[0])
        gap = _gaps(source.x[drawn], source.y[drawn], crowd_x, crowd_y, radii, row)
        best = int(np.minimum(gap, ROOM[kind]).argmax())
        stopping = np.sqrt(2.0 * BRAKING * max(float(gap[best]), 0.0))
        best = int(drawn[best])
        crowd_x[row], crowd_y[row] = x[row], y[row] = source.x[best], source.y[best]
        about = np.pi * int(rng.integers(0, 2)) if kind == RoadUserType.PEDESTRIAN else 0.0
        heading[row] = wrap_angle(source.heading[best] + about)
        usual = starting_speed(max_speed[kind], source.lanes[source.lane[best]].max_speed, rng.uniform())
        speed[row] = min(usual, stopping)
        acceleration[row] = yaw_rate[row] = 0.0
    return replace(world, x=x, y=y, heading=heading, speed=speed, acceleration=acceleration, yaw_rate=yaw_rate)


@compiled
def _gaps(x: Floats, y: Floats, crowd_x: Floats, crowd_y: Floats, radii: Floats, own: int) -> Floats:
    """m from the circle around road user `own` of a crowd, (m,), at each of n places to the nearest other circle."""
    gaps, widest = np.empty(len(x)), radii.max()
    for place in range(len(x)):
        # A square root for each of 400,000 pairs takes longer than a decision of 64 road users.
        least, far = np.inf, np.inf
        for one in range(len(radii)):
            dx, dy = x[place] - crowd_x[one], y[place] - crowd_y[one]
            square = dx * dx + dy * dy
            if square < far and one != own:
                gap = math.sqrt(square) - radii[one]
                if gap < least:
                    least, far = gap, max(gap + widest, 0.0) ** 2
        gaps[place] = least - radii[own]
    return gaps
