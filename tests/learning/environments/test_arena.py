"""The arena on a real SUMO: rewards, ends of episodes, new starts."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from slrl_sumo.agent.decide import choose
from slrl_sumo.agent.make_driver import make_selector
from slrl_sumo.agent.mode_cost import CostWeights
from slrl_sumo.agent.selectors import PriorSelector
from slrl_sumo.learning.environments.arena import Arena, ArenaSettings
from slrl_sumo.learning.rewards.terms import TERMS, RewardWeights, weighted
from slrl_sumo.learning.rewards.transition import lanes_here, recorded_speed
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.perception.route_features import ROUTE_FEATURES
from slrl_sumo.scene.route import HERE, POINTS, SPACING, RouteAhead
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.scenario import find_scenario
from tests.builders import put_head_on

SETTINGS = ArenaSettings(agents=24, warm_up=8.0, episode_steps=12)


@pytest.fixture(scope="module")
def bundle() -> ModelBundle:
    return load_bundle("intersection")


@pytest.fixture
def arena(bundle: ModelBundle) -> Iterator[Arena]:
    with Arena(find_scenario("intersection"), bundle, SETTINGS, 3) as arena:
        yield arena


def test_traffic_is_there_from_the_start(arena: Arena) -> None:
    assert arena.world.learned.sum() == 24
    assert len(arena.world) > 24
    image = arena.situation.observation.image
    assert image is not None
    assert image.shape == (24, 20, 40, 3)


def test_episodes_end_and_begin_anew(arena: Arena, bundle: ModelBundle) -> None:
    selector = make_selector("prior", bundle, 1)
    age = np.zeros(24, int)
    ended = 0
    for _ in range(30):
        before = arena.world
        outcome = arena.step(choose(arena.situation, selector)[0])
        age += 1
        np.testing.assert_array_equal(outcome.steps, age)
        over = outcome.terminated | outcome.truncated
        assert not (outcome.terminated & outcome.truncated).any()
        np.testing.assert_array_equal(outcome.truncated, (age >= 12) & ~outcome.terminated)
        if over.any():
            assert outcome.final is not None
            assert len(outcome.final.scene) == over.sum()
            # Whose episode begins stands elsewhere, under way and free of others.
            now = arena.world
            moved = np.hypot(now.x[:24] - before.x[:24], now.y[:24] - before.y[:24])
            assert np.median(moved[over]) > 10.0
            assert (now.speed[:24][over] > 0).all()
            np.testing.assert_array_equal(outcome.final.observation.type, now.type[:24][over])
        else:
            assert outcome.final is None
        age[over] = 0
        ended += over.sum()
        np.testing.assert_allclose(outcome.reward, weighted(outcome.terms, SETTINGS.weights))
        np.testing.assert_array_equal(outcome.terminated, (outcome.terms["contact"] + outcome.terms["lost"]) < 0)
    assert ended >= 24


def test_a_head_on_meeting_ends_in_contact_for_both(arena: Arena) -> None:
    users = arena.simulation.population.world
    placed, a, b = put_head_on(users)
    others = arena.world.take(np.arange(24, len(arena.world)))
    arena.simulation.population.world = placed
    arena.simulation.world = placed.join(others)
    arena.consider()
    outcome = arena.step(np.zeros(24, np.int64))
    assert outcome.terminated[[a, b]].all()
    assert (outcome.terms["contact"][[a, b]] == -1).all()


def test_realism_is_that_of_the_prior(arena: Arena) -> None:
    arena.step(np.zeros(24, np.int64))
    seen = arena.situation.observation
    (best,) = PriorSelector(arena.bundle, np.random.default_rng(1).random, sample=False).choose(seen)
    likely = arena.step(best).terms["realism"]
    assert set(arena.step(best).terms) == set(TERMS)
    worst = np.array([int(arena.bundle.mode_counts[kind].argmin()) for kind in seen.type])
    assert likely.mean() > arena.step(worst).terms["realism"].mean() + 0.2


def test_same_seed_same_episodes(bundle: ModelBundle) -> None:
    def play(seed: int) -> list[np.ndarray]:
        with Arena(find_scenario("shared-space"), bundle, SETTINGS, seed) as arena:
            modes = np.random.default_rng(5).integers(0, 20, (20, 24))
            return [arena.step(row).reward for row in modes]

    first, again, other = play(7), play(7), play(8)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_weights_and_desired_speed_are_settings(bundle: ModelBundle) -> None:
    only_speed = RewardWeights(**dict.fromkeys(TERMS, 0.0) | {"speed": 2.0})
    settings = replace(SETTINGS, weights=only_speed, desired_speed=(1e-6, 1e-6, 1e-6))
    with Arena(find_scenario("intersection"), bundle, settings, 3) as arena:
        outcome = arena.step(np.zeros(24, np.int64))
    np.testing.assert_allclose(outcome.reward, 2.0 * outcome.terms["speed"])
    assert (outcome.terms["speed"][outcome.speed > 0.2] == -1).all()


def test_lanes_have_directions_for_vehicles_only(arena: Arena) -> None:
    users = arena.simulation.population.world
    heading, limit, on_lane = lanes_here(users, arena.simulation.points)
    vehicles = users.type != RoadUserType.PEDESTRIAN
    assert on_lane[vehicles].mean() > 0.9
    assert not on_lane[~vehicles].any()
    # At the start they go along their lane.
    np.testing.assert_allclose(np.cos(heading - users.heading)[vehicles & on_lane], 1.0, atol=0.01)
    np.testing.assert_allclose(limit[users.type == RoadUserType.CAR], 13.89)


def test_recorded_speed_is_plausible_for_each_type(bundle: ModelBundle) -> None:
    car, bicycle, pedestrian = recorded_speed(bundle)
    assert 4.0 < car < 12.0  # with motorways
    assert 3.0 < bicycle < 6.0
    assert 1.0 < pedestrian < 1.5


def test_the_teacher_holds_collisions_against_modes(bundle: ModelBundle) -> None:
    with Arena(find_scenario("intersection"), bundle, SETTINGS, 3) as arena:
        assert not arena.teacher_costs().any()
    weights = CostWeights(collision=7.0, off_surface=0.0, speed=0.0, lane=0.0)
    with Arena(find_scenario("intersection"), bundle, replace(SETTINGS, teacher=weights), 3) as arena:
        for _ in range(5):
            arena.step(np.zeros(24, np.int64))
        assert arena.situation.rollouts is not None
        np.testing.assert_allclose(arena.teacher_costs(), 7.0 * arena.situation.rollouts.collision, atol=1e-5)
        assert arena.teacher_costs().max() > 0
    wanted = replace(weights, collision=0.0, speed=1.0)
    with Arena(find_scenario("intersection"), bundle, replace(SETTINGS, teacher=wanted), 3) as arena:
        cost, rollouts = arena.teacher_costs(), arena.situation.rollouts
        assert rollouts is not None
        cars = np.flatnonzero(arena.world.type[:24] == RoadUserType.CAR)
        desired = min(recorded_speed(bundle)[0], 13.89)
        expected = np.abs(rollouts.speed[cars] - desired) / desired
        np.testing.assert_allclose(cost[cars], expected, atol=1e-5)


EXTENDED = ArenaSettings(agents=16, warm_up=8.0, episode_steps=200, preset="extended", teacher=CostWeights())


@pytest.fixture
def on_routes(bundle: ModelBundle) -> Iterator[Arena]:
    with Arena(find_scenario("signalised"), bundle, EXTENDED, 3) as arena:
        yield arena


def test_extended_road_users_see_their_route_and_where_modes_lead_on_it(on_routes: Arena) -> None:
    kind = on_routes.world.type[:16]
    driving = kind != RoadUserType.PEDESTRIAN
    for _ in range(2):
        seen, rollouts = on_routes.situation.observation, on_routes.situation.rollouts
        assert seen.route is not None
        assert rollouts is not None
        assert rollouts.route is not None
        assert seen.image is not None
        assert seen.route.shape == (16, len(ROUTE_FEATURES))
        assert rollouts.collision.shape == rollouts.route.stop_ratio.shape == (16, 20)
        assert (seen.route[driving, 0] == 1.0).all()
        # The path ahead is in the image: magenta, which nothing else is.
        magenta = (seen.image == [255, 0, 255]).all(axis=3).any(axis=(1, 2))
        assert magenta[driving].mean() > 0.8
        outcome = on_routes.step(np.zeros(16, np.int64))
        assert set(outcome.terms) == set(TERMS)
        assert (outcome.terms["progress"][driving] != 0.0).any()
    assert (outcome.terms["off_path"] <= 0.0).all()
    np.testing.assert_allclose(outcome.reward, weighted(outcome.terms, EXTENDED.weights))


def test_without_routes_there_is_nothing_to_be_seen_or_earned_on_them(arena: Arena) -> None:
    assert arena.situation.observation.route is None
    assert arena.situation.context is None
    assert arena.situation.rollouts is not None
    assert arena.situation.rollouts.route is None
    terms = arena.step(np.zeros(24, np.int64)).terms
    for name in ("progress", "excess", "off_path", "red", "priority"):
        assert not terms[name].any()


def _put(arena: Arena, row: int, before_line: float) -> RouteAhead:
    """Put the road user of a slot `before_line` m before its line, at 6 m/s; returns its route from there."""
    context = arena.situation.context
    assert context is not None
    users, route = arena.simulation.population.world, context.route.take(np.array([row]))
    place = (route.line[0] - before_line) / SPACING + HERE
    x, y = (np.interp(place, np.arange(POINTS), column[0]) for column in (route.x, route.y))
    piece = int(place)
    heading = np.arctan2(route.y[0, piece + 1] - route.y[0, piece], route.x[0, piece + 1] - route.x[0, piece])
    for name, value in {"x": x, "y": y, "heading": heading, "speed": np.array(6.0)}.items():
        column = getattr(users, name).copy()
        column[row] = value.item()
        users = replace(users, **{name: column})
    arena.simulation.population.world = users
    arena.simulation.world = users.join(arena.world.take(np.arange(len(users), len(arena.world))))
    arena.driver.forget((users.ids[row],))  # no vehicle drives so far at once
    arena.consider()
    assert arena.situation.context is not None
    return arena.situation.context.route.take(np.array([row]))


def _waits(arena: Arena) -> int | None:
    """The slot of a vehicle with a red light not far ahead, if there is one."""
    assert arena.situation.context is not None
    route, driving = arena.situation.context.route, arena.world.type[:16] != RoadUserType.PEDESTRIAN
    rows = np.flatnonzero(
        driving & route.stop_at_signal & (route.signal == 3) & (route.line > 4.0) & (route.line < 30.0)
    )
    return int(rows[0]) if len(rows) else None


def test_only_the_one_that_drives_over_a_closed_line_pays_for_it(on_routes: Arena) -> None:
    for _ in range(150):
        # The teacher runs no red light.
        assert not on_routes.step(on_routes.teacher_costs().argmin(axis=1)).terms["red"].any()
        row = _waits(on_routes)
        if row is not None:
            break
    assert row is not None
    for before, expected in ((4.5, 0.0), (1.0, -1.0)):
        route = _put(on_routes, row, before)
        assert route.stop_at_signal.all()
        assert route.line[0] == pytest.approx(before, abs=0.5)
        modes = on_routes.teacher_costs().argmin(axis=1)
        assert on_routes.situation.rollouts is not None
        modes[row] = int(on_routes.situation.rollouts.speed[row].argmax())
        terms = on_routes.step(modes).terms
        assert terms["red"][row] == expected
        assert not np.delete(terms["red"], row).any()
    # Going over it is one run, not one in every decision after it.
    assert on_routes.step(on_routes.teacher_costs().argmin(axis=1)).terms["red"][row] == 0.0


def test_the_teacher_goes_along_the_path_and_the_prior_does_not(bundle: ModelBundle) -> None:
    def play(taught: bool) -> tuple[float, float]:
        """Mean distance of vehicles from their path (m), and mean progress."""
        aside, progress = [], []
        with Arena(find_scenario("signalised"), bundle, EXTENDED, 3) as arena:
            prior = make_selector("prior", bundle, 1)
            driving = arena.world.type[:16] != RoadUserType.PEDESTRIAN
            for _ in range(40):
                modes = (
                    arena.teacher_costs().argmin(axis=1)
                    if taught
                    else choose(arena.situation, prior, arena.world.ids[:16])[0]
                )
                terms = arena.step(modes).terms
                route = arena.situation.observation.route
                assert route is not None
                aside.append(np.abs(route[driving, ROUTE_FEATURES.index("lateral_offset")]).mean())
                progress.append(terms["progress"][driving].mean())
        return float(np.mean(aside)), float(np.mean(progress))

    (taught, forward), (untaught, less) = play(True), play(False)
    assert taught < 0.5 * untaught
    assert taught < 0.6
    assert forward > less
