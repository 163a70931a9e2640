"""How vehicles drive: braking, jerk, lane keeping, and standing without a cause."""

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.metrics.counters import ratio
from slrl_sumo.scene.types import DECISION_INTERVAL, STANDING_SPEED
from slrl_sumo.studies.flow.trace import OnLanes, Trace

UNUSUAL_BRAKING = -4.65
"""m/s²: SUMO's drivers brake with up to 4.5 m/s² as a rule, and rounding must not make that hard."""
TRACKING = (11.0, 14.0)
"""m/s between which the lateral offset is measured."""
OFF_LANE, FAR_OFF_LANE = 1.0, 3.0
"""m of the centre from the edge of the nearest lane beyond which a car is off the lanes, and far off."""
LONG_STAND = 60.0
"""s."""
CLEAR = 20.0
"""m ahead, on the own lane, in which something may be the cause of standing: a vehicle, or the end of the lane."""


def behaviour_figures(trace: Trace, on: OnLanes) -> dict[str, Any]:
    """The figures of this module, see FIGURES; None where nothing was measured."""
    acceleration, jerk = changes(trace)
    hours = DECISION_INTERVAL / 3600.0
    braking = acceleration < UNUSUAL_BRAKING
    begun = braking & ~np.concatenate([[False], braking[:-1]])
    own = trace.learned
    tracking = (trace.speed[on.row] >= TRACKING[0]) & (trace.speed[on.row] < TRACKING[1])
    known = np.abs(jerk[np.isfinite(jerk)])
    aside = np.abs(on.aside[tracking & (on.outside == 0.0)])
    return {
        "hard_brakes_learned": ratio(int(begun[own].sum()), hours * int(own.sum()), 2) if own.any() else None,
        "hard_brakes_background": ratio(int(begun[~own].sum()), hours * int((~own).sum()), 2),
        "jerk": round(float(np.percentile(known, 95)), 2) if len(known) else None,
        "lateral_offset": round(float(np.percentile(aside, 95)), 3) if len(aside) else None,
        "off_lane": ratio(100.0 * int((on.outside > OFF_LANE).sum()), len(on.row), 4),
        "far_off_lane": int((on.outside > FAR_OFF_LANE).sum()),
        "long_stands": long_stands(trace, on),
    }


def changes(trace: Trace) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Acceleration (m/s²) and jerk (m/s³) over the last interval of each row, (R,); NaN where it is unknown."""
    acceleration, jerk = np.full(len(trace), np.nan), np.full(len(trace), np.nan)
    after = trace.steps(DECISION_INTERVAL) + 1
    acceleration[after] = (trace.speed[after] - trace.speed[after - 1]) / DECISION_INTERVAL
    jerk[after] = (acceleration[after] - acceleration[after - 1]) / DECISION_INTERVAL
    return acceleration, jerk


def long_stands(trace: Trace, on: OnLanes) -> int:
    """Cars that stand for LONG_STAND and more with nothing CLEAR m ahead, at a time or several."""
    order = np.lexsort((on.front, on.lane, trace.time[on.row]))
    row, lane, front = on.row[order], on.lane[order], on.front[order]
    room = np.array([one.length for one in on.lanes])[lane] - front if len(row) else np.zeros(0)
    leader = (np.diff(trace.time[row]) == 0.0) & (np.diff(lane) == 0)
    gap = np.where(leader, np.diff(front) - trace.length[trace.vehicle[row[1:]]], np.inf)
    room[:-1] = np.minimum(room[:-1], gap)
    free = np.zeros(len(trace), np.bool_)
    free[row] = (trace.speed[row] < STANDING_SPEED) & (room > CLEAR)
    # Runs of free rows of one vehicle begin and end here.
    edges = np.flatnonzero(np.diff(np.concatenate([[0], (free * (trace.vehicle + 1)), [0]])))
    times = [(a, b) for a, b in pairwise(edges.tolist()) if free[a]]
    return len({int(trace.vehicle[a]) for a, b in times if trace.time[b - 1] - trace.time[a] >= LONG_STAND})
