"""Counts of background vehicles."""

from dataclasses import replace

import numpy as np
from builders import make_world

from benchmarks.background_traffic import BackgroundTraffic, Moment, markdown
from slrl_sumo.scene.state import WorldState

STEP = 0.4


def car(name: str, x: float, speed: float, *, learned: bool = False) -> WorldState:
    user = make_world(x, 0.0, 0.0, speed, type=0, ids=(name,))
    return replace(user, learned=np.array([learned]))


def count(speeds: list[float], *, held: bool = False, ahead: float | None = None) -> dict[str, float]:
    """The record of a background car at one place with these speeds, perhaps with a learned one `ahead` m of it."""
    traffic = BackgroundTraffic(STEP)
    for speed in speeds:
        world = car("background", 0.0, speed)
        if ahead is not None:
            world = world.join(car("learned", ahead, 0.0, learned=True))
        traffic.add(Moment(world, frozenset({"background"} if held else ())))
    return traffic.record()


def test_a_hard_brake_counts_once_when_it_begins() -> None:
    assert count([14.0, 12.2, 10.4])["hard_brakes"] == 0
    record = count([14.0, 11.0, 8.0, 8.0, 5.0], held=True, ahead=20.0)
    assert (record["hard_brakes"], record["hard_brakes_held"], record["hard_brakes_free"]) == (2, 2, 0)
    assert count([14.0, 11.0], ahead=-10.0)["hard_brakes_free"] == 1


def test_learned_cars_and_cars_just_handed_back_are_left_out() -> None:
    traffic = BackgroundTraffic(STEP)
    for learned, speed in ((True, 14.0), (False, 8.0), (False, 2.0)):
        traffic.add(Moment(car("one", 0.0, speed, learned=learned), frozenset()))
    assert traffic.record()["hard_brakes"] == 1
    assert traffic.vehicle_seconds == STEP


def test_long_standing_counts_while_held_and_has_a_cause_ahead_or_not() -> None:
    stand = [0.0] * 200
    assert count(stand)["held_standing"] == 0
    near, none = count(stand, held=True, ahead=6.0), count(stand, held=True, ahead=-6.0)
    assert near["held_standing"] == none["held_standing"] == 1
    assert near["longest_s"] == 80.0
    assert (near["without_cause_s"], none["without_cause_s"]) == (0.0, 20.0)


def test_the_table_ends_with_sums() -> None:
    row = count([14.0, 8.0]) | {
        "scenario": "a", "selector": "lane", "yields": True, "seed": 1, "vehicle_hours": 2.0, "overlaps": 1,
        "finished": 5,
    }  # fmt: skip
    lines = markdown([row, row | {"scenario": "b", "hard_brakes": 3}])
    assert len(lines) == 5
    assert lines[-1].startswith("| all | lane | True |  | 4.0 | 4 | 1.0 |")
