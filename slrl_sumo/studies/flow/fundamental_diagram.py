"""The fundamental diagram: flow against density of each edge and minute."""

import numpy as np
from matplotlib.figure import Figure

from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.studies.flow.trace import OnLanes, Trace

INTERVAL = 60.0
"""s."""
SHORTEST = 50.0
"""m: shorter edges say more of their junctions."""
COLUMNS = 3
"""Of the figure."""


def edge_states(trace: Trace, on: OnLanes) -> list[list[float]]:
    """Density (veh/km) and flow (veh/h), per lane, of each edge of SHORTEST m and more in each INTERVAL with a car.

    Edie's definitions: the time that cars spend, and the distance that they drive, on the edge in the interval, over
    its lane length and the interval. (Edie, L. C.: Discussion of traffic stream measurements and definitions, 1963.)
    """
    names = sorted({lane.edge for lane in on.lanes if not lane.internal and lane.length >= SHORTEST})
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


def draw_fundamental_diagram(states: dict[str, dict[str, list[list[float]]]]) -> Figure:
    """A panel for each situation: a dot for each edge and minute, in a colour by arm. `states`: by situation and arm,
    see `edge_states`."""
    colours = ("#999999", "#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#0072B2", "#D55E00")
    height = -(-len(states) // COLUMNS)
    figure = Figure(figsize=(13.0, 3.4 * height + 0.6), layout="constrained")
    grid = figure.subplots(height, COLUMNS, squeeze=False)
    for axes in grid.flat[len(states) :]:
        axes.set_visible(False)
    arms = list(dict.fromkeys(arm for of_arm in states.values() for arm in of_arm))
    for axes, (situation, of_arm) in zip(grid.flat, states.items(), strict=False):
        for arm, points in of_arm.items():
            density, flow = np.array(points, np.float64).reshape(-1, 2).T
            colour = colours[arms.index(arm) % len(colours)]
            axes.plot(density, flow, "o", ms=3, alpha=0.5, mew=0.0, color=colour, label=arm)
        axes.set_title(situation, loc="left", fontsize=10)
        axes.set_xlim(0.0, 150.0)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("density (veh/km and lane)")
        axes.set_ylabel("flow (veh/h and lane)")
        axes.spines[["top", "right"]].set_visible(False)
    handles = {
        label: handle for axes in grid.flat for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), loc="outside upper left", ncols=7, frameon=False)
    return figure
