"""Learned road users in a script of the user's own, over libsumo and over TraCI: what the script had is as it was."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import libsumo
import pytest
import sumolib
import traci

import slrl_sumo
from slrl_sumo.agent import decide
from slrl_sumo.agent.guard import guard as allowed_modes
from slrl_sumo.errors import InputError
from slrl_sumo.simulation.region import JunctionRegion
from slrl_sumo.sumo.scenario import find_scenario

ROOT = Path(__file__).parent.parent.parent
DISTRICT = find_scenario("district").config
OPTIONS = ["--step-length", "0.4", "--time-to-teleport", "-1", "--collision.action", "warn", "--no-step-log"]
OPTIONS += ["--no-warnings", "--seed", "3"]
SPEED, POSITION = 0x40, 0x42
DEFAULT_MODES = (31, 1621)


def start(name: str = "district", *more: str) -> Any:
    libsumo.start(["sumo", "-c", str(find_scenario(name).config), *OPTIONS, *more])
    return libsumo


@pytest.fixture
def api() -> Iterator[Any]:
    """libsumo with the district, 24 s after its begin."""
    yield run_on(start(), 60)
    libsumo.close()


def run_on(api: Any, steps: int) -> Any:
    for _ in range(steps):
        api.simulationStep()
    return api


@pytest.fixture
def connection() -> Iterator[Any]:
    """A TraCI connection to a sumo of its own on a free port."""
    port = sumolib.miscutils.getFreeSocketPort()
    command = [sumolib.checkBinary("sumo"), "-c", str(DISTRICT), "--remote-port", str(port), *OPTIONS]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as sumo:
        connection = traci.connect(port, numRetries=100, waitBetweenRetries=0.1)
        try:
            yield run_on(connection, 60)
        finally:
            connection.close()
            sumo.wait(timeout=30)


def modes(api: Any) -> dict[str, tuple[int, int]]:
    return {v: (api.vehicle.getSpeedMode(v), api.vehicle.getLaneChangeMode(v)) for v in api.vehicle.getIDList()}


def subscriptions(api: Any) -> dict[str, dict[str, Any]]:
    """All subscriptions per domain; entries without variables are those of cancelled ones."""
    found = {}
    for name in ("vehicle", "person", "edge", "lane", "junction", "simulation"):
        domain = getattr(api, name)
        found[name] = {i: set(v) for i, v in dict(domain.getAllSubscriptionResults()).items() if v}
        found[f"{name} context"] = {i: True for i, v in dict(domain.getAllContextSubscriptionResults()).items() if v}
    return found


@pytest.mark.slow
@pytest.mark.parametrize("example", ["attach_libsumo.py", "attach_traci.py"])
def test_examples_do_what_they_promise(example: str) -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "examples" / example), str(DISTRICT), "40"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    (line,) = (line for line in done.stdout.splitlines() if "learned" in line)
    words = line.split()
    assert words[:2] == ["40", "s:"]
    learned, all_users = int(words[2]), int(words[4])
    assert 0 < learned < all_users
    if example == "attach_traci.py":
        assert learned == 8


def check_restored(api: Any, selector: str, steps: int) -> None:
    """Take over and add for a while, leave, and let the script go on."""
    # The scenarios know no other modes than SUMO's own.
    assert set(modes(api).values()) == {DEFAULT_MODES}
    with slrl_sumo.attach(api, agents=6, takeover="car=0.5,bicycle=1,pedestrian=0.5", selector=selector) as learned:
        lent: set[str] = set()
        for _ in range(steps):
            world = learned.step()
            lent |= set(learned.ids)
            others = {mode for vehicle, mode in modes(api).items() if vehicle not in lent}
            # A vehicle that has to brake hard for a learned road user may exceed its usual deceleration for that time.
            # Some brake harder than usual, some pass others inside a junction.
            speed, lanes = DEFAULT_MODES
            assert others <= {(mode, lanes) for mode in (speed, speed & ~4, speed | 32, speed & ~4 | 32)}
        held = set(learned.ids)
        assert sum(i.startswith("learned_") for i in held) == 6
        assert set(world.ids) == set(api.vehicle.getIDList()) | set(api.person.getIDList())
        still = {i for i in held if not i.startswith("learned_")}
        vehicles = still & set(api.vehicle.getIDList())
        assert vehicles  # those that left the network are SUMO's again already
        routes = {v: api.vehicle.getRoute(v) for v in vehicles}
        time = api.simulation.getTime()
    assert api.simulation.getTime() == time
    added = held - still
    assert {mode for vehicle, mode in modes(api).items() if vehicle not in added} == {DEFAULT_MODES}
    # All go on, and arrive where the scenario sends them.
    last = {v: route[-1] for v, route in routes.items()}
    arrived: set[str] = set()
    for _ in range(2000):
        api.simulationStep()
        present = set(api.vehicle.getIDList()) | set(api.person.getIDList())
        assert not any(subscriptions(api).values())
        assert not any(i.startswith("learned_") for i in present)
        for vehicle in vehicles & present:
            last[vehicle] = api.vehicle.getRoadID(vehicle)
        arrived |= {*api.simulation.getArrivedIDList(), *api.simulation.getArrivedPersonIDList()}
        if still <= arrived:
            break
    assert still <= arrived
    assert last == {v: route[-1] for v, route in routes.items()}


@pytest.mark.parametrize("selector", ["prior", pytest.param("lane", marks=pytest.mark.slow)])
def test_leaving_restores_everything(api: Any, selector: str) -> None:
    check_restored(api, selector, 75)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["shared-space", "signalised", "intersection"])
def test_leaving_restores_everything_elsewhere_too(name: str) -> None:
    try:
        check_restored(run_on(start(name), 60), "prior", 150)
    finally:
        libsumo.close()


def test_leaving_restores_everything_over_traci(connection: Any) -> None:
    check_restored(connection, "prior", 50)


@pytest.mark.slow
def test_a_connection_by_label_and_the_traci_module_itself_will_do() -> None:
    command = [sumolib.checkBinary("sumo"), "-c", str(DISTRICT), *OPTIONS]
    traci.start(command, label="theirs", stdout=subprocess.DEVNULL)
    try:
        for api in (traci.getConnection("theirs"), traci):
            with slrl_sumo.attach(api, agents=3) as learned:
                for _ in range(3):
                    assert int(learned.step().learned.sum()) == 3
            run_on(api, 2)
    finally:
        traci.close()


@pytest.mark.parametrize("over", ["libsumo", "traci"])
def test_the_users_own_subscriptions_go_on_as_they_were(over: str, request: pytest.FixtureRequest) -> None:
    api = request.getfixturevalue("api" if over == "libsumo" else "connection")
    early, late = api.vehicle.getIDList()[0], api.vehicle.getIDList()[-1]
    walker = api.person.getIDList()[0]
    api.vehicle.subscribe(early, (SPEED,))
    api.person.subscribe(walker, (POSITION,))
    api.vehicle.subscribeContext(early, 0xA4, 30.0, (SPEED,))
    with slrl_sumo.attach(api, takeover="car=1,pedestrian=1") as learned:
        learned.step()
        api.vehicle.subscribe(late, (POSITION,))
        for _ in range(8):
            learned.step()
            assert subscriptions(api)["vehicle"] == {early: {SPEED}, late: {POSITION}}
            assert subscriptions(api)["person"] == {walker: {POSITION}}
        inside = dict(api.vehicle.getContextSubscriptionResults(early))
        assert {variable for values in inside.values() for variable in values} == {SPEED}
    run_on(api, 2)
    assert subscriptions(api)["vehicle"] == {early: {SPEED}, late: {POSITION}}
    assert api.vehicle.getSubscriptionResults(early)[SPEED] == api.vehicle.getSpeed(early)
    assert api.vehicle.getSubscriptionResults(late)[POSITION] == api.vehicle.getPosition(late)
    assert api.person.getSubscriptionResults(walker)[POSITION] == api.person.getPosition(walker)
    assert subscriptions(api)["vehicle context"] == {early: True}


def fail_inside(api: Any, *, close: bool, **words: Any) -> None:
    with slrl_sumo.attach(api, **words) as learned:
        for _ in range(5):
            learned.step()
        if close:
            api.close()
        else:
            assert any(mode[0] == 0 for mode in modes(api).values())
        raise ZeroDivisionError


def test_an_exception_inside_restores_too_and_comes_through(api: Any) -> None:
    with pytest.raises(ZeroDivisionError):
        fail_inside(api, close=False, agents=3, takeover="car=1,bicycle=1", selector="lane")
    run_on(api, 1)
    assert set(modes(api).values()) == {DEFAULT_MODES}
    assert not any(subscriptions(api).values())


def test_closing_sumo_inside_shows_the_users_own_error() -> None:
    with pytest.raises(ZeroDivisionError):
        fail_inside(start(), close=True, agents=3)
    with pytest.raises(ZeroDivisionError):
        fail_inside(run_on(start(), 60), close=True, takeover="car=1,bicycle=1,pedestrian=1")


def test_one_simulation_after_the_other_in_a_process() -> None:
    # libsumo keeps moves that are still waiting when a simulation is closed for the next one, and crashes.
    for _ in range(3):
        with slrl_sumo.attach(run_on(start("shared-space"), 60), agents=5, takeover="car=1,pedestrian=1") as learned:
            for _ in range(100):
                learned.step()
            assert len(learned.ids) > 8
        libsumo.close()


def test_one_attachment_at_a_time_and_another_one_afterwards(api: Any) -> None:
    with slrl_sumo.attach(api, agents=2) as learned:
        learned.step()
        with pytest.raises(InputError, match="already"):
            slrl_sumo.attach(api, agents=2)
        learned.step()
    with pytest.raises(InputError, match="left"):
        learned.step()
    # At once, without a step in between.
    with slrl_sumo.attach(api, agents=2) as again:
        assert sum(i.startswith("learned_") for i in again.step().ids) == 2
        assert sum(i.startswith("learned_") for i in again.step().ids) == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({}, "give `agents=N`"),
        ({"agents": 3, "selector": "best"}, "best"),
        ({"agents": 3, "bundle": "nothing"}, "nothing"),
        ({"agents": 3, "mix": "train=1"}, "train"),
        ({"takeover": "car=7"}, "takeover='car=7': "),
        ({"takeover": {"car": 7}}, r"takeover={'car': 7}: the share of car must be a number from 0 to 1"),
        ({"takeover": "car=1", "region": "junction:nowhere,radius=5"}, "nowhere"),
        ({"agents": 100_000}, "100000"),
        ({"agents": "many"}, "agents='many': give a whole number"),
        ({"takeover": "car=1", "region": JunctionRegion("nowhere")}, "no junction 'nowhere'"),
    ],
)
def test_wrong_words_leave_the_simulation_alone(api: Any, words: dict[str, Any], message: str) -> None:
    before = (api.vehicle.getIDList(), api.person.getIDList(), modes(api))
    with pytest.raises(InputError, match=message):
        slrl_sumo.attach(api, **words)
    assert (api.vehicle.getIDList(), api.person.getIDList(), modes(api)) == before
    assert not any(subscriptions(run_on(api, 1)).values())
    with slrl_sumo.attach(api, agents=1) as learned:
        assert int(learned.step().learned.sum()) == 1


@pytest.mark.parametrize("action", ["teleport", "remove"])
def test_road_users_that_sumo_teleports_are_moved_on_or_given_up(action: str) -> None:
    """SUMO's own options, which attach asks scripts to change."""
    words = ["--time-to-teleport", "3", "--collision.action", action, "--collision.mingap-factor", "0"]
    libsumo.start(["sumo", "-c", str(DISTRICT), "--step-length", "0.4", *words, *OPTIONS[-4:]])
    try:
        run_on(libsumo, 60)
        teleported = set[str]()
        with slrl_sumo.attach(libsumo, agents=6, takeover="car=1,bicycle=1", selector="prior") as learned:
            for _ in range(100):
                before = set(learned.ids)
                there = set(learned.step().ids)
                teleported |= before.intersection(libsumo.simulation.getStartingTeleportIDList())
                assert set(learned.ids) <= there
            assert sum(road_user.startswith("learned_") for road_user in learned.ids) == 6
        assert teleported
        assert set(modes(libsumo).values()) == {DEFAULT_MODES}
        assert not [road_user for road_user in libsumo.vehicle.getIDList() if road_user.startswith("learned_")]
        run_on(libsumo, 10)
    finally:
        libsumo.close()


@pytest.mark.parametrize("step", ["1", "0.5", "0.3"])
def test_a_step_that_does_not_divide_the_decision_interval_is_refused(step: str) -> None:
    try:
        libsumo.start(["sumo", "-c", str(DISTRICT), "--step-length", step, "--no-step-log"])
        with pytest.raises(InputError, match=r"step-length 0\.4"):
            slrl_sumo.attach(libsumo, agents=3)
    finally:
        libsumo.close()


def test_the_guard_masks_modes_here_too(api: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def watched(rollouts: Any, kind: Any, route: Any) -> Any:
        asked.append(len(kind))
        return allowed_modes(rollouts, kind, route)

    monkeypatch.setattr(decide, "guard", watched)
    for guard, expected in ((False, []), (True, [5, 5])):
        with slrl_sumo.attach(api, agents=5, guard=guard) as learned:
            for _ in range(3):
                learned.step()
        assert asked == expected
    with pytest.raises(InputError, match="`selector='lane'` chooses no modes"):
        slrl_sumo.attach(api, agents=5, selector="lane", guard=True)
    # Refused before any road user came: it can be tried again.
    with slrl_sumo.attach(api, agents=5, selector="lane") as learned:
        learned.step()
        assert len(learned.ids) == 5
