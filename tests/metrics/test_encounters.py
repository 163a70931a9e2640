"""Collisions and near misses, counted while road users move along given ways."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_levels, make_world

from slrl_sumo.metrics.encounters import ALL, EncounterCounts
from slrl_sumo.metrics.near_misses import find_conflicts
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.simulation.events import Decision, Started
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings

CAR, BICYCLE, PEDESTRIAN = RoadUserType


def count(
    *x: tuple[float, float], speed: float = 5.0, kinds: tuple[int, int] = (CAR, CAR), learned: object = True
) -> EncounterCounts:
    """Two road users one behind the other at `x` (m) after each decision; only the first one moves."""
    worlds = [
        make_world(at, speed=[speed, 0.0], type=kinds, ids=("a", "b"), learned=learned, time=DECISION_INTERVAL * number)
        for number, at in enumerate(x)
    ]
    counts = EncounterCounts(worlds[0])
    for world in worlds[1:]:
        counts.add(world, world.learned)
    return counts


def test_a_pair_of_two_learned_road_users_counts_once() -> None:
    counts = count((0.0, 20.0), (16.0, 20.0), (17.0, 20.0))
    assert counts.collisions.tolist() == [1, 0, 0, 1]
    assert counts.with_background.tolist() == [0, 0, 0, 0]


def test_a_pair_of_two_types_counts_for_both_and_once_for_all() -> None:
    counts = count((0.0, 20.0), (19.0, 20.0), kinds=(CAR, BICYCLE))
    assert counts.collisions.tolist() == [1, 1, 0, 1]


def test_a_background_road_user_counts_for_the_learned_one() -> None:
    counts = count((0.0, 20.0), (19.0, 20.0), kinds=(CAR, BICYCLE), learned=[True, False])
    assert counts.collisions.tolist() == counts.with_background.tolist() == [1, 0, 0, 1]
    assert count((0.0, 20.0), (19.0, 20.0), learned=False).collisions.tolist() == [0, 0, 0, 0]


def test_boxes_that_overlap_at_rest_collide_when_one_moves() -> None:
    assert count((15.2, 20.0), (15.3, 20.0), (15.4, 20.0), speed=0.05).collisions[ALL] == 0  # from the start on
    still = [make_world([x, 20.0], speed=0.0, ids=("a", "b"), time=0.4 * n) for n, x in enumerate((14.9, 15.1, 15.1))]
    counts = EncounterCounts(still[0])
    for world in still[1:]:
        counts.add(world, world.learned)
    assert counts.collisions[ALL] == 0
    counts.add(replace(still[2], time=1.2, speed=np.array([0.5, 0.0])), still[2].learned)
    assert counts.collisions[ALL] == 1


def test_a_contact_of_the_beginning_does_not_count_and_one_of_the_takeover_neither() -> None:
    assert count((18.0, 20.0), (18.5, 20.0)).collisions[ALL] == 0
    counts = EncounterCounts()
    for number, learned in enumerate((False, True, True)):
        world = make_world(
            [18.0 + number, 20.0], speed=2.0, ids=("a", "b"), learned=[learned, False], time=0.4 * number
        )
        counts.add(world, world.learned)
    assert counts.collisions[ALL] == 0


def test_the_same_two_collide_again_after_two_seconds_apart_only() -> None:
    hit, apart = (16.0, 20.0), (10.0, 20.0)
    assert count(apart, hit, apart, hit).collisions[ALL] == 1
    assert count(apart, hit, *[apart] * 5, hit).collisions[ALL] == 2


def test_a_near_miss_is_withdrawn_when_it_becomes_a_collision() -> None:
    near = (9.0, 20.0)  # 6 m apart at 5 m/s: 1.2 s
    assert count((0.0, 20.0), near, (9.5, 20.0)).near_misses.tolist() == [1, 0, 0, 1]
    counts = count((0.0, 20.0), near, (16.0, 20.0), (26.0, 20.0))
    assert (counts.near_misses[ALL], counts.collisions[ALL]) == (0, 1)
    # After a collision the same two have no near miss for 2 s.
    assert count((0.0, 20.0), (16.0, 20.0), near).near_misses[ALL] == 0
    assert count((0.0, 20.0), (16.0, 20.0), *[(-50.0, 20.0)] * 5, near).near_misses[ALL] == 1


def test_two_pedestrians_and_slow_approaches_are_no_near_misses() -> None:
    assert count((0.0, 20.0), (19.0, 20.0), speed=1.5, kinds=(PEDESTRIAN, PEDESTRIAN)).near_misses[ALL] == 0
    assert count((0.0, 20.0), (14.5, 20.0), speed=0.9).near_misses[ALL] == 0
    assert count((0.0, 20.0), (14.0, 20.0), speed=1.1).near_misses[ALL] == 1


def test_ended_encounters_are_forgotten() -> None:
    counts = EncounterCounts()
    for number in range(200):
        ids = (f"a{number // 2}", f"b{number // 2}")
        x = ([0.0, 20.0], [16.0, 20.0])[number % 2]
        world = make_world(x, speed=[5.0, 0.0], ids=ids, time=0.4 * number)
        counts.add(world, world.learned)
    assert counts.collisions[ALL] == 100
    assert len(counts._overlaps) < 50


@pytest.fixture(scope="module")
def worlds() -> list[WorldState]:
    """A run of learned road users that hit each other."""
    found = []
    for event in run(RunSettings("intersection", agents=48, steps=120, seed=5, selector="prior")):
        if isinstance(event, Started):
            found.append(replace(event.step.world, learned=np.ones(len(event.step.world), np.bool_)))
        elif isinstance(event, Decision):
            world = event.steps[-1].world
            found.append(replace(world, learned=np.ones(len(world), np.bool_)))
    return found


def test_a_run_counts_what_its_trace_shows(worlds: list[WorldState]) -> None:
    counts = EncounterCounts(worlds[0])
    for world in worlds[1:]:
        counts.add(world, world.learned)
    number: dict[str, int] = {}
    for world in worlds:
        for user in world.ids:
            number.setdefault(user, len(number))
    box = np.concatenate([np.column_stack([w.x, w.y, w.heading, w.length, w.width]) for w in worlds])
    conflicts = find_conflicts(
        box=box,
        speed=np.concatenate([w.speed for w in worlds]),
        kind=np.concatenate([w.type for w in worlds]),
        user=np.array([number[user] for w in worlds for user in w.ids]),
        frame=np.repeat(np.arange(len(worlds)), [len(w) for w in worlds]),
        times=np.array([w.time for w in worlds]),
    )
    kinds = [conflict.kind for conflict in conflicts]
    assert counts.collisions[ALL] == kinds.count("collision") > 10
    assert counts.near_misses[ALL] == kinds.count("near miss") > 10


def test_road_users_on_two_levels_neither_collide_nor_nearly_so() -> None:
    def counted(levels: Levels, heading: float) -> EncounterCounts:
        counts = EncounterCounts(levels=levels)
        for step in range(6):
            # Both come to the crossing at the same time, from 20 m before it.
            way = 4.0 * step - 20.0
            world = make_world(
                [way, way * np.cos(heading)], [0.0, way * np.sin(heading)],
                heading=[0.0, heading], speed=10.0, ids=("a", "b"), time=DECISION_INTERVAL * step,
            )  # fmt: skip
            counts.add(world, world.learned)
        return counts

    assert counted(FLAT, 0.5 * np.pi).collisions[ALL] == 1
    above = counted(make_levels(), 0.5 * np.pi)
    assert above.collisions[ALL] == above.near_misses[ALL] == 0
    # Opposite directions of one street share its level.
    assert counted(make_levels(), np.pi).collisions[ALL] == 1
