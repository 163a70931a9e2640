"""Headways of queues that discharge at a stop line."""

from collections.abc import Mapping, Sequence

import numpy as np

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.studies.flow.trace import OnLanes, Trace

FIRST = 5
"""Number of the first vehicle of a queue with a counted headway: vehicles before it still accelerate."""
QUEUED = 1.0
"""Speed (m/s) below which vehicles stand in the queue when the signal turns green."""
HEAD = 15.0
"""Distance (m) from the stop line within which a queue begins."""
LONGEST_GAP = 15.0
"""Greatest distance (m) between the fronts of successive vehicles of a queue."""
LONGEST_HEADWAY = 10.0
"""Headway (s) above which a vehicle of a queue did not follow its leader."""


def crossing_times(trace: Trace, on: OnLanes, lane: int) -> dict[int, float]:
    """Times (s), interpolated between rows, at which the fronts of vehicles, by their index, crossed a lane's end."""
    end = on.lanes[lane].length
    here = np.flatnonzero(on.lane == lane)
    times: dict[int, float] = {}
    for part in np.split(here, np.flatnonzero(np.diff(trace.vehicle[on.row[here]])) + 1):
        if not len(part):
            continue
        rows, front = on.row[part], on.front[part]
        vehicle, time = int(trace.vehicle[rows[0]]), trace.time[rows]
        over = np.flatnonzero(front >= end)
        if len(over):
            a, b = max(over[0] - 1, 0), over[0]
            times[vehicle] = float(np.interp(end, [front[a], front[b]], [time[a], time[b]]))
        else:
            following = rows[-1] + 1
            if following < len(trace) and trace.vehicle[following] == vehicle:
                needed = (end - front[-1]) / max(float(trace.speed[following]), 0.1)
                if needed <= DECISION_INTERVAL + 0.1:
                    times[vehicle] = float(time[-1] + min(needed, DECISION_INTERVAL))
    return times


def discharge_headways(trace: Trace, on: OnLanes, greens: Mapping[str, Sequence[float]]) -> Floats:
    """Headways (s) at the stop line of the vehicles from the FIRST on of all queues, (k,).

    `greens`: times (s) at which the light of a lane, by its id, turned green. A queue is the vehicles that stand on
    the lane then, from one within HEAD of the stop line on, without a gap; it ends before the first one that does not
    follow within LONGEST_HEADWAY, and before the next green.
    """
    found: list[float] = []
    number = {lane.id: k for k, lane in enumerate(on.lanes)}
    for lane_id, begins in greens.items():
        lane = number.get(lane_id)
        if lane is None or not begins:
            continue
        crossed = crossing_times(trace, on, lane)
        here = np.flatnonzero(on.lane == lane)
        end = on.lanes[lane].length
        for begin, following in zip(begins, [*begins[1:], np.inf], strict=True):
            at = here[np.abs(trace.time[on.row[here]] - begin) < 0.5 * DECISION_INTERVAL]
            at = at[trace.speed[on.row[at]] < QUEUED]
            at = at[np.argsort(-on.front[at])]
            if not len(at) or end - on.front[at[0]] > HEAD:
                continue
            breaks = np.flatnonzero(-np.diff(on.front[at]) > LONGEST_GAP)
            queue = trace.vehicle[on.row[at[: breaks[0] + 1 if len(breaks) else len(at)]]].tolist()
            last = None
            for place, vehicle in enumerate(queue, start=1):
                # The first vehicle may stand with its front past the line.
                time = max(crossed.get(vehicle, np.inf), begin)
                if time >= following or (last is not None and not 0.0 < time - last < LONGEST_HEADWAY):
                    break
                if place >= FIRST and last is not None:
                    found.append(time - last)
                last = time
    return np.array(found, np.float64)
