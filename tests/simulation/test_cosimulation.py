"""The loop in this process: what each decision says, step by step."""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest
from conftest import Cli
from numpy.typing import NDArray

from slrl_sumo.agent.driver import Moved
from slrl_sumo.errors import InputError
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.events import Decision, Started
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.simulation.takeover import Takeover, fast_lanes
from slrl_sumo.sumo.refusals import Refusals
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

SETTINGS = RunSettings("intersection", agents=15, steps=30, seed=4, step_length=0.1)


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    assert not libsumo.isLoaded()


def play(settings: RunSettings) -> tuple[Any, list[Any]]:
    started, *decisions = run(settings)
    return started, decisions


def test_states_between_decisions_lie_on_a_line_and_turn_evenly() -> None:
    started, decisions = play(SETTINGS)
    assert (started.step_length, started.decisions, len(decisions)) == (0.1, 30, 30)
    before = started.step.world
    for decision in decisions:
        assert len(decision.steps) == 4
        after = decision.steps[-1].world
        stay = ~decision.wrapped_around
        turn = wrap_angle(after.heading[:15] - before.heading[:15])
        for k, step in enumerate(decision.steps, start=1):
            for name in ("x", "y"):
                begin, end = getattr(before, name)[:15], getattr(after, name)[:15]
                now = getattr(step.world, name)[:15]
                assert np.abs(now - begin - k / 4 * (end - begin))[stay].max() < 1e-9
                assert np.array_equal(now[~stay], end[~stay])
            heading = wrap_angle(step.world.heading[:15] - before.heading[:15] - k / 4 * turn)
            assert np.abs(heading)[stay].max() < 1e-9
        before = after


def test_worlds_hold_the_learned_first_and_time_goes_on_in_steps() -> None:
    started, decisions = play(SETTINGS)
    ids = started.step.world.ids[:15]
    assert all(i.startswith("learned_") for i in ids)
    times = [started.step.time]
    for decision in decisions:
        assert decision.modes.shape == decision.surface.shape == decision.wrapped_around.shape == (15,)
        assert ((decision.modes >= 0) & (decision.modes < 20)).all()
        assert not decision.lost.any()
        for step in decision.steps:
            assert step.world.ids[:15] == ids
            assert step.world.learned.tolist() == [True] * 15 + [False] * (len(step.world) - 15)
            assert len(set(step.world.ids)) == len(step.world)
            assert len(step.places.lane) == len(step.places.sumo_type) == len(step.world)
            times.append(step.time)
    assert times[0] == 0.0
    assert np.allclose(np.diff(times), 0.1)
    assert len(decisions[-1].steps[-1].world) > 15


def test_sumo_sees_all_road_users_where_the_trace_has_them() -> None:
    events = run(replace(SETTINGS, step_length=0.4))
    next(events)
    seen = 0
    for decision in events:
        world = decision.steps[-1].world
        for row, road_user in enumerate(world.ids[:15]):
            domain = libsumo.person if "pedestrian" in road_user else libsumo.vehicle
            front = domain.getPosition(road_user)
            half = 0.5 * world.length[row]
            asked = (world.x[row] + half * np.cos(world.heading[row]), world.y[row] + half * np.sin(world.heading[row]))
            assert np.hypot(front[0] - asked[0], front[1] - asked[1]) < 0.01
            seen += 1
    assert seen == 450


@pytest.mark.parametrize("road_user", ["learned_car.0", "learned_pedestrian.0"])
@pytest.mark.parametrize("substep", [1, 2, 3, 4])
def test_a_road_user_that_sumo_drops_is_counted_and_comes_back(
    monkeypatch: pytest.MonkeyPatch, road_user: str, substep: int
) -> None:
    """SUMO takes a road user out by itself, in any of the steps between two decisions."""
    step, count = SumoSession.step, 0
    domain = libsumo.person if "pedestrian" in road_user else libsumo.vehicle

    def dropping(self: SumoSession) -> None:
        nonlocal count
        count += 1
        if count == 1 + 4 * 5 + substep:  # in the sixth decision
            domain.unsubscribe(road_user)
            domain.remove(road_user)
        step(self)

    monkeypatch.setattr(SumoSession, "step", dropping)
    started, decisions = play(replace(SETTINGS, steps=12))
    lost = np.array([decision.lost for decision in decisions])
    row = started.step.world.ids.index(road_user)
    assert lost.sum() == lost[5, row] == 1
    for decision in decisions:
        for state in decision.steps:
            assert state.world.ids[row] == road_user
    # Back on the network, where the trace has it.
    assert decisions[-1].steps[-1].places.sumo_type[row] == road_user.split(".")[0]


def test_those_handed_back_arrive_later_or_are_under_way() -> None:
    taken: set[str] = set()
    learned: set[str] = set()
    lost, arrived, at_hand_back = 0, [], set()
    settings = RunSettings(
        "intersection",
        takeover="car=1,pedestrian=1",
        region="junction:centre,radius=25",
        steps=300,
        seed=2,
        selector="prior",
    )
    for event in run(settings):
        if isinstance(event, Decision):
            taken.update(event.taken_over)
            learned.update(event.steps[-1].world.ids[: len(event.surface)])
            at_hand_back.update(event.handed_back)
            lost += int(event.lost.sum())
            arrived += event.arrived
            under_way = event.under_way
    assert len(arrived) == len(set(arrived))
    assert taken.issuperset(arrived)
    assert len(at_hand_back.intersection(arrived)) > 5
    assert len(taken) == len(arrived) + under_way + lost
    assert taken.issuperset(learned)


def test_leaving_a_run_early_closes_sumo() -> None:
    events = run(SETTINGS)
    next(events)
    next(events)
    assert libsumo.isLoaded()
    events.close()
    assert not libsumo.isLoaded()


def test_the_scenarios_end_or_until_decides_the_length() -> None:
    for settings, decisions in (
        (RunSettings("intersection", agents=2), 1500),
        (RunSettings("intersection", agents=2, until=4.1), 11),
        (RunSettings("intersection", agents=2, until=4.0), 10),
        (RunSettings("intersection", agents=2, steps=7), 7),
    ):
        events = run(settings)
        assert next(events).decisions == decisions
        events.close()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"agents": 0}, "--agents 0"),
        ({"agents": 10**20}, "--agents 1"),
        ({"agents": 4000}, "fit into this network"),
        ({"steps": 0}, "--steps 0"),
        ({"steps": None, "until": -1.0}, "--until -1"),
        ({"steps": None, "until": float("nan")}, "--until nan"),
        ({"steps": None, "until": float("inf")}, "--until inf"),
        ({"seed": 2**31}, "--seed 2147483648"),
        ({"selector": "oracle"}, "--selector oracle"),
        ({"bundle": "none such"}, "none such"),
        ({"mix": "car=,"}, "--mix"),
        ({"step_length": 0.3}, r"--step-length 0\.3"),
        ({"scenario": "nowhere"}, "nowhere"),
    ],
)
def test_wrong_settings_are_refused_in_one_line(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        next(run(replace(SETTINGS, **changes)))
    assert re.search(words, caught.value.as_options())
    assert "\n" not in str(caught.value)


class _Straight:
    """A driver whose road users go straight on at 10 m/s, and can do no more."""

    max_speed = np.full(3, 10.0)
    hardest_braking = np.full(3, -np.inf)
    has_models = True
    refusals = Refusals()

    def drive(self, world: WorldState, n: int, road_map: RoadMap) -> Moved:
        ahead, learned = 10.0 * DECISION_INTERVAL, world.take(np.arange(n))
        x, y = learned.x + ahead * np.cos(learned.heading), learned.y + ahead * np.sin(learned.heading)
        return Moved(replace(learned, x=x, y=y, speed=np.full(n, 10.0)), None, {})

    def cannot_follow(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        return np.zeros(len(ids), np.bool_)

    def near_end(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        return np.zeros(len(ids), np.bool_)

    def off_route(self, ids: tuple[str, ...]) -> NDArray[np.bool_]:
        return np.zeros(len(ids), np.bool_)

    def forget(self, ids: tuple[str, ...]) -> None:
        pass


@pytest.fixture
def into_the_fast_lane(bare_network: Callable[[str], Path]) -> Path:
    """A road of 100 m for 10 m/s, and one of 100 m for 30 m/s after it; a car on each, which goes to the end."""
    config = bare_network(
        '<edge id="slow" from="a" to="b" numLanes="1" speed="10"/>'
        '<edge id="fast" from="b" to="c" numLanes="1" speed="30"/>'
    )
    config.with_name("bare.rou.xml").write_text(
        '<routes><vType id="car" vClass="passenger" speedFactor="1" sigma="0"/>'
        '<route id="whole" edges="slow fast"/><route id="end" edges="fast"/>'
        '<vehicle id="comes" type="car" route="whole" depart="0" departPos="20" departSpeed="10"/>'
        '<vehicle id="there" type="car" route="end" depart="0" departPos="10" departSpeed="0"/></routes>'
    )
    text = config.read_text().replace("<end ", '<route-files value="bare.rou.xml"/><end ')
    config.write_text(text)
    return config


def test_no_road_user_is_learned_where_all_others_would_have_to_wait(into_the_fast_lane: Path) -> None:
    with SumoSession(find_scenario(str(into_the_fast_lane)), seed=1) as session:
        driver = _Straight()
        # Junctions are not lanes to drive on, and a fifth more than it can do is tolerable.
        assert fast_lanes(session.network, driver.max_speed) == {"fast_0"}
        driver.max_speed = np.array([25.5, 0.0, 0.0])
        assert fast_lanes(session.network, driver.max_speed) == frozenset()
        driver.max_speed = np.array([24.5, 99.0, 99.0])
        assert fast_lanes(session.network, driver.max_speed) == {"fast_0"}
        driver.max_speed = np.full(3, 10.0)
        rule = Takeover(np.ones(3), parse_region(None, session.network), 1)
        cosimulation = CoSimulation(session, driver, takeover=rule)
        cosimulation.start()
        taken, back = set(cosimulation.population.ids), []
        for _ in range(35):
            decision = cosimulation.decide()
            taken.update(decision.taken_over)
            for road_user in decision.handed_back:
                back.append((road_user, libsumo.vehicle.getLaneID(road_user)))
            assert not any(decision.lost)
            assert not decision.returned_to_route
            on_fast = {v for v in cosimulation.population.ids if libsumo.vehicle.getLaneID(v) == "fast_0"}
            assert not on_fast
        assert taken == {"comes"}
        assert back == [("comes", "fast_0")]
        assert libsumo.vehicle.getIDCount() == 0 or libsumo.vehicle.getSpeed("comes") > 12.0


def test_a_run_says_which_lanes_are_too_fast(into_the_fast_lane: Path) -> None:
    slow = "intersection-paper"
    settings = RunSettings(str(into_the_fast_lane), takeover="car=1", steps=2, selector="prior", bundle=slow)

    def notices(settings: RunSettings) -> list[str]:
        started, *_ = run(settings)
        assert isinstance(started, Started)
        return [notice for notice in started.notices if "SUMO's" in notice]

    (notice,) = notices(settings)
    assert notice.startswith("1 lane")
    assert f"{load_bundle(slow).max_speed[0]:.1f} m/s)" in notice
    # The lane follower drives as fast as lanes allow, and spawning road users says nothing about the others.
    assert not notices(replace(settings, selector="lane"))
    assert not notices(replace(settings, takeover=None, agents=1, mix="car=1"))
    file = into_the_fast_lane.with_name("bare.net.xml")
    file.write_text(file.read_text().replace('speed="30.00"', 'speed="13.00"'))
    assert not notices(settings)


@pytest.fixture
def mixed_traffic(into_the_fast_lane: Path) -> Path:
    """On the same roads two cars, a bus, a motorcycle, a car that stops, and a car on the fast road."""
    into_the_fast_lane.with_name("bare.rou.xml").write_text(
        '<routes><vType id="car" vClass="passenger"/><vType id="bus" vClass="bus"/>'
        '<vType id="motorcycle" vClass="motorcycle"/><vType id="van" vClass="passenger" length="6.5"/>'
        '<route id="whole" edges="slow fast"/><route id="end" edges="fast"/>'
        '<vehicle id="there" type="car" route="end" depart="0" departPos="10"/>'
        '<vehicle id="car.0" type="car" route="whole" depart="0" departPos="90"/>'
        '<vehicle id="bus.0" type="bus" route="whole" depart="0" departPos="75"/>'
        '<vehicle id="motorcycle.0" type="motorcycle" route="whole" depart="0" departPos="55"/>'
        '<vehicle id="van.0" type="van" route="whole" depart="0" departPos="45"/>'
        '<vehicle id="stops" type="car" route="whole" depart="0" departPos="30">'
        '<stop lane="slow_0" endPos="60" duration="99"/></vehicle>'
        '<vehicle id="car.1" type="car" route="whole" depart="0" departPos="10"/></routes>'
    )
    return into_the_fast_lane


def test_vehicles_that_models_do_not_suit_stay_sumos_and_are_counted_by_reason(mixed_traffic: Path, cli: Cli) -> None:
    slow = "intersection-paper"
    settings = RunSettings(str(mixed_traffic), takeover="car=1", steps=8, selector="rule", bundle=slow)
    learned: set[str] = set()
    left: dict[str, str] = {}
    for event in run(settings):
        if isinstance(event, Decision):
            learned.update(event.steps[-1].world.ids[: len(event.surface)])
            assert not learned.intersection(user for user, _ in event.left_to_sumo)
            left.update(event.left_to_sumo)
    assert learned == {"car.0", "car.1"}
    reasons = {"there": "fast lane", "bus.0": "class bus", "motorcycle.0": "class motorcycle", "van.0": "size"}
    assert left == {**reasons, "stops": "stop ahead"}

    summary = mixed_traffic.with_name("summary.json")
    words = ["run", mixed_traffic, "--takeover", "car=1", "--steps", "8", "--bundle", slow, "--summary", summary]
    shown = cli(*words)
    assert json.loads(summary.read_text())["left_to_sumo"] == dict.fromkeys([*reasons.values(), "stop ahead"], 1)
    assert "5 road users of the takeover stayed SUMO's: " in shown.stdout
    assert "class motorcycle 1" in shown.stdout
    # The lane follower drives vehicles of all classes.
    cli(*words, "--selector", "lane")
    assert json.loads(summary.read_text())["left_to_sumo"] == {"stop ahead": 1}


def test_nothing_is_said_where_no_road_user_is_left_to_sumo(cli: Cli) -> None:
    assert "stayed SUMO's" not in cli("run", "intersection", "--takeover", "car=1", "--steps", "3").stdout
