"""Trips as episodes, on a real SUMO: slots, ends, and what counts as reaching the destination."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.agent.mode_cost import CostWeights
from slrl_sumo.agent.rule_selector import RuleSelector
from slrl_sumo.learning.environments.arena import ArenaSettings
from slrl_sumo.learning.environments.simulation_env import SimulationVectorEnv
from slrl_sumo.learning.environments.source import ArenaSource
from slrl_sumo.learning.environments.trip_arena import TripArena, TripOutcome
from slrl_sumo.learning.rewards.terms import RewardWeights
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.netgen.families import generate
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.scenario import Scenario, find_scenario
from tests.builders import put_head_on

WEIGHTS = RewardWeights(**dict.fromkeys(("close", "moving", "alive", "danger", "speed", "wrong_way", "realism"), 0.0))
SETTINGS = ArenaSettings(agents=12, warm_up=20.0, weights=WEIGHTS, preset="extended", trips=True, image=False)


@pytest.fixture(scope="module")
def bundle() -> ModelBundle:
    return load_bundle("intersection")


@pytest.fixture(scope="module")
def crossing(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    return find_scenario(str(generate("intersection", 3, tmp_path_factory.mktemp("made") / "crossing")))


@pytest.fixture
def arena(bundle: ModelBundle, crossing: Scenario) -> Iterator[TripArena]:
    with TripArena(crossing, bundle, SETTINGS, 5) as arena:
        yield arena


def by_rule(arena: TripArena) -> np.ndarray:
    """The modes of the selector `rule`."""
    situation = arena.situation
    if situation is None:
        return np.zeros(0, np.int64)
    return RuleSelector().choose(situation.observation, situation.rollouts, None, list(situation.masks.values()))[-1]


def put(arena: TripArena, placed: WorldState) -> None:
    """Move the learned road users to where they are `placed`."""
    others = arena.simulation.world.take(np.arange(len(placed), len(arena.simulation.world)))
    arena.simulation.population.world = placed
    arena.simulation.world = placed.join(others)
    arena._look()


def test_a_road_user_keeps_its_slot_until_its_destination(arena: TripArena) -> None:
    slot_of: dict[str, int] = {}
    reached = 0
    for _ in range(120):
        ids = arena.simulation.population.world.ids
        assert len(ids) == len(arena.slots) <= 12
        assert len(set(arena.slots.tolist())) == len(ids)
        for road_user, slot in zip(ids, arena.slots.tolist(), strict=True):
            assert slot_of.setdefault(road_user, slot) == slot
        outcome = arena.step(by_rule(arena))
        assert not (outcome.terminated & outcome.truncated).any()
        np.testing.assert_array_equal(outcome.gone & ~outcome.terminated, outcome.truncated)
        assert (outcome.reached <= outcome.terminated).all()
        np.testing.assert_array_equal(outcome.terms["arrival"], outcome.reached)
        assert (outcome.reached <= outcome.gone).all()
        assert (outcome.clean <= outcome.reached).all()
        there = set(arena.simulation.population.world.ids)
        np.testing.assert_array_equal(outcome.gone, [road_user not in there for road_user in ids])
        reached += int(outcome.reached.sum())
    assert reached >= 3
    assert len(slot_of) > 12


def test_a_contact_ends_the_episode_and_the_road_user_goes_on_from_there(arena: TripArena) -> None:
    for _ in range(20):
        arena.step(by_rule(arena))
    users = arena.simulation.population.world
    placed, a, _ = put_head_on(users)
    put(arena, placed)
    outcome = arena.step(np.zeros(len(users), np.int64))
    assert outcome.terminated[a]
    assert outcome.terms["contact"][a] == -1
    assert not outcome.gone[a]
    after = arena.simulation.population.world
    row = after.ids.index(users.ids[a])
    assert np.hypot(after.x[row] - placed.x[a], after.y[row] - placed.y[a]) < 5.0
    assert arena._steps[users.ids[a]] == 0


def test_only_terms_with_a_weight_are_computed(arena: TripArena) -> None:
    outcome = arena.step(by_rule(arena))
    assert set(outcome.terms) == {
        "off_surface", "contact", "lost", "comfort", "progress", "off_path", "red", "priority", "arrival",
    }  # fmt: skip


@pytest.mark.parametrize("extended", [False, True])
def test_the_teacher_knows_what_the_selector_knows(bundle: ModelBundle, crossing: Scenario, extended: bool) -> None:
    """A training of the preset `paper` in trips ended here: its teacher asked for routes that it does not see."""
    settings = replace(SETTINGS, teacher=CostWeights(), preset="extended" if extended else "paper")
    with TripArena(crossing, bundle, settings, 5) as arena:
        costs, n = arena.teacher_costs(), len(arena.slots)
        assert costs.shape == (n, 20)
        assert (np.ptp(costs, axis=1) > 0.0).all()
        assert arena.situation is not None
        assert arena.situation.rollouts is not None
        assert (arena.situation.rollouts.route is not None) == extended
        assert len(arena.step(np.zeros(n, np.int64)).slots) == n > 0


def test_same_seed_same_trips(bundle: ModelBundle, crossing: Scenario) -> None:
    def play(seed: int) -> list[TripOutcome]:
        with TripArena(crossing, bundle, SETTINGS, seed) as arena:
            return [arena.step(by_rule(arena)) for _ in range(25)]

    first, again, other = play(7), play(7), play(8)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.reward, b.reward)
        np.testing.assert_array_equal(a.slots, b.slots)
    assert any(len(a.slots) != len(c.slots) for a, c in zip(first, other, strict=True))


def test_the_vector_environment_has_empty_slots_and_observations_in_its_space(crossing: Scenario) -> None:
    env = SimulationVectorEnv(ArenaSource((str(crossing.config),), "intersection", SETTINGS))
    try:
        seen, infos = env.reset(seed=4)
        assert env.observation_space.contains(seen)
        assert infos["teacher_costs"].shape == (12, 20)
        empty = seen["active"] == 0
        assert empty.any()
        assert not seen["vector"][empty].any()
        assert seen["action_mask"][empty].all()
        for _ in range(20):
            before = seen
            modes = seen["action_mask"].argmax(1)
            seen, reward, terminated, truncated, infos = env.step(modes)
            assert env.observation_space.contains(seen)
            ended = terminated | truncated
            assert not ended[before["active"] == 0].any()
            assert not reward[before["active"] == 0].any()
            np.testing.assert_array_equal(infos["_final_obs"], ended)
            np.testing.assert_array_equal(infos["final_obs"]["vector"][ended], before["vector"][ended])
    finally:
        env.close()


def test_a_scenario_without_demand_is_refused(tmp_path: Path, bundle: ModelBundle) -> None:
    from slrl_sumo.errors import SumoError
    from slrl_sumo.learning.environments import trip_arena

    folder = generate("intersection", 3, tmp_path / "made").parent
    (folder / "made.rou.xml").write_text("<routes/>")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trip_arena, "EMPTY", 3)
        env = SimulationVectorEnv(ArenaSource((str(folder),), "intersection", SETTINGS))
        with pytest.raises(SumoError, match="no road users that can be learned"):
            env.reset(seed=1)
        env.close()


def test_one_that_stands_is_in_contact_without_fault(arena: TripArena) -> None:
    """Its episode goes on, but its trip is not clean."""
    for _ in range(20):
        arena.step(by_rule(arena))
    users = arena.simulation.population.world
    placed, a, b = put_head_on(users)
    placed.speed[b] = 0.0
    placed.x[b], placed.y[b] = (0.9 * values[b] + 0.1 * values[a] for values in (placed.x, placed.y))
    put(arena, placed)
    assert arena.situation is not None
    assert arena.situation.rollouts is not None
    modes = arena.situation.rollouts.acceleration.argmax(axis=1)
    modes[b] = arena.situation.rollouts.acceleration[b].argmin()
    outcome = arena.step(modes)
    assert outcome.contact[[a, b]].all()
    assert outcome.terms["contact"][[a, b]].tolist() == [-1.0, 0.0]
    assert outcome.terminated[[a, b]].tolist() == [True, False]
    assert {users.ids[a], users.ids[b]} <= arena._unclean
