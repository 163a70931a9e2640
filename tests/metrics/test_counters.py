"""What is counted of a run, against decisions made by hand."""

from dataclasses import replace

import numpy as np
from builders import make_world

from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.metrics.counters import RunCounters
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.events import Decision, Step


def cars(ids: tuple[str, ...], x: list[float], speed: list[float], learned: list[bool]) -> WorldState:
    return make_world(x, speed=speed, ids=ids, length=4.0, width=2.0, learned=learned)


def decision(world: WorldState, surface: list[Surface]) -> Decision:
    n, learned = len(world), len(surface)
    places = Places(("car",) * n, ("",) * n, np.zeros(n), np.zeros(n, np.bool_))
    none = np.zeros(learned, np.bool_)
    return Decision(
        steps=(Step(1.0, world, places),), modes=None, constraints={"guard": 2}, surface=np.array(surface, np.uint8),
        left_surface=none, under_way=learned,
        wrapped_around=none, lost=none,
        arrived=(), taken_over=(), handed_back=(), returned_to_route=(), interventions=0,
    )  # fmt: skip


def test_encounters_survival_and_success() -> None:
    ids, learned = ("a", "b", "c", "sumo"), [True, True, True, False]
    counters = RunCounters(cars(ids, [0.0, 20.0, 90.0, 40.0], [5.0, 5.0, 5.0, 5.0], learned))
    road, off = Surface.ROAD, Surface.NONE
    worlds = (
        cars(ids, [0.0, 3.0, 90.0, 40.0], [5.0, 0.05, 4.0, 5.0], learned),  # a and b collide
        cars(ids, [0.0, 3.0, 90.0, 3.3], [7.0, 0.0, 4.0, 0.0], learned),  # a and b with SUMO's car
    )
    for number, world in enumerate(worlds):
        left = np.array([False, False, number == 1])
        made = decision(replace(world, time=0.4 * (number + 1)), [road, Surface.SIDEWALK, off])
        counters.add(replace(made, left_surface=left))
    car = counters.per_type()["car"]
    assert car == {
        "count": 3,
        "mean_speed_mps": round((5.0 + 0.05 + 4.0 + 7.0 + 0.0 + 4.0) / 6, 4),
        "standing_share": round(2 / 6, 4),
        "collisions": 2,  # b stands, and so does SUMO's car: they overlap without a collision
        "near_misses": 0,
        "survival_steps": round((0 + 0 + 2) / 3, 4),
        "success_rate": 0.0,  # c has left its surface
        "off_surface_share": round(4 / 6, 4),
    }
    assert counters.per_type()["bicycle"]["count"] == 0
    summary = counters.summary(2.0, 0.4)
    assert (summary["agent_steps"], summary["collisions"], summary["under_way"]) == (6, 2, 3)
    assert summary["constraints"] == {"guard": 2 * counters.decisions}


def test_road_users_that_come_and_go_are_counted_while_learned() -> None:
    names = tuple(f"u{i}" for i in range(200))
    apart = [10.0 * i for i in range(200)]
    counters = RunCounters(replace(cars((), [], [], []), time=0.0))
    for some in (slice(0, 200), slice(50, 150), slice(100, 101)):
        world = cars(names[some], apart[some], [2.0] * len(names[some]), [True] * len(names[some]))
        counters.add(decision(world, [Surface.ROAD] * len(world)))
    assert counters.per_type()["car"]["count"] == 200
    assert counters.per_type()["car"]["mean_speed_mps"] == 2.0
    assert counters.per_type()["car"]["survival_steps"] == 301 / 200
    assert counters.summary(1.0, 0.4)["agent_steps"] == 301
