"""What a road user knows of its route as numbers (preset `extended`)."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.world.geometry import Floats, wrap_angle
from slrl_sumo.world.route import AHEAD, HERE, SPACING, RouteAhead, on_path
from slrl_sumo.world.state import WorldState

FAR = 60.0
"""m beyond which lines and leaders are all alike."""
TURN = 0.3
"""rad from which on the path counts as turning."""

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
    _, aside, direction = (column[:, 0] for column in on_path(route, world.x[rows, None], world.y[rows, None]))
    dx, dy = np.diff(route.x[:, HERE:], axis=1), np.diff(route.y[:, HERE:], axis=1)
    turned = wrap_angle(np.arctan2(dy, dx) - direction[:, None])
    turning = np.abs(turned) > TURN
    until = np.where(turning.any(axis=1), turning.argmax(axis=1) * SPACING, AHEAD)
    sharpest = np.take_along_axis(turned, np.abs(turned).argmax(axis=1)[:, None], axis=1)[:, 0]
    signal = np.eye(4)[route.signal][:, 1:]
    columns = [
        np.clip(aside, -5.0, 5.0),
        wrap_angle(world.heading[rows] - direction),
        until / 10.0,
        sharpest,
        np.minimum(route.stop, FAR) / 10.0,
        np.minimum(route.line, FAR) / 10.0,
        *signal.T,
        np.minimum(route.desired, FAR) / 10.0,
        np.minimum(route.left, FAR) / 10.0,
        np.minimum(gap, FAR) / 10.0,
        np.minimum(leading, FAR) / 10.0,
    ]
    table = np.column_stack([np.ones(len(rows)), *columns])
    return np.where(route.known[:, None], table, 0.0).astype(np.float32)
