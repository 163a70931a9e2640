"""The measures of a comparison, each with its unit and definition."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean

from slrl_sumo.metrics.conflicts import PET_LIMIT
from slrl_sumo.metrics.encounters import DEFINITIONS, TTC_LIMIT
from slrl_sumo.metrics.traffic.trips import Trip
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES, RoadUserType
from slrl_sumo.studies.compare.run import Record

EVERY_TYPE = "all"
VEHICLES = (RoadUserType.CAR, RoadUserType.BICYCLE)


@dataclass(frozen=True)
class SeedRun:
    """One run of a seed, and the trips that it shares with the other arm. `emissions` of a record are empty where the
    vehicles' types are unknown."""

    record: Record
    trips: Mapping[str, Trip]
    """All trips, by road user."""
    same: frozenset[str]
    """Ids of road users that arrived in both arms."""


Value = Callable[[SeedRun, str], float | None]
"""Of a run and a type name or EVERY_TYPE."""


@dataclass(frozen=True)
class Measure:
    """One line of the table for each of its types."""

    name: str
    title: str
    unit: str
    digits: int
    types: Sequence[str]
    value: Value
    definition: str


def _trip_mean(of: Callable[[Trip], float]) -> Value:
    def value(seed: SeedRun, kind: str) -> float | None:
        trips = [seed.trips[i] for i in sorted(seed.same) if TYPE_NAMES[seed.trips[i].type] == kind]
        return fmean(of(trip) for trip in trips) if trips else None

    return value


def _driving(key: str, scale: float = 1.0) -> Value:
    def value(seed: SeedRun, kind: str) -> float | None:
        found = seed.record["driving_stats"][kind][key]
        return None if found is None else scale * found

    return value


def _conflicts(measure: str) -> Value:
    def value(seed: SeedRun, kind: str) -> float:
        return float(sum(kind == EVERY_TYPE or kind in row[2:4] for row in seed.record["conflicts"][measure]))

    return value


def _conflict_rate(measure: str) -> Value:
    def value(seed: SeedRun, kind: str) -> float | None:
        hours = seed.record["driving_stats"][kind]["steps"] * DECISION_INTERVAL / 3600.0
        return _conflicts(measure)(seed, kind) / hours if hours else None

    return value


def _red(seed: SeedRun, kind: str) -> float | None:
    found = seed.record["signal_crossings"][kind]
    return 1000.0 * found["red"] / found["all"] if found["all"] else None


def _emitted(pollutant: str, scale: float) -> Value:
    def value(seed: SeedRun, kind: str) -> float | None:
        found = seed.record["emissions"]
        return scale * float(found[pollutant]) if found else None

    return value


def _co2_per_km(seed: SeedRun, kind: str) -> float | None:
    found = seed.record["emissions"]
    return 1000.0 * found["co2"] / found["metres"] if found and found["metres"] else None


def _learned_share(seed: SeedRun, kind: str) -> float | None:
    steps = seed.record["driving_stats"][EVERY_TYPE]["steps"]
    return 100.0 * seed.record["learned"]["steps"] / steps if steps else None


def _finished(seed: SeedRun, kind: str) -> float:
    return float(sum(t.arrived is not None and kind in (EVERY_TYPE, TYPE_NAMES[t.type]) for t in seed.trips.values()))


WHEELS = tuple(TYPE_NAMES[kind] for kind in VEHICLES)
SAME = "mean over the trips that were finished in both arms of a seed"
EMITTED = (
    "all vehicles together, from speed and acceleration every 0.4 s by the emission class that SUMO has for the "
    "vehicle (SUMO's emissionsDrivingCycle), on level ground"
)
MEASURES = (
    Measure("trips", "trips finished", "1", 1, TYPE_NAMES, _finished, "road users that arrived within the run"),
    Measure(
        "travel_time",
        "travel time",
        "s",
        1,
        TYPE_NAMES,
        _trip_mean(lambda trip: (trip.arrived or 0.0) - trip.departed),
        f"from the departure to the arrival; {SAME}",
    ),
    Measure("way", "way", "m/trip", 0, TYPE_NAMES, _trip_mean(lambda trip: trip.distance), f"distance covered; {SAME}"),
    Measure(
        "time_loss",
        "time loss",
        "s",
        1,
        TYPE_NAMES,
        _trip_mean(lambda trip: trip.time_loss),
        f"time beyond what the same way takes at the speed wanted, as SUMO's tripinfo has it; {SAME}",
    ),
    Measure(
        "delay",
        "delay",
        "s",
        1,
        WHEELS,
        _trip_mean(lambda trip: trip.time_loss + trip.departure_delay),
        f"time loss, and the wait for room to depart; {SAME}",
    ),
    Measure(
        "stops",
        "stops",
        "1/trip",
        2,
        TYPE_NAMES,
        _trip_mean(lambda trip: trip.stops),
        f"how often a road user came to stand (below 0.1 m/s) for 1 s and more; {SAME}",
    ),
    Measure(
        "standing",
        "standing",
        "s/trip",
        1,
        TYPE_NAMES,
        _trip_mean(lambda trip: trip.standing),
        f"time below 0.1 m/s; {SAME}",
    ),
    Measure(
        "speed",
        "speed",
        "m/s",
        2,
        TYPE_NAMES,
        _driving("mean_speed_mps"),
        "mean over all road users and moments, standing ones included",
    ),
    Measure(
        "hard_braking",
        "hard braking",
        "%",
        2,
        WHEELS,
        _driving("hard_braking_share", 100.0),
        "share of the moments at which a road user slowed down by more than 4.5 m/s² over 0.4 s",
    ),
    Measure(
        "off_surface",
        "off surface",
        "%",
        2,
        TYPE_NAMES,
        _driving("off_surface_share", 100.0),
        "share of the moments at which the centre was not on a surface of the type's own: cars belong on roads",
    ),
    Measure(
        "red",
        "at red",
        "1/1000",
        1,
        TYPE_NAMES,
        _red,
        "road users that went past a red signal, of 1000 that went past a signal",
    ),
    Measure(
        "ttc",
        f"conflicts, TTC < {TTC_LIMIT:g} s",
        "1",
        1,
        (EVERY_TYPE, *TYPE_NAMES),
        _conflicts("ttc"),
        f"encounters of two road users, not both pedestrians, whose boxes would have touched within {TTC_LIMIT:g} s "
        "had both kept their velocity; each counted once, for both types and once for all",
    ),
    Measure(
        "ttc_rate",
        f"TTC < {TTC_LIMIT:g} s per hour",
        "1/h",
        1,
        (EVERY_TYPE,),
        _conflict_rate("ttc"),
        "the same per hour that a road user was on its way, all road users' hours added up",
    ),
    Measure(
        "pet",
        f"conflicts, PET < {PET_LIMIT:g} s",
        "1",
        1,
        (EVERY_TYPE, *TYPE_NAMES),
        _conflicts("pet"),
        f"encounters of two road users, not both pedestrians, of which one was less than {PET_LIMIT:g} s after the "
        "other at the same place, at an angle of 30° or more; each counted once, for both types and once for all",
    ),
    Measure(
        "collisions",
        "collisions",
        "1",
        1,
        (EVERY_TYPE, *TYPE_NAMES),
        _driving("collisions"),
        DEFINITIONS["collision"],
    ),
    Measure(
        "near_misses",
        "near misses",
        "1",
        1,
        (EVERY_TYPE, *TYPE_NAMES),
        _driving("near_misses"),
        DEFINITIONS["near miss"],
    ),
    Measure("co2", "CO2", "kg", 2, (EVERY_TYPE,), _emitted("co2", 1e-3), EMITTED),
    Measure(
        "co2_per_km",
        "CO2 per km",
        "g/km",
        0,
        (EVERY_TYPE,),
        _co2_per_km,
        "CO2 over the way of the vehicles that emit any",
    ),
    Measure("nox", "NOx", "g", 2, (EVERY_TYPE,), _emitted("nox", 1.0), EMITTED),
    Measure("pmx", "PMx", "g", 3, (EVERY_TYPE,), _emitted("pmx", 1.0), EMITTED),
    Measure("fuel", "fuel", "kg", 2, (EVERY_TYPE,), _emitted("fuel", 1e-3), EMITTED),
    Measure(
        "learned",
        "learned",
        "%",
        1,
        (EVERY_TYPE,),
        _learned_share,
        "share of the road users' time in which learned models moved them; SUMO moves the others",
    ),
)
RUNS_ALONE = ("delay", "red", "learned")
"""Traces contain neither waiting times before departure nor signals, and do not always mark learned road users."""
AT_LIMITS = (
    "time beyond what the same way takes at the limits of the lanes, or at the top speed of the vehicle type where "
    f"that is less; {SAME}"
)
TRACE_MEASURES = tuple(
    replace(measure, types=WHEELS, definition=AT_LIMITS) if measure.name == "time_loss" else measure
    for measure in MEASURES
    if measure.name not in RUNS_ALONE
)
"""Of two traces. Time loss: FCD names no speed factors of vehicles."""
