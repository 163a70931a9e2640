"""Who drives or stands ahead of road users on their own path."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import AHEAD, RouteAhead, beside, on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

SIDE_GAP = np.array([0.25, 0.25, 0.1])
"""m that must stay free beside a box for others to be no leader, by the type of who follows."""
NEAREST = np.array([0.5, 0.5, 0.25])
"""m ahead from which somebody leads: who is beside us is nobody's leader."""
ALIKE = 1.1
"""rad between the directions of a path and of somebody on it, beyond which that one crosses it, and does not lead."""
STANDING = 0.5
"""m/s below which whoever is on the path counts, whatever the direction."""


def leaders(route: RouteAhead, world: WorldState) -> tuple[Floats, Floats]:
    """Gap between boxes along the path (m, inf: no leader within sight) and speed along it (m/s) of the nearest road
    user on the path of each of the n road users of `route`, the first ones of `world`: (n,) each."""
    n = len(route)
    if len(world) < 2:
        return np.full(n, np.inf), np.zeros(n)
    room, reach = SIDE_GAP[world.type] + 0.5 * world.width, 0.5 * np.hypot(world.length, world.width)
    ego, other = beside(route, room, world.x, world.y, reach)
    places = on_path(route, world.x[other, None], world.y[other, None], ego)
    # What other modules say must not be a constant of the compiled function.
    return _first(
        n,
        ego,
        other,
        *places,
        world.heading,
        world.speed,
        world.length,
        world.width,
        world.type,
        AHEAD,
        int(RoadUserType.PEDESTRIAN),
    )


@compiled
def _first(
    n: int,
    egos: NDArray[np.intp],
    others: NDArray[np.intp],
    places: Floats,
    asides: Floats,
    directions: Floats,
    heading: Floats,
    speed: Floats,
    length: Floats,
    width: Floats,
    kinds: NDArray[np.int8],
    sight: float,
    walks: int,
) -> tuple[Floats, Floats]:
    """Gap and speed of the first of `others` (p,) on the paths of `egos` (p,), at such places (p, 1): (n,) each."""
    gap, leading = np.full(n, math.inf), np.zeros(n)
    for pair in range(len(egos)):
        ego, other, along = egos[pair], others[pair], places[pair, 0]
        kind = kinds[ego]
        if not NEAREST[kind] < along < sight + 0.5 * length[other]:
            continue
        turn = heading[other] - directions[pair, 0]
        same, across = math.cos(turn), abs(math.sin(turn))
        ahead, wide = (
            abs(same) * length[other] + across * width[other],
            across * length[other] + abs(same) * width[other],
        )
        if abs(asides[pair, 0]) - 0.5 * wide - 0.5 * width[ego] >= SIDE_GAP[kind]:
            continue
        # People walk round who stands in their way, unless it waits where they want to wait.
        if not (same > math.cos(ALIKE) or (kind != walks and speed[other] < STANDING)):
            continue
        between = along - 0.5 * ahead - 0.5 * length[ego]
        if between < gap[ego]:
            gap[ego], leading[ego] = between, max(speed[other] * same, 0.0)
    return gap, leading
