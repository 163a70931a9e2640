"""A call that SUMO refuses costs one road user its turn: a town with every kind of stage and removal."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import libsumo
import pytest
import sumo

from slrl_sumo.api import run as outputs
from slrl_sumo.errors import SumoError
from slrl_sumo.metrics.counters import RunCounters
from slrl_sumo.simulation.events import Decision, Started
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.sumo.refusals import Refusals, is_refusal
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.taken_over.vehicles import MOVED

Cli = Callable[..., subprocess.CompletedProcess[str]]

# Streets of 100 m between the nodes A0 to C2: B0B1 leads from B0 to B1. Lane 0 is the sidewalk.
ADDITIONAL = """<additional>
  <vType id="car" vClass="passenger"/><vType id="bus" vClass="bus" length="7.5"/><route id="anywhere" edges="B2A2"/>
  <busStop id="stop" lane="B0B1_1" startPos="40" endPos="60">
    <access lane="A1B1_0" pos="60" length="30"/><access lane="B0B1_0" pos="50" length="20"/>
  </busStop>
  <busStop id="end" lane="B1B2_1" startPos="40" endPos="60"/>
  <containerStop id="dock" lane="C0C1_1" startPos="30" endPos="50"/>
  <parkingArea id="lot" lane="A0B0_1" startPos="30" endPos="50" roadsideCapacity="3"/>
  <rerouter id="closing" edges="B0B1 A1B1"><interval begin="0" end="400">
    <closingReroute id="B1C1" disallow="passenger"/></interval></rerouter>
  <rerouter id="destinations" edges="C0C1"><interval begin="0" end="400">
    <destProbReroute id="C2B2" probability="0.5"/><destProbReroute id="A2A1" probability="0.5"/></interval></rerouter>
  <calibrator id="removes" edge="B2A2" pos="20" freq="1" output="NUL">
    <flow begin="0" end="400" route="anywhere" type="car" vehsPerHour="0" speed="10"/></calibrator>
  <vaporizer id="C1C2" begin="15" end="400"/>
</additional>"""
DEMAND = """<routes>
  <flow id="rerouted" type="car" begin="0" end="200" period="6" from="A0B0" to="B2C2" via="B0B1"/>
  <flow id="vaporized" type="car" begin="0" end="200" period="12" from="B0C0" to="C2B2" via="C1C2"/>
  <flow id="calibrated" type="car" begin="0" end="200" period="9" from="C2B2" to="A2A1" via="B2A2"/>
  <flow id="parks" type="car" begin="0" end="200" period="20" from="A1A0" to="B0C0">
    <stop parkingArea="lot" duration="10"/></flow>
  <flow id="bus" type="bus" begin="0" end="300" period="30"><route edges="A0B0 B0B1 B1B2 B2C2"/>
    <stop busStop="stop" duration="10"/><stop busStop="end" duration="5"/></flow>
  <personFlow id="access" begin="0" end="200" period="4">
    <walk from="A2A1" busStop="stop"/><ride busStop="end" lines="ANY"/><walk to="B2C2"/></personFlow>
  <personFlow id="passes" begin="0" end="200" period="7">
    <walk edges="A0A1 A1B1" busStop="stop"/><walk to="C1C0"/></personFlow>
  <personFlow id="beside" begin="0" end="200" period="7">
    <walk edges="A0B0 B0B1" busStop="stop"/><walk to="C1C0"/></personFlow>
  <personFlow id="stops" begin="0" end="200" period="8"><walk from="C0B0" to="B0A0" arrivalPos="30"/>
    <stop lane="B0A0_0" duration="5" startPos="30" endPos="40"/><walk to="A1A2"/></personFlow>
  <personFlow id="rides" begin="0" end="200" period="20">
    <walk from="B1A1" to="A1A0" arrivalPos="50"/><ride to="B0C0" lines="ANY"/></personFlow>
  <container id="box" depart="0"><tranship from="B0C0" to="C0C1" arrivalPos="40"/>
    <stop containerStop="dock" duration="3"/><transport to="C1B1" lines="lorry"/><tranship to="B1A1" speed="2"/>
  </container>
  <containerFlow id="boxes" begin="0" end="100" period="10">
    <tranship from="C0C1" to="C1B1" speed="1.5"/></containerFlow>
  <vehicle id="lorry" type="bus" depart="5"><route edges="B0C0 C0C1 C1B1"/>
    <stop containerStop="dock" duration="10"/></vehicle>
</routes>"""


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration of the town; `without` of a run leaves nothing out: all kinds at once."""
    folder = tmp_path_factory.mktemp("town")
    words = "--grid --grid.number 3 --grid.length 100 --sidewalks.guess --sidewalks.guess.min-speed 0 --crossings.guess"
    words += " --default.lanenumber 1 --default-junction-type priority --no-turnarounds -o town.net.xml"
    program = Path(sumo.SUMO_HOME) / "bin" / "netgenerate"
    subprocess.run([program, *words.split()], cwd=folder, check=True, capture_output=True, timeout=60)
    (folder / "town.add.xml").write_text(ADDITIONAL)
    (folder / "town.rou.xml").write_text(DEMAND)
    config = folder / "town.sumocfg"
    config.write_text(
        '<configuration><net-file value="town.net.xml"/><route-files value="town.rou.xml"/>'
        '<additional-files value="town.add.xml"/><end value="300"/></configuration>'
    )
    return config


def played(settings: RunSettings, act: Callable[[int], None] = lambda number: None) -> tuple[RunCounters, set[str]]:
    """What a run came to, and the ids of the road users that were taken over; `act`: after each decision."""
    counters, learned = None, set[str]()
    for number, event in enumerate(run(settings)):
        if isinstance(event, Started):
            counters = RunCounters(event.step.world)
        elif isinstance(event, Decision):
            assert counters is not None
            counters.add(event)
            learned.update(event.taken_over)
            act(number)
    assert counters is not None
    return counters, learned


def test_stages_and_removals_of_all_kinds_cost_nothing(town: Path) -> None:
    everyone = {"car": 1, "bicycle": 1, "pedestrian": 1}
    counters, learned = played(RunSettings(str(town), takeover=everyone, selector="lane", steps=110))
    kinds = {road_user.rpartition(".")[0] for road_user in learned}
    assert {"rerouted", "vaporized", "stops", "rides"} <= kinds
    # Persons on the way to an <access> and vehicles before a calibrator are left to SUMO ...
    assert not {"passes", "beside"} & kinds
    # ... so that no call is refused, and no road user is lost.
    assert counters.refused == {}
    assert counters.lost == []
    assert counters.handed_back >= 2


def test_added_road_users_before_a_calibrator_are_named(
    cli: Cli, town: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outputs, "run_isolated", lambda settings, *_, **__: run(settings))
    words = ("--agents", 30, "--mix", "car=1", "--selector", "lane", "--steps", 60, "--summary", "s.json")
    done = cli("run", town, *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "s.json").read_text())
    assert summary["refused"] == len(summary["refusals"]) > 0
    first = summary["refusals"][0]
    assert set(first) == {"id", "time_s", "reason"}
    assert "calibrator" in first["reason"]
    (line,) = (line for line in done.stdout.splitlines() if "could not be moved" in line)
    assert line.startswith(f"{summary['refused']} road users were given back to SUMO")
    assert f"{first['id']} at {first['time_s']:g} s (it comes to an edge with a calibrator" in line


@pytest.mark.parametrize("selector", ["lane", "greedy"])
def test_a_road_user_that_disappears_between_decisions_is_named_and_the_others_go_on(selector: str) -> None:
    removed: list[str] = []

    def remove(number: int) -> None:
        """An added car, a car of the scenario, a person: as a user's script may do."""
        if number not in (40, 42, 44):
            return
        domain = libsumo.person if number == 44 else libsumo.vehicle
        learned = [i for i in domain.getIDList() if i.startswith("learned_") == (number == 40) and is_moved(i, domain)]
        removed.append(learned[0])
        domain.remove(learned[0])

    def is_moved(road_user: str, domain: Any) -> bool:
        return domain is libsumo.person or libsumo.vehicle.getSpeedMode(road_user) in {0, MOVED}

    words: dict[str, Any] = {"agents": 3, "mix": "car=1", "takeover": {"car": 1, "pedestrian": 1}}
    counters, learned = played(RunSettings("district", selector=selector, steps=48, **words), remove)
    assert len(removed) == 3
    assert set(removed) - learned <= {"learned_car.0", "learned_car.1", "learned_car.2", removed[2]}
    assert set(removed[:2]) <= set(counters.refused) <= set(removed)
    assert all("not known" in reason for _, reason in counters.refused.values())
    assert counters.decisions == 48
    assert counters.lost == []


def test_refusals_keep_the_first_reason_and_let_other_errors_through() -> None:
    refusals = Refusals()
    with SumoSession(find_scenario("intersection")):
        for road_user in ("a", "b"):
            with refusals.of(road_user):
                libsumo.vehicle.setSpeed(road_user, 1.0)
        with refusals.of("a"):
            libsumo.person.setSpeed("a", 1.0)
        assert refusals.take() == {"a": "Vehicle 'a' is not known.", "b": "Vehicle 'b' is not known."}
        assert refusals.take() == {}
        try:
            libsumo.vehicle.setSpeed("a", 1.0)
        except Exception as error:
            refusals.catch("a", error)
        assert refusals.take() == {"a": "Vehicle 'a' is not known."}
        with pytest.raises(KeyError), refusals.of("a"):
            raise KeyError
        with pytest.raises(KeyError):
            refusals.catch("a", KeyError())
    with pytest.raises(libsumo.FatalTraCIError) as ended, refusals.of("a"):
        libsumo.vehicle.getIDList()
    assert not is_refusal(ended.value)


def test_a_refused_call_of_ours_outside_is_a_defect_and_a_closed_simulation_is_sumos_end() -> None:
    with pytest.raises(libsumo.TraCIException), SumoSession(find_scenario("intersection")):
        libsumo.vehicle.getSpeed("absent")

    def close_inside() -> None:
        with SumoSession(find_scenario("intersection")) as session:
            libsumo.close()
            session.reader.read()

    with pytest.raises(SumoError, match="SUMO has ended"):
        close_inside()
