"""Survival, contacts, standing and surfaces in worlds whose figures can be worked out by hand."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from builders import make_world

from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.metrics.counters import RunCounters
from slrl_sumo.metrics.outcomes import Outcomes, TypeOutcome, mean_survival, survival_counts
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.events import Decision, Started
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings

CAR, PEDESTRIAN = RoadUserType.CAR, RoadUserType.PEDESTRIAN


def world(users: Mapping[str, tuple[RoadUserType, float, float]]) -> WorldState:
    """Road users in a row, heading along +x: type, x (m) and speed (m/s) of each."""
    kind, x, speed = np.array(list(users.values()), np.float64).reshape(-1, 3).T
    return make_world(x, speed=speed, type=kind, ids=tuple(users), learned=False)


def walkers(*places: float) -> WorldState:
    return world({f"p{i}": (PEDESTRIAN, x, 1.0) for i, x in enumerate(places)})


def count(start: WorldState, *later: WorldState) -> tuple[TypeOutcome, ...]:
    """All counted, none off its surface."""
    outcomes = Outcomes(start, np.ones(len(start), np.bool_))
    for number, each in enumerate(later):
        none = np.zeros(len(each), np.bool_)
        outcomes.add(replace(each, time=0.4 * (number + 1)), ~none, none, none)
    return outcomes.per_type()


def test_paper_survival_ends_with_the_first_paper_collision_which_counts_for_both_when_it_begins() -> None:
    apart, close = walkers(0.0, 3.0, 50.0), walkers(0.0, 0.4, 50.0)
    (outcome,) = count(apart, apart, apart, close, close, apart, close, apart)
    assert outcome.type == "pedestrian"
    assert outcome.present == (7, 7, 7)
    assert outcome.paper_survived == (2, 2, 7)
    assert outcome.paper_collisions == 4
    # Their boxes are 0.2 m long: no collision.
    assert (outcome.collisions, outcome.succeeded) == (0, 3)


def test_boxes_that_overlap_in_motion_are_one_collision_and_no_paper_collision() -> None:
    apart, bumper = (world({"a": (CAR, 0.0, 1.0), "b": (CAR, x, 0.0)}) for x in (9.0, 4.9))
    (outcome,) = count(apart, bumper)
    assert (outcome.collisions, outcome.succeeded) == (1, 0)
    assert (outcome.paper_collisions, outcome.paper_survived) == (0, (1, 1))


def test_contacts_that_exist_when_a_road_user_appears_do_not_count() -> None:
    close, apart = walkers(0.0, 0.4), walkers(0.0, 3.0)
    (from_the_start,) = count(close, close, apart)
    assert (from_the_start.paper_survived, from_the_start.paper_collisions) == ((2, 2), 0)
    (appeared,) = count(walkers(0.0), close, close)
    assert (appeared.present, appeared.paper_survived, appeared.paper_collisions) == ((2, 2), (2, 2), 0)
    # It counts when it begins again.
    (again,) = count(walkers(0.0), close, apart, close)
    assert (again.paper_survived, again.paper_collisions) == ((2, 2), 2)


def test_only_requested_road_users_are_counted_and_all_can_be_hit() -> None:
    first, both = np.array([True, False]), np.array([True, True])
    outcomes = Outcomes(walkers(0.0, 3.0), first)
    outcomes.add(walkers(0.0, 0.4), first, both, ~both)
    outcomes.add(walkers(0.0, 0.1), first, ~both, both)
    (outcome,) = outcomes.per_type()
    assert (outcome.present, outcome.paper_survived, outcome.paper_collisions) == ((2,), (0,), 1)
    assert (outcome.off_surface, outcome.succeeded) == (1, 0)


def test_speeds_of_all_and_of_moving_road_users_are_added_up() -> None:
    speeds = (0.0, 0.09, 0.1, 8.0)
    start, *later = (world({"a": (CAR, 0.0, speed), "p": (PEDESTRIAN, 90.0, 1.0)}) for speed in (5.0, *speeds))
    car, walker = count(start, *later)
    assert car.speed_sum == pytest.approx(8.19)
    assert car.moving_speed_sum == pytest.approx(8.1)
    assert car.standing == 2
    assert (walker.type, walker.standing, walker.speed_sum, walker.steps) == ("pedestrian", 0, 4.0, 4)


def test_a_road_user_that_leaves_was_present_until_then() -> None:
    (outcome,) = count(walkers(0.0, 9.0), walkers(0.0, 9.0), walkers(0.0))
    assert outcome.present == outcome.paper_survived == (2, 1)


def test_unknown_surfaces_are_none() -> None:
    outcomes = Outcomes(walkers(0.0), np.array([True]))
    outcomes.add(walkers(0.0), np.array([True]), None, None)
    assert outcomes.per_type()[0].off_surface is None


def test_mean_survival_of_road_users_that_stay_is_the_plain_mean() -> None:
    survived = np.array([128.0, 0.0, 37.0, 128.0, 90.0])
    assert mean_survival(survival_counts(np.full(5, 128.0), survived, 128)) == pytest.approx(survived.mean())


def test_mean_survival_does_not_punish_leaving() -> None:
    present = np.array([10.0, 40.0, 128.0])
    assert mean_survival(survival_counts(present, present, 128)) == 128
    # Four at risk in decision 1, where one is hit; one leaves after it; of the other two one is hit in decision 3.
    present, survived = np.array([4.0, 1.0, 4.0, 4.0]), np.array([0.0, 1.0, 2.0, 4.0])
    assert mean_survival(survival_counts(present, survived, 4)) == pytest.approx(0.75 + 0.75 + 0.375 + 0.375)


def test_a_run_is_counted_as_its_summary_counts_it() -> None:
    counters = outcomes = None
    for event in run(RunSettings("intersection", agents=40, steps=60, seed=3, selector="prior")):
        if isinstance(event, Started):
            start = event.step.world
            counters, outcomes = RunCounters(start), Outcomes(start, start.learned)
        assert counters is not None
        assert outcomes is not None
        if isinstance(event, Decision):
            counters.add(event)
            all_users, n = event.steps[-1].world, len(event.surface)
            off_surface, left_surface = np.zeros((2, len(all_users)), np.bool_)
            off_surface[:n] = ~OWN_SURFACE[all_users.type[:n], event.surface]
            left_surface[:n] = event.left_surface
            outcomes.add(all_users, np.arange(len(all_users)) < n, off_surface, left_surface)
    assert outcomes is not None
    assert counters is not None
    ours, theirs = outcomes.per_type(), counters.per_type()
    assert [outcome.type for outcome in ours] == list(TYPE_NAMES)
    assert sum(outcome.collisions for outcome in ours) > 3
    for outcome in ours:
        assert {
            "count": len(outcome.present),
            "mean_speed_mps": round(outcome.speed_sum / outcome.steps, 4),
            "standing_share": round(outcome.standing / outcome.steps, 4),
            "collisions": outcome.collisions,
            "near_misses": outcome.near_misses,
            "success_rate": round(outcome.succeeded / len(outcome.present), 4),
            "off_surface_share": round((outcome.off_surface or 0) / outcome.steps, 4),
        } == pytest.approx({name: value for name, value in theirs[outcome.type].items() if name != "survival_steps"})
