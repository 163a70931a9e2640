"""Scripts of users that do ordinary things while learned road users are attached, over libsumo and over TraCI."""

import math
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import libsumo
import pytest
import sumolib
import torch
import traci

import slrl_sumo
from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.simulation.attach import Attached
from slrl_sumo.sumo.scenario import find_scenario

DISTRICT = str(find_scenario("district").config)
OPTIONS = ["--step-length", "0.4", "--time-to-teleport", "-1", "--collision.action", "warn", "--no-step-log"]
OPTIONS += ["--no-warnings", "--seed", "3"]
WORDS: dict[str, Any] = {"agents": 6, "takeover": "car=1,bicycle=1,pedestrian=1", "selector": "lane"}
DEFAULT_MODES = (31, 1621)
LOADED = "loaded another simulation or state"
CLOSED = "closed inside"


class User:
    """A user with a simulation over libsumo or TraCI; opened again where a script has closed it."""

    def __init__(self, over: str) -> None:
        self._over, self._sumo = over, None
        self.api: Any = None

    def open(self) -> Any:
        if self.api is None:
            command = [sumolib.checkBinary("sumo"), "-c", DISTRICT, *OPTIONS]
            if self._over == "libsumo":
                libsumo.start(command)
                self.api = libsumo
            else:
                port = sumolib.miscutils.getFreeSocketPort()
                self._sumo = subprocess.Popen([*command, "--remote-port", str(port)], stdout=subprocess.DEVNULL)
                self.api = traci.connect(port, numRetries=200, waitBetweenRetries=0.05)
            for _ in range(60):
                self.api.simulationStep()
        return self.api

    def close(self) -> None:
        """Also where the script has closed it."""
        if self.api is not None:
            with suppress(libsumo.FatalTraCIError, traci.exceptions.FatalTraCIError):
                self.api.close()
        if self._sumo is not None:
            self._sumo.wait(timeout=30)
        self.api = self._sumo = None


@pytest.fixture(scope="module", params=["libsumo", pytest.param("traci", marks=pytest.mark.slow)])
def user(request: pytest.FixtureRequest) -> Iterator[User]:
    user = User(request.param)
    yield user
    user.close()


def ours(api: Any, learned: Attached) -> tuple[str, str, str]:
    """An added vehicle, a vehicle and a person of the scenario, all of them learned."""
    vehicles, persons = set(api.vehicle.getIDList()), set(api.person.getIDList())
    added = [i for i in learned.ids if i.startswith("learned_") and i in vehicles]
    theirs = [i for i in learned.ids if not i.startswith("learned_") and i in vehicles]
    walkers = [i for i in learned.ids if not i.startswith("learned_") and i in persons]
    return added[0], theirs[0], walkers[0]


def removes_vehicles(api: Any, learned: Attached, folder: Path) -> None:
    removed = ours(api, learned)[:2]
    for vehicle in removed:
        api.vehicle.remove(vehicle)
    for _ in range(3):
        learned.step()
    assert not set(removed) & set(learned.ids)
    assert not set(removed) & set(api.vehicle.getIDList())
    assert set(learned.refused) >= set(removed)


def removes_persons(api: Any, learned: Attached, folder: Path) -> None:
    added = next(i for i in learned.ids if i.startswith("learned_pedestrian"))
    walkers = [i for i in learned.ids if i in set(api.person.getIDList()) and not i.startswith("learned_")]
    for person in (added, walkers[0]):
        api.person.remove(person)
    api.person.removeStages(walkers[1])
    for _ in range(3):
        learned.step()
    assert not {added, *walkers[:2]} & set(learned.ids)


def changes_routes(api: Any, learned: Attached, folder: Path) -> None:
    _, vehicle, _ = ours(api, learned)
    api.vehicle.rerouteTraveltime(vehicle)
    edges = api.vehicle.getRoute(vehicle)[max(api.vehicle.getRouteIndex(vehicle), 0) :]
    if not api.vehicle.getRoadID(vehicle).startswith(":"):
        api.vehicle.setRoute(vehicle, edges)
    api.vehicle.changeTarget(vehicle, edges[-1])


def changes_modes(api: Any, learned: Attached, folder: Path) -> None:
    added, vehicle, _ = ours(api, learned)
    for each in (added, vehicle):
        api.vehicle.setSpeedMode(each, 23)
        api.vehicle.setLaneChangeMode(each, 597)
        api.vehicle.setSpeed(each, 3.0)
    for _ in range(3):
        learned.step()


def changes_types(api: Any, learned: Attached, folder: Path) -> None:
    for each in ours(api, learned)[:2]:
        api.vehicle.setType(each, "bicycle0")
        api.vehicle.setColor(each, (255, 0, 0, 255))


def changes_sizes(api: Any, learned: Attached, folder: Path) -> None:
    _, vehicle, walker = ours(api, learned)
    api.vehicletype.setLength("learned_car", 7.0)
    api.vehicletype.setWidth(api.person.getTypeID(walker), 1.0)
    api.vehicle.setLength(vehicle, 6.0)
    learned.step()
    api.vehicletype.setLength("learned_car", 5.0)


def moves_itself(api: Any, learned: Attached, folder: Path) -> None:
    for vehicle in ours(api, learned)[:2]:
        x, y = api.vehicle.getPosition(vehicle)
        api.vehicle.moveToXY(vehicle, "", -1, x + 3.0, y + 3.0, 10.0, 2)
        learned.step()
        # The models' own move comes last.
        assert math.dist(api.vehicle.getPosition(vehicle), (x, y)) < 8.0


def changes_lanes(api: Any, learned: Attached, folder: Path) -> None:
    for vehicle in ours(api, learned)[:2]:
        api.vehicle.changeLane(vehicle, 0, 5.0)
        api.vehicle.slowDown(vehicle, 2.0, 3.0)


def sets_a_stop(api: Any, learned: Attached, folder: Path) -> None:
    # A stop needs a lane of the route with room ahead.
    for vehicle in [i for i in learned.ids if not i.startswith("learned_") and i in set(api.vehicle.getIDList())]:
        lane = api.vehicle.getLaneID(vehicle)
        ahead = api.lane.getLength(lane) - 1.0 if lane and not lane.startswith(":") else 0.0
        if ahead > api.vehicle.getLanePosition(vehicle) + 40.0:
            api.vehicle.setStop(vehicle, api.lane.getEdgeID(lane), ahead, int(lane.rsplit("_", 1)[1]), 5.0)
            learned.step()
            learned.step()
            assert vehicle not in learned.ids
            return
    pytest.skip("no vehicle has room to stop")


def steps_in_between(api: Any, learned: Attached, folder: Path) -> None:
    for extra in (1, 2, 7):
        for _ in range(extra):
            api.simulationStep()
        learned.step()
    api.simulationStep(api.simulation.getTime() + 4.0)
    learned.step()
    assert sum(road_user.startswith("learned_") for road_user in learned.ids) == 6
    assert learned.refused == {}


def subscribes(api: Any, learned: Attached, folder: Path) -> None:
    added, vehicle, walker = ours(api, learned)
    for each in (added, vehicle):
        api.vehicle.subscribe(each, (0x40,))
        api.vehicle.subscribeContext(each, 0xA4, 20.0, (0x40,))
    api.person.subscribe(walker, (0x42,))
    learned.step()
    assert set(api.vehicle.getSubscriptionResults(vehicle)) == {0x40}
    api.vehicle.unsubscribe(vehicle)
    api.person.unsubscribe(walker)
    for each in (added, vehicle):
        api.vehicle.unsubscribeContext(each, 0xA4, 20.0)


def saves_a_state(api: Any, learned: Attached, folder: Path) -> None:
    api.simulation.saveState(str(folder / "state.xml"))
    learned.step()


def loads_a_state(api: Any, learned: Attached, folder: Path) -> None:
    saves_a_state(api, learned, folder)
    learned.step()
    api.simulation.loadState(str(folder / "state.xml"))
    learned.step()


def loads_a_simulation(api: Any, learned: Attached, folder: Path) -> None:
    api.load(["-c", DISTRICT, *OPTIONS])
    learned.step()


def closes(api: Any, learned: Attached, folder: Path) -> None:
    api.close()
    learned.step()


def steps_in_threads(api: Any, learned: Attached, folder: Path) -> None:
    before, errors = api.simulation.getTime(), list[BaseException]()

    def go() -> None:
        try:
            for _ in range(5):
                learned.step()
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=go) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert api.simulation.getTime() == pytest.approx(before + 4.0)


def fails(api: Any, learned: Attached, folder: Path) -> None:
    raise ZeroDivisionError("the user's own")


def nests(api: Any, learned: Attached, folder: Path) -> None:
    with pytest.raises(InputError, match="attached to this simulation already"), slrl_sumo.attach(api, agents=1):
        raise AssertionError
    learned.step()


def adds_road_users(api: Any, learned: Attached, folder: Path) -> None:
    edge = api.vehicle.getRoute(ours(api, learned)[1])[0]
    api.route.add("their route", [edge])
    for name in ("learned_car.99", "ä b", "x"):
        api.vehicle.add(name, "their route", typeID="passenger0")
    for name in ("learned_pedestrian.99", "walks"):
        api.person.add(name, edge, 5.0, typeID="pedestrian0")
        api.person.appendWalkingStage(name, [edge], 30.0)
    for _ in range(6):
        learned.step()
    assert not {"learned_car.99", "learned_pedestrian.99"} & set(learned.ids)
    for domain in (api.vehicle, api.person):
        for road_user in {"learned_car.99", "learned_pedestrian.99"} & set(domain.getIDList()):
            domain.remove(road_user)


def removes_everyone(api: Any, learned: Attached, folder: Path) -> None:
    for _ in range(2):
        for domain in (api.vehicle, api.person):
            for road_user in domain.getIDList():
                domain.remove(road_user)
        learned.step()
    learned.step()


SCRIPTS: list[tuple[Callable[[Any, Attached, Path], None], type[Exception] | None, str]] = [
    (loads_a_state, InputError, LOADED),
    (removes_vehicles, None, ""),
    (removes_persons, None, ""),
    (changes_routes, None, ""),
    (changes_modes, None, ""),
    (changes_types, None, ""),
    (changes_sizes, None, ""),
    (moves_itself, None, ""),
    (changes_lanes, None, ""),
    (sets_a_stop, None, ""),
    (steps_in_between, None, ""),
    (subscribes, None, ""),
    (saves_a_state, None, ""),
    (steps_in_threads, None, ""),
    (nests, None, ""),
    (adds_road_users, None, ""),
    (fails, ZeroDivisionError, "own"),
    (removes_everyone, None, ""),
    (loads_a_simulation, InputError, LOADED),
    (closes, SumoError, CLOSED),
]


def attached(api: Any, script: Callable[[Any, Attached, Path], None], folder: Path) -> None:
    with slrl_sumo.attach(api, **WORDS) as learned:
        for _ in range(4):
            learned.step()
        script(api, learned, folder)
        for _ in range(3):
            learned.step()


@pytest.mark.parametrize(("script", "error", "message"), SCRIPTS, ids=[script.__name__ for script, *_ in SCRIPTS])
def test_a_script_goes_on_afterwards(
    user: User, script: Callable[..., None], error: type[Exception] | None, message: str, tmp_path: Path
) -> None:
    """It works or gets one clear line; then all road users are SUMO's, and the simulation goes on."""
    api, threads = user.open(), torch.get_num_threads()
    kept = {DEFAULT_MODES} | ({(23, 597)} if script is changes_modes else set())
    if error is None:
        attached(api, script, tmp_path)
    else:
        with pytest.raises(error, match=message) as caught:
            attached(api, script, tmp_path)
        assert "\n" not in str(caught.value)
    assert torch.get_num_threads() == threads
    if script is closes:
        user.close()
        return
    for _ in range(3):
        present = (*api.vehicle.getIDList(), *api.person.getIDList())
        assert not [road_user for road_user in present if road_user.startswith("learned_")]
        modes = {(api.vehicle.getSpeedMode(v), api.vehicle.getLaneChangeMode(v)) for v in api.vehicle.getIDList()}
        assert modes <= kept
        api.simulationStep()
    if script in (loads_a_state, loads_a_simulation, removes_everyone, changes_modes):
        user.close()


def test_ids_of_ours_that_are_in_use_are_left_out(user: User) -> None:
    api = user.open()
    edge = api.vehicle.getRoute(api.vehicle.getIDList()[0])[0]
    api.route.add("of theirs", [edge])
    api.vehicle.add("learned_car.0", "of theirs", typeID="passenger0")
    for _ in range(60):
        api.simulationStep()
        if "learned_car.0" in api.vehicle.getIDList():
            break
    with slrl_sumo.attach(api, agents=2, mix="car=1", selector="lane") as learned:
        learned.step()
        assert set(learned.ids) == {"learned_car.1", "learned_car.2"}
    assert "learned_car.0" in api.vehicle.getIDList()
    api.vehicle.remove("learned_car.0")


def test_leaving_at_once_and_closing_without_a_step(user: User) -> None:
    api = user.open()
    with slrl_sumo.attach(api, **WORDS):
        pass
    api.simulationStep()
    assert not [i for i in (*api.vehicle.getIDList(), *api.person.getIDList()) if i.startswith("learned_")]
    with slrl_sumo.attach(api, **WORDS) as learned:
        learned.step()
        api.close()
    user.close()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"agents": "5"}, "agents='5': give a whole number"),
        ({"agents": 1, "seed": 1.5}, r"seed=1\.5: give a whole number"),
        ({"takeover": 0.5}, r"takeover=0\.5: give shares by type"),
        ({"agents": 1, "mix": 3}, "mix=3: give shares by type"),
        ({"agents": 1, "bundle": None}, "bundle: give the name or the folder"),
        ({"agents": 1, "selector": 7}, "selector=7: give the name"),
        ({"agents": 1, "guard": "yes"}, "guard='yes': give True or False"),
        ({"agents": 1, "without": 5}, "without=5: give a list"),
        ({"agents": 1, "without": "speed_cap"}, "without='speed_cap': give a list"),
        ({"takeover": "car=1", "region": 5}, "region=5: not understood"),
        ({"takeover": "car=1", "exclude": ["ego", 5]}, r"exclude=\['ego', 5\]: give ids of road users"),
    ],
)
def test_arguments_of_wrong_types_are_named(user: User, words: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        slrl_sumo.attach(user.open(), **words)
    user.open().simulationStep()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"until": "5"}, "until='5': give a simulation time"),
        ({"step_length": "0.4"}, r"step_length='0\.4': give a time"),
        ({"sumo_options": None}, "sumo_options: give options"),
        ({"scenario": 5}, "scenario=5: give the name"),
        ({"sumo_outputs": 1}, "sumo_outputs=1: give True or False"),
    ],
)
def test_arguments_of_wrong_types_of_a_simulation_are_named(words: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        slrl_sumo.Simulation(**{"scenario": "intersection", "agents": 1, **words})


@pytest.mark.parametrize("name", ["fcd", "summary", "report", "recording"])
def test_paths_of_wrong_types_are_named(name: str) -> None:
    with pytest.raises(InputError, match=f"{name}=5: give a path"):
        slrl_sumo.run("intersection", agents=1, **{name: 5})  # type: ignore[arg-type]


@pytest.mark.parametrize("api", [None, 5, "libsumo", libsumo])
def test_what_holds_no_simulation_is_refused_in_one_line(user: User, api: Any) -> None:
    user.close()
    with pytest.raises(InputError, match="it holds no running simulation"):
        slrl_sumo.attach(api, agents=1)
