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
        wrapped_around=none, lost=none,
        arrived=(), taken_over=(), handed_back=(), returned_to_route=(), interventions=0,
    )  # fmt: skip


def test_contacts_count_once_when_they_begin_for_each_learned_road_user_in_them() -> None:
    ids, learned = ("a", "b", "sumo"), [True, True, False]
    tally = RunCounters(cars(ids, [0.0, 20.0, 40.0], [5.0, 5.0, 5.0], learned))
    tally.add(decision(cars(ids, [0.0, 3.0, 40.0], [5.0, 0.05, 5.0], learned), [Surface.ROAD, Surface.SIDEWALK]))
    tally.add(decision(cars(ids, [0.0, 3.0, 3.3], [7.0, 0.0, 0.0], learned), [Surface.ROAD, Surface.NONE]))
    car = tally.per_type()["car"]
    assert car == {
        "count": 2,
        "mean_speed_mps": round((5.0 + 0.05 + 7.0 + 0.0) / 4, 4),
        "standing_share": 0.5,
        # b and SUMO's car, 0.3 m apart, in the second decision.
        "collisions": 1,
        # a and b in the first one; both with SUMO's car in the second one.
        "overlaps": 4,
        "survival_steps": 1.5,
        "success_rate": 0.5,
        "off_surface_share": 0.5,
    }
    assert tally.per_type()["bicycle"]["count"] == 0
    assert tally.summary(2.0, 0.4)["agent_steps"] == 4
    assert tally.summary(2.0, 0.4)["constraints"] == {"guard": 2 * tally.decisions}


def test_road_users_that_come_and_go_are_counted_while_learned() -> None:
    names = tuple(f"u{i}" for i in range(200))
    apart = [10.0 * i for i in range(200)]
    tally = RunCounters(replace(cars((), [], [], []), time=0.0))
    for some in (slice(0, 200), slice(50, 150), slice(100, 101)):
        world = cars(names[some], apart[some], [2.0] * len(names[some]), [True] * len(names[some]))
        tally.add(decision(world, [Surface.ROAD] * len(world)))
    assert tally.per_type()["car"]["count"] == 200
    assert tally.per_type()["car"]["mean_speed_mps"] == 2.0
    assert tally.per_type()["car"]["survival_steps"] == 301 / 200
    assert tally.summary(1.0, 0.4)["agent_steps"] == 301
