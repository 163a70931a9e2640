"""The states of the fundamental diagram: flow and density of each edge and minute."""

import numpy as np

from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.studies.flow.trace import OnLanes, Trace

INTERVAL = 60.0
"""s."""
SHORTEST_EDGE = 50.0
"""m: shorter edges say more of their junctions."""


def edge_states(trace: Trace, on: OnLanes) -> list[list[float]]:
    """Density (veh/km) and flow (veh/h), per lane, of each edge of SHORTEST_EDGE m and more in each INTERVAL with a
    car.

    Edie's definitions: the time that cars spend, and the distance that they drive, on the edge in the interval, over
    its lane length and the interval. (Edie, L. C.: Discussion of traffic stream measurements and definitions, 1963.)
    """
    names = sorted({lane.edge for lane in on.lanes if not lane.internal and lane.length >= SHORTEST_EDGE})
    number = {name: k for k, name in enumerate(names)}
    lane_km = np.zeros(len(names))
    for lane in on.lanes:
        if lane.edge in number:
            lane_km[number[lane.edge]] += lane.length / 1e3
    of_lane = np.array([number.get(lane.edge, -1) for lane in on.lanes], np.int64)
    edge = of_lane[on.lane] if len(on.lane) else np.zeros(0, np.int64)
    kept = edge >= 0
    row, edge = on.row[kept], edge[kept]
    minute = (trace.time[row] // INTERVAL).astype(np.int64)
    cell, back = np.unique(np.column_stack([edge, minute]), axis=0, return_inverse=True)
    hours = np.bincount(back.ravel(), minlength=len(cell)) * DECISION_INTERVAL / 3600.0
    km = np.bincount(back.ravel(), trace.speed[row], minlength=len(cell)) * DECISION_INTERVAL / 1e3
    area = lane_km[cell[:, 0]] * INTERVAL / 3600.0
    return np.column_stack([hours / area, km / area]).round(2).tolist()  # type: ignore[no-any-return]
