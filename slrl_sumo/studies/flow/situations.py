"""The situations in which flow is measured: each a small network with its demand, or a whole network."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from slrl_sumo.studies.flow.scenarios.junctions import (
    crossing_roads,
    crosswalk,
    left_turns,
    queue,
    roundabout,
    two_lane_roundabout,
)
from slrl_sumo.studies.flow.scenarios.roads import (
    alone,
    bends,
    following,
    lane_drop,
    merge,
    motorway,
    overtaking,
    shared_path,
)
from slrl_sumo.studies.flow.scenarios.scenario_files import SPEED_LIMIT
from slrl_sumo.studies.flow.scenarios.towns import city, crossings, crowd, grid, town
from slrl_sumo.studies.flow.scenarios.wheel import game

BICYCLE_SPEED = 5.56
"""m/s: what SUMO's default bicycle wants to go, 20 km/h."""


@dataclass(frozen=True)
class TrafficCase:
    """A situation in which flow is measured."""

    about: str
    """What it measures, one line."""
    seconds: float
    """Simulated time, s."""
    build: Callable[[Path], Path]
    """Writes its files into a folder, which is there; returns the .sumocfg."""
    desired: float | None = None
    """m/s that each of its vehicles wants to go, where they are alone and all want the same."""
    network: bool = False
    """Whether it is a whole network, which takes minutes."""


def _town(about: str, seed: int, *, streets: int, seconds: float, period: float, mixed: bool = False) -> TrafficCase:
    build = town(seed, streets=streets, seconds=seconds, period=period, mixed=mixed)
    return TrafficCase(about, seconds, build, network=True)


SITUATIONS: dict[str, TrafficCase] = {
    "free-road": TrafficCase(
        "cars alone on a road of 1,200 m, that depart at 7 m/s, 10 m/s or their desired speed",
        300.0,
        alone("exact", 1200.0, 30.0, 300.0, ("7", "10", "max")),
        SPEED_LIMIT,
    ),
    "start-car": TrafficCase(
        "cars that start from a stand on an empty road", 240.0, alone("exact", 600.0, 20.0, 240.0, ("0",)), SPEED_LIMIT
    ),
    "start-bicycle": TrafficCase(
        "bicycles that start from a stand on an empty road",
        240.0,
        alone("rider", 300.0, 20.0, 240.0, ("0",)),
        BICYCLE_SPEED,
    ),
    "following": TrafficCase("a platoon behind a car that stops twice, on one lane", 240.0, following),
    "overtaking": TrafficCase("cars and bicycles on a street of two lanes", 300.0, overtaking),
    "shared-path": TrafficCase("bicycles and pedestrians on a path that they share", 300.0, shared_path),
    "bends": TrafficCase("a road with bends of 30, 60, 90, 110 and 130 degrees", 240.0, bends),
    "merge": TrafficCase(
        "a ramp with an acceleration lane of 200 m joins a road of one lane", 300.0, merge(900.0, 500.0)
    ),
    "merge-full": TrafficCase("the same with more demand than capacity", 300.0, merge(1300.0, 800.0)),
    "lane-drop": TrafficCase("a road of two lanes of which the right one ends", 300.0, lane_drop(1500.0)),
    "lane-drop-full": TrafficCase("the same with more demand than capacity", 300.0, lane_drop(2200.0)),
    "motorway": TrafficCase("a motorway for 33 m/s with ramps and a lane that ends", 300.0, motorway),
    "queue": TrafficCase("queues of 20 and more cars that discharge at a signal, two lanes", 405.0, queue),
    "signal": TrafficCase(
        "a signalised crossing with more demand than capacity, two lanes",
        300.0,
        crossing_roads("traffic_light", 2, dict.fromkeys("nesw", 1400.0), 300.0),
    ),
    "left-turns": TrafficCase("opposing left turns at a signal that gives both arms green", 300.0, left_turns),
    "priority": TrafficCase(
        "a crossing where traffic from two arms gives way",
        300.0,
        crossing_roads("priority", 1, {"e": 500.0, "w": 500.0, "n": 200.0, "s": 200.0}, 300.0),
    ),
    "all-way-stop": TrafficCase(
        "a crossing where all stop", 300.0, crossing_roads("allway_stop", 1, dict.fromkeys("nesw", 250.0), 300.0)
    ),
    "roundabout": TrafficCase("a roundabout with four arms of one lane", 300.0, roundabout),
    "two-lane-roundabout": TrafficCase(
        "a roundabout with four arms, two lanes on the ring and on the approaches", 300.0, two_lane_roundabout
    ),
    "crosswalk": TrafficCase("pedestrians cross a street between junctions", 240.0, crosswalk),
    "crowd": TrafficCase("a small junction with signals and a crowd of pedestrians", 400.0, crowd(101)),
    "town-small": _town("a generated town, 250 departures", 3, streets=40, seconds=600.0, period=1.2),
    "town-1": _town("a generated town, 1,000 departures", 1, streets=100, seconds=900.0, period=0.6),
    "town-2": _town(
        "a generated town with roundabouts, 750 cars, 150 bicycles and 150 pedestrians",
        2,
        streets=160,
        seconds=900.0,
        period=0.8,
        mixed=True,
    ),
    "turn-lanes": TrafficCase(
        "a generated grid of three lanes with lanes for turns and actuated signals, 546 departures",
        600.0,
        grid(4, seconds=600.0, period=0.55),
        network=True,
    ),
    "crossings": TrafficCase(
        "a generated grid of signals with crossings, 333 cars, 66 bicycles and 333 pedestrians",
        600.0,
        crossings(7, seconds=600.0, period=0.9),
        network=True,
    ),
    "city": TrafficCase(
        "the wheel's network of a part of Berlin, 600 departures", 600.0, city("DRT", 600.0, 0.5), network=True
    ),
    "fkk_in": TrafficCase(
        "the wheel's network of a junction in Ingolstadt", 300.0, game("fkk_in", 300.0), network=True
    ),
    "cross": TrafficCase("the wheel's crossing with much traffic", 300.0, game("cross", 300.0), network=True),
    "grid6": TrafficCase("the wheel's grid of signals", 300.0, game("grid6", 300.0), network=True),
    "A10KW": TrafficCase("the wheel's motorway junction", 400.0, game("A10KW", 400.0), network=True),
}
"""All situations by name, in the order of the table."""
