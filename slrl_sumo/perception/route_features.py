"""What a road user knows of its route as numbers (preset `extended`)."""

import math

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.route import HERE, SPACING, RouteAhead, on_path
from slrl_sumo.scene.state import WorldState

FAR = 60.0
"""m beyond which lines and leaders are all alike."""
TURN = 0.3
"""rad from which on the path counts as turning."""
SHARP = math.sin(TURN) / (math.sin(TURN) + math.cos(TURN))
"""The same as the share of what is aside."""
BACK = 2.0 - 1e-9
"""Straight back as that share."""

ROUTE_FEATURES: tuple[str, ...] = (
    "known",
    "aside",
    "askew",
    "turn_distance",
    "turn",
    "stop",
    "line",
    "green",
    "yellow",
    "red",
    "desired_speed",
    "left",
    "leader_gap",
    "leader_speed",
)
"""Columns of `route_features`: 1 where there is a route; m and rad to the left of the path and of its direction;
distance to the next turn, and rad that the path turns in what is known of it; distances to where it must stop and to
the next line, one-hot signal there; speed that limits, junctions and curves allow; distance to the destination; gap to
who is ahead on the path, and its speed. These distances are in tens of metres, speeds in tens of m/s, at most FAR."""


def route_features(
    world: WorldState, rows: NDArray[np.intp], route: RouteAhead, gap: Floats, leading: Floats
) -> NDArray[np.float32]:
    """The route of the road users `rows` of `world`, (len(rows), 14), columns as in ROUTE_FEATURES.

    `route`, `gap` (m) and `leading` (m/s) are theirs, (len(rows),) each.
    """
    _, aside, direction = on_path(route, world.x[rows, None], world.y[rows, None])
    askew = wrap_angle(world.heading[rows] - direction[:, 0])
    # m and m/s that are all alike where they are too many, in the order of their columns.
    far = np.column_stack([route.stop, route.line, route.desired, route.left, gap, leading])
    # What other modules say must not be a constant of the compiled function.
    return _table(route.known, route.x, route.y, route.signal, aside, askew, direction, far, HERE, SPACING)


@compiled
def _table(
    known: NDArray[np.bool_],
    x: Floats,
    y: Floats,
    signal: NDArray[np.int8],
    aside: Floats,
    askew: Floats,
    direction: Floats,
    far: Floats,
    here: int,
    spacing: float,
) -> NDArray[np.float32]:
    table = np.zeros((len(known), 14), np.float32)
    for i in range(len(known)):
        if not known[i]:
            continue
        until, turn = _turns(x[i], y[i], direction[i, 0], here)
        table[i, 0], table[i, 1], table[i, 2] = 1.0, min(max(aside[i, 0], -5.0), 5.0), askew[i]
        table[i, 3], table[i, 4] = until * spacing / 10.0, turn
        table[i, 5], table[i, 6] = min(far[i, 0], FAR) / 10.0, min(far[i, 1], FAR) / 10.0
        if signal[i] > 0:
            table[i, 6 + signal[i]] = 1.0
        for k in range(2, far.shape[1]):
            table[i, 8 + k] = min(far[i, k], FAR) / 10.0
    return table


@compiled
def _turns(x: Floats, y: Floats, direction: float, here: int) -> tuple[int, float]:
    """Pieces of a path from `here` to the first that turns by more than TURN from a direction (rad), all that there are
    if none does, and by how much (rad) that piece turns that does so most."""
    c, s = math.cos(direction), math.sin(direction)
    until, most, most_ahead, most_aside = len(x) - 1 - here, -1.0, 1.0, 0.0
    for k in range(here, len(x) - 1):
        dx, dy = x[k + 1] - x[k], y[k + 1] - y[k]
        ahead, aside = c * dx + s * dy, c * dy - s * dx
        # Grows with the angle, from 0 straight on to 2 straight back, without libm.
        sharp = abs(aside) / (abs(ahead) + abs(aside))
        sharp = sharp if ahead >= 0.0 else 2.0 - sharp
        if sharp > most:
            most, most_ahead, most_aside = sharp, ahead, aside
        if sharp > SHARP:
            until = min(until, k - here)
    # Straight back is to the left, whatever the last bits say.
    return until, math.pi if most > BACK else math.atan2(most_aside, most_ahead)
