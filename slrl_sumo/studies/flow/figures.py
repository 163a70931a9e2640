"""The figures of a run of the flow benchmark, each with its unit and definition."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from slrl_sumo.metrics.counters import ratio
from slrl_sumo.metrics.traffic.trips import Trip
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.studies.flow.behaviour import (
    CLEAR,
    FAR_OFF_LANE,
    LONG_STAND,
    OFF_LANE,
    TRACKING,
    UNUSUAL_BRAKING,
)
from slrl_sumo.studies.flow.saturation import FIRST, discharge_headways
from slrl_sumo.studies.flow.trace import OnLanes, Trace

REACHED = 0.95
"""Share of the desired speed that ends a start."""
HELD_TOLERANCE = 0.3
"""m/s from the desired speed within which it is held."""
FOLLOWING_SPEED, FOLLOWING_HEADWAY = 5.0, 4.0
"""m/s and s: a faster vehicle with a shorter headway follows another one."""

HARD = f"by more than {-UNUSUAL_BRAKING:g} m/s²"

Value = float | None


@dataclass(frozen=True)
class Figure:
    """A line of the table."""

    title: str
    unit: str
    digits: int
    definition: str
    ratio: bool = True
    """Whether its ratio to SUMO's is a meaningful number."""


FIGURES: dict[str, Figure] = {
    "departed": Figure("departed", "1", 0, "vehicles that entered the network"),
    "finished": Figure("finished", "1", 0, "vehicles that arrived at their destination before the end"),
    "walkers_finished": Figure("pedestrians finished", "1", 0, "pedestrians that arrived before the end"),
    "under_way": Figure("under way at the end", "1", 0, "vehicles in the network at the end", ratio=False),
    "travel_time": Figure(
        "travel time", "s", 1, "median over the vehicles that finished both in this run and in SUMO's of the same seed"
    ),
    "stops": Figure(
        "stops", "1", 2, "mean number of times that a vehicle stood for 1 s or longer after it had moved", ratio=False
    ),
    "saturation_flow": Figure(
        "saturation flow",
        "veh/h",
        0,
        f"3600 s over the mean headway at the stop line of the vehicles from the {FIRST}th on of the queues that stood "
        "when the light of their lane turned green",
    ),
    "headway": Figure(
        "time headway",
        "s",
        2,
        f"median time from the front of a car's leader on its lane to its own front, at more than {FOLLOWING_SPEED:g} "
        f"m/s and up to {FOLLOWING_HEADWAY:g} s",
    ),
    "start": Figure(
        "start",
        "s",
        1,
        f"median time from the departure to {REACHED:.0%} of the desired speed; none where half of the vehicles never "
        "reach it before SUMO drives them to their destination",
    ),
    "held": Figure(
        "speed held",
        "%",
        1,
        f"share of the time after that within {HELD_TOLERANCE:g} m/s of the desired speed",
    ),
    "speed": Figure("speed", "m/s", 2, "distance of all vehicles over their time in the network"),
    "collisions": Figure("collisions", "1/1000", 1, "overlapping pairs of boxes, of 1,000 learned ones; see metrics"),
    "red_runs": Figure("red runs", "1/1000", 2, "road users that pass a red signal, of 1,000 that pass a signal"),
    "hard_brakes_learned": Figure(
        "hard brakes, learned", "1/h", 2, f"times per hour of learned vehicles that one begins to brake {HARD}"
    ),
    "hard_brakes_background": Figure(
        "hard brakes, background", "1/h", 2, f"times per hour of SUMO's vehicles that one begins to brake {HARD}"
    ),
    "jerk": Figure(
        "jerk", "m/s³", 2, "95th percentile of the change of the acceleration from one interval of 0.4 s to the next"
    ),
    "lateral_offset": Figure(
        "lateral offset",
        "m",
        2,
        "95th percentile of the distance of cars on a lane from its centre line, at "
        f"{TRACKING[0]:g} to {TRACKING[1]:g} m/s",
    ),
    "off_lane": Figure(
        "off lane",
        "%",
        3,
        f"share of the steps of cars with the centre more than {OFF_LANE:g} m off every lane",
        ratio=False,
    ),
    "far_off_lane": Figure(
        "far off lane",
        "1",
        0,
        f"steps of cars with the centre more than {FAR_OFF_LANE:g} m off every lane",
        ratio=False,
    ),
    "long_stands": Figure(
        "long stands",
        "1",
        0,
        f"cars that stand for {LONG_STAND:g} s or longer with no vehicle and no end of their lane within {CLEAR:g} m "
        "ahead",
        ratio=False,
    ),
}
"""By their key in results.json, in the order of the table."""


def trip_figures(trips: Mapping[str, Trip], end: float) -> dict[str, Any]:
    """Figures of all trips of a run that ended at `end` (s); `under_way_by_minute`: vehicles at each full minute."""
    vehicles = [trip for trip in trips.values() if trip.type != RoadUserType.PEDESTRIAN]
    walkers = [trip for trip in trips.values() if trip.type == RoadUserType.PEDESTRIAN]
    departed = np.array([trip.departed for trip in vehicles])
    arrived = np.array([np.inf if trip.arrived is None else trip.arrived for trip in vehicles])
    minutes = np.arange(60.0, end + 1.0, 60.0)
    under_way = [int(((departed <= minute) & (arrived > minute)).sum()) for minute in minutes]
    time = float((np.minimum(arrived, end) - departed).sum()) if vehicles else 0.0
    return {
        "departed": len(vehicles),
        "finished": int(np.isfinite(arrived).sum()),
        "walkers_finished": sum(trip.arrived is not None for trip in walkers) if walkers else None,
        "under_way": int(np.isinf(arrived).sum()),
        "stops": ratio(sum(trip.stops for trip in vehicles), len(vehicles)),
        "speed": ratio(sum(trip.distance for trip in vehicles), time) if time > 0.0 else None,
        "under_way_by_minute": under_way,
    }


def motion_figures(
    trace: Trace, on: OnLanes, greens: Mapping[str, Sequence[float]], desired: float | None
) -> dict[str, Any]:
    """Figures of the motion of all vehicles; `greens`: see `discharge_headways`; `desired`: see `TrafficCase`."""
    headways = discharge_headways(trace, on, greens)
    return {
        "saturation_flow": ratio(3600.0 * len(headways), float(headways.sum()), 1) if len(headways) else None,
        "headway": _median(time_headways(trace, on)),
        **({} if desired is None else start_figures(trace, desired)),
    }


def start_figures(trace: Trace, desired: float) -> dict[str, Value]:
    """How soon vehicles reach their `desired` speed (m/s), and how well they hold it.

    Of a vehicle that was learned only the time up to then counts: before its destination SUMO drives it again.
    """
    waits, held, steps = [], 0, 0
    for begin, end in zip(trace.starts[:-1], trace.starts[1:], strict=True):
        learned = np.flatnonzero(trace.learned[begin:end])
        speed = trace.speed[begin : begin + learned[-1] + 1 if len(learned) else end]
        fast = np.flatnonzero(speed >= REACHED * desired)
        waits.append(float(trace.time[begin + fast[0]] - trace.time[begin]) if len(fast) else np.inf)
        if len(fast):
            after = np.abs(speed[fast[0] :] - desired) <= HELD_TOLERANCE
            held, steps = held + int(after.sum()), steps + len(after)
    wait = float(np.median(waits)) if waits else np.inf
    return {"start": round(wait, 2) if np.isfinite(wait) else None, "held": ratio(100.0 * held, steps, 2)}


def time_headways(trace: Trace, on: OnLanes) -> Floats:
    """Time headways (s) of all cars that follow another one on their lane, one per step, (k,)."""
    order = np.lexsort((on.front, on.lane, trace.time[on.row]))
    row, front = on.row[order], on.front[order]
    together = (np.diff(trace.time[row]) == 0.0) & (np.diff(on.lane[order]) == 0)
    speed = np.maximum(trace.speed[row[:-1]], 1e-9)
    headway = np.diff(front) / speed
    following = together & (speed > FOLLOWING_SPEED) & (headway > 0.0) & (headway < FOLLOWING_HEADWAY)
    return np.asarray(headway[following], np.float64)


def _median(values: Floats) -> Value:
    return round(float(np.median(values)), 3) if len(values) else None
