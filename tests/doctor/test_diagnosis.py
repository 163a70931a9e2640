import gzip
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import libsumo
import pytest
from builders import make_net

from slrl_sumo.doctor.diagnosis import examine
from slrl_sumo.doctor.finding import Finding
from slrl_sumo.sumo.scenario import find_scenario, read_scenario, shipped_scenarios

NET = Path(__file__).parents[2] / "sumo_scenarios" / "intersection" / "intersection.net.xml"
CALM = {
    "begin": "0",
    "end": "60",
    "step-length": "0.4",
    "time-to-teleport": "-1",
    "collision.action": "warn",
}
CAR = '<vehicle id="a" depart="1"><route edges="in0 out2"/></vehicle>'
Make = Callable[..., Path]


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    assert not libsumo.isLoaded()


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Writes a scenario on the shipped intersection: by default one that nothing is to be said about."""

    def write(demand: str = CAR, additional: str = "", net: str | Path = NET, **changes: str | None) -> Path:
        (tmp_path / "d.rou.xml").write_text(f"<routes>{demand}</routes>")
        (tmp_path / "a.add.xml").write_text(f"<additional>{additional}</additional>")
        options = {"net-file": str(net), "route-files": "d.rou.xml", "additional-files": "a.add.xml", **CALM}
        options |= {key.replace("__", ".").replace("_", "-"): value for key, value in changes.items() if value}
        for key in [key.replace("__", ".").replace("_", "-") for key, value in changes.items() if value is None]:
            del options[key]
        config = tmp_path / "x.sumocfg"
        lines = "".join(f'<{key} value="{value}"/>' for key, value in options.items())
        config.write_text(f"<configuration>{lines}</configuration>")
        return config

    return write


def grave(config: Path) -> list[tuple[str, str]]:
    """Severity and topic of everything but what is ok."""
    return [(f.severity, f.topic) for f in examine(read_scenario(config)) if f.severity != "ok"]


def one(config: Path, topic: str) -> Finding:
    (finding,) = [f for f in examine(read_scenario(config)) if f.topic == topic]
    return finding


@pytest.mark.parametrize("name", shipped_scenarios())
def test_nothing_hurts_in_a_shipped_scenario(name: str) -> None:
    findings = examine(find_scenario(name))
    # Some corners of the generated street net are drawn without a radius.
    sharp = {"sharp turns"} if name == "district" else set()
    assert {f.topic for f in findings if f.severity == "ok"} == {"sublane model", "surfaces"}
    assert {f.topic for f in findings if f.severity != "ok"} == sharp
    assert {f.severity for f in findings} <= {"ok", "note"}


def test_nothing_is_said_about_a_calm_scenario(make: Make) -> None:
    assert grave(make()) == []


@pytest.mark.parametrize(
    ("changes", "severity", "topic"),
    [
        ({"step_length": None}, "note", "step length"),
        ({"step_length": "0.5"}, "note", "step length"),
        ({"time_to_teleport": None}, "note", "teleport"),
        ({"time_to_teleport": "120"}, "note", "teleport"),
        ({"collision__action": None}, "note", "collision action"),
        ({"collision__action": "remove"}, "note", "collision action"),
        ({"intermodal-collision__action": "remove"}, "warning", "collision action"),
        ({"lateral_resolution": "0.8"}, "note", "sublane model"),
        ({"pedestrian__model": "nonInteracting"}, "note", "pedestrian model"),
        ({"end": None}, "note", "end"),
        ({"end": "-1"}, "note", "end"),
        ({"random": "true"}, "warning", "seed"),
        ({"max_num_vehicles": "3"}, "warning", "insertion"),
        ({"max_num_persons": "3"}, "warning", "insertion"),
        ({"device__rerouting__probability": "1"}, "note", "rerouting"),
        ({"tripinfo_output": "t.xml"}, "note", "outputs"),
        ({"log": "l.txt"}, "note", "outputs"),
        ({"mesosim": "true"}, "problem", "mesosim"),
        ({"remote_port": "8813"}, "note", "remote-port"),
        ({"begin": "100"}, "problem", "end"),
        ({"route_files": "missing.rou.xml"}, "problem", "files"),
        ({"osg-view": "true"}, "problem", "SUMO"),
    ],
)
def test_option(make: Make, changes: dict[str, str | None], severity: str, topic: str) -> None:
    found = grave(make(**changes))
    assert (severity, topic) in found
    # Without traffic that can be read, or before the begin, doctor may also say that it is missing.
    assert [item for item in found if item[1] not in (topic, "demand")] == []


def test_switched_off_devices_and_times_that_mean_never_are_no_finding(make: Make) -> None:
    config = make(
        time_to_teleport="0",
        remote_port="0",
        mesosim="false",
        device__rerouting__probability="0",
        max_num_vehicles="-1",
    )
    assert grave(config) == []


def test_the_step_length_note_names_the_steps_and_the_measured_effect(make: Make) -> None:
    finding = one(make(step_length=None), "step length")
    assert "1 s (the default of SUMO)" in finding.what
    assert "0.4 s" in finding.fix
    assert "7 %" in finding.fix


def test_route_errors_matter_only_where_teleporting_would_have_hidden_them(make: Make) -> None:
    assert ("warning", "route errors") in grave(make(ignore_route_errors="true", time_to_teleport="300"))
    assert grave(make(ignore_route_errors="true")) == []


STOP = '<stop lane="in0_2" endPos="20" duration="5"/>'


@pytest.mark.parametrize(
    ("demand", "severity", "topic"),
    [
        ("", "warning", "demand"),
        (CAR.replace('"1"', '"70"'), "warning", "demand"),
        (CAR.replace('"1"', '"9"') + CAR.replace('"a"', '"b"'), "warning", "demand"),
        (f'<trip id="t" depart="0" from="in0" to="out2">{STOP}</trip>', "note", "stops"),
        (f'<route id="r" edges="in0 out2">{STOP}</route><vehicle id="v" route="r" depart="0"/>', "note", "stops"),
        (CAR + '<person id="p" depart="1"><ride from="in0" to="out2" lines="a"/></person>', "note", "rides"),
        (CAR.replace('"a"', '"learned_car.0"'), "problem", "ids"),
        ('<flow id="learned_bicycle" begin="0" end="9" number="2" from="in0" to="out2"/>', "problem", "ids"),
        (CAR.replace('"a"', '"learned_x"'), "warning", "ids"),
        ('<route id="learned_in0" edges="in1 out3"/>' + CAR, "warning", "ids"),
        ('<vType id="learned_car" length="12"/>' + CAR, "warning", "vehicle types"),
        ('<vType id="v"><param key="has.rerouting.device" value="true"/></vType>' + CAR, "note", "rerouting"),
        (CAR + CAR.replace('"a"', '"b"').replace('"1"', '"50"').replace("out2", "gone"), "problem", "edges"),
        (CAR + '<trip id="b" depart="50" from="in0" to="gone"/>', "problem", "edges"),
        (CAR + '<trip id="b" type="gone" depart="50" from="in0" to="out2"/>', "problem", "vehicle types"),
        (CAR + "<trip", "problem", "files"),
    ],
)
def test_demand(make: Make, demand: str, severity: str, topic: str) -> None:
    assert grave(make(demand)) == [(severity, topic)]


def test_demand_that_departs_after_the_end_cannot_stop_the_run(make: Make) -> None:
    assert grave(make(CAR + CAR.replace('"a"', '"b"').replace('"1"', '"90"').replace("out2", "gone"))) == []


def test_an_unknown_edge_that_sumo_may_ignore_is_a_warning(make: Make) -> None:
    late = CAR.replace('"a"', '"b"').replace('"1"', '"50"').replace("out2", "gone")
    assert grave(make(CAR + late, ignore_route_errors="true")) == [("warning", "edges")]


def test_traffic_that_starts_late_tells_when_to_begin(make: Make) -> None:
    finding = one(make(CAR.replace('"1"', '"7:00:00"'), end="8:00:00"), "demand")
    assert finding.severity == "warning"
    assert finding.fix == "set begin to 25200"


def test_the_unsorted_are_counted_as_sumo_drops_them(make: Make, tmp_path: Path) -> None:
    departures = {"a": 9, "b": 1, "c": 5, "d": 9}
    config = make("".join(CAR.replace('"a"', f'"{i}"').replace('"1"', f'"{t}"') for i, t in departures.items()))
    assert one(config, "demand").what.startswith("d.rou.xml: 2 not in the order of departure (first: b)")
    libsumo.start(["sumo", "-c", str(config), "--no-warnings", "--no-step-log", "true"])
    try:
        libsumo.simulationStep(20.0)
        assert set(libsumo.vehicle.getLoadedIDList()) | set(libsumo.vehicle.getIDList()) == {"a", "d"}
    finally:
        libsumo.close()


def test_gzipped_demand_is_read(make: Make, tmp_path: Path) -> None:
    config = make(route_files="d.rou.xml.gz")
    text = f'<routes><trip id="t" depart="0" from="in0" to="out2">{STOP}</trip></routes>'
    (tmp_path / "d.rou.xml.gz").write_bytes(gzip.compress(text.encode()))
    assert grave(config) == [("note", "stops")]


def test_included_and_additional_files_are_read(make: Make, tmp_path: Path) -> None:
    config = make("", additional='<include href="more.xml"/>')
    text = f'<additional><trip id="t" depart="0" from="in0" to="out2">{STOP}</trip></additional>'
    (tmp_path / "more.xml").write_text(text)
    assert grave(config) == [("note", "stops")]


def test_detectors_count_as_outputs(make: Make) -> None:
    detector = '<inductionLoop id="e" lane="in0_1" pos="5" period="60" file="e.xml"/>'
    assert "1 detector" in one(make(additional=detector), "outputs").what


def netgenerate(folder: Path, *arguments: str) -> Path:
    import sumo

    net = folder / "n.net.xml"
    tool = Path(sumo.SUMO_HOME) / "bin" / "netgenerate"
    subprocess.run([tool, "--grid", "--grid.number", "2", "-o", str(net), *arguments], check=True, capture_output=True)
    return net


def network_topics(make: Make, net: Path) -> list[tuple[str, str]]:
    """What is found about a network, without the missing demand."""
    return [item for item in grave(make("", net=net)) if item != ("warning", "demand")]


def test_a_network_without_sidewalks_has_no_place_for_pedestrians(make: Make, tmp_path: Path) -> None:
    finding = next(f for f in examine(read_scenario(make("", net=netgenerate(tmp_path)))) if f.topic == "surfaces")
    assert finding.severity == "note"
    assert "pedestrian" in finding.what
    assert "--sidewalks.guess" in finding.fix


def test_a_network_without_streets_is_a_problem(make: Make, tmp_path: Path) -> None:
    net = netgenerate(tmp_path, "--default.allow", "rail")
    assert network_topics(make, net) == [("problem", "surfaces")]


def test_sidewalks_without_crossings(make: Make, tmp_path: Path) -> None:
    assert ("note", "crossings") in network_topics(make, netgenerate(tmp_path, "--sidewalks.guess"))
    with_crossings = network_topics(make, netgenerate(tmp_path, "--sidewalks.guess", "--crossings.guess"))
    assert ("note", "crossings") not in with_crossings


def test_vehicles_that_jump_across_junctions(make: Make, tmp_path: Path) -> None:
    net = netgenerate(tmp_path, "--no-internal-links", "--default.speed", "8")
    # Without lanes inside junctions, turns have no radius.
    assert network_topics(make, net) == [("warning", "junctions"), ("note", "sharp turns")]
    assert "learned ones collide there" in one(make("", net=net), "junctions").what


def test_lanes_for_overtaking_on_the_opposite_lane_are_named(make: Make, tmp_path: Path) -> None:
    nodes = STRAIGHT + '<node id="m" x="50" y="0"/>'
    edges = "".join(f'<edge id="{n}" from="{n[0]}" to="{n[1]}" speed="8"/>' for n in ("am", "mb", "bm", "ma"))
    words = ("--no-turnarounds", "--opposites.guess")
    assert network_topics(make, make_net(tmp_path, nodes, edges, *words)) == [("note", "overtaking")]
    found = one(make("", net=tmp_path / "n.net.xml"), "overtaking").what
    assert found.startswith("4 lanes have an opposite lane for overtaking (am_0, bm_0, ma_0, …)")
    assert network_topics(make, make_net(tmp_path, nodes, edges, *words[:1])) == []


def test_speeds_that_models_do_not_keep_are_named(make: Make) -> None:
    types = (
        '<vType id="slow" vClass="pedestrian" desiredMaxSpeed="0.6"/>'
        '<vType id="usual" vClass="pedestrian" speedFactor="normc(1.0,0.1,0.2,2)"/><vType id="rides" vClass="bicycle"/>'
        '<vTypeDistribution id="d"><vType id="runs" vClass="pedestrian" speedFactor="norm(2,.1)"/></vTypeDistribution>'
        '<vType id="races" vClass="bicycle" desiredMaxSpeed="11" maxSpeed="12"/>'
        '<vType id="held" vClass="bicycle" desiredMaxSpeed="11" maxSpeed="6"/><vType id="car" maxSpeed="50"/>'
    )
    found = one(make(CAR, types), "speeds")
    assert found.severity == "note"
    assert "3 vehicle types want them (races, runs, slow)" in found.what
    assert "walk with speed" not in found.what
    walks = "".join(
        f'<person id="p{n}" depart="1"><walk edges="in0" {words}/></person>'
        for n, words in enumerate(('speed="1"', 'duration="90"', ""))
    )
    assert "2 persons or person flows have a walk with speed or duration" in one(make(CAR + walks), "speeds").what
    assert ("note", "speeds") not in grave(make(CAR + '<person id="p" depart="1"><walk edges="in0"/></person>'))


STRAIGHT = '<node id="a" x="0" y="0"/><node id="b" x="100" y="0"/>'


def test_a_bridge_is_noted_and_a_junction_is_none(make: Make, tmp_path: Path) -> None:
    nodes = STRAIGHT + '<node id="c" x="50" y="-50"/><node id="d" x="50" y="50"/>'
    edges = '<edge id="ab" from="a" to="b" speed="8"/><edge id="cd" from="c" to="d" speed="8"/>'
    net = make_net(tmp_path, nodes, edges)
    assert network_topics(make, net) == [("note", "bridges")]
    assert "ab over or under cd" in one(make("", net=net), "bridges").what
    nodes += '<node id="m" x="50" y="0"/>'
    edges = "".join(f'<edge id="{n}" from="{n[0]}" to="{n[1]}" speed="8"/>' for n in ("am", "mb", "cm", "md"))
    assert network_topics(make, make_net(tmp_path, nodes, edges)) == []


def test_edges_shorter_than_a_car_are_counted_and_named(make: Make, tmp_path: Path) -> None:
    nodes = STRAIGHT + '<node id="c" x="103" y="0"/><node id="d" x="200" y="0"/>'
    edges = "".join(f'<edge id="{n}" from="{n[0]}" to="{n[1]}" speed="8"/>' for n in ("ab", "bc", "cd"))
    net = make_net(tmp_path, nodes, edges)
    assert network_topics(make, net) == [("note", "short edges")]
    assert one(make("", net=net), "short edges").what.startswith("1 of 3 edges for cars")
    assert "(bc 3.0 m)" in one(make("", net=net), "short edges").what


def test_a_network_of_a_newer_sumo(make: Make, tmp_path: Path) -> None:
    net = tmp_path / "n.net.xml"
    net.write_text(re.sub(r'<net version="[^"]*"', '<net version="9.9" lefthand="true"', NET.read_text()))
    assert grave(make(net=net)) == [("warning", "versions")]


def test_the_gravest_come_first(make: Make) -> None:
    severities = [severity for severity, _ in grave(make("", mesosim="true", end=None))]
    assert severities == ["problem", "warning", "note"]


def test_sumo_s_own_reason_is_told_and_sumo_is_free_again(make: Make, tmp_path: Path) -> None:
    config = make()
    (tmp_path / "a.add.xml").write_text('<additional><busStop id="b" lane="gone_0"/></additional>')
    finding = one(config, "SUMO")
    assert finding.severity == "problem"
    assert "gone_0" in finding.what
    assert grave(make()) == []


def test_nothing_is_written_beside_the_scenario(make: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    detector = '<inductionLoop id="e" lane="in0_1" pos="5" period="60" file="e.xml"/>'
    config = make(additional=detector, tripinfo_output="t.xml", log="l.txt", netstate_dump="n.xml")
    before = {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in tmp_path.rglob("*")}
    examine(read_scenario(config))
    assert {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in tmp_path.rglob("*")} == before


def command(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-m", "slrl_sumo", "doctor", *arguments]
    return subprocess.run(program, capture_output=True, text=True, cwd=folder, env={**os.environ, "COLUMNS": "60"})


def test_command_line_of_a_scenario_that_can_be_run(make: Make, tmp_path: Path) -> None:
    done = command(str(make(step_length=None)), "--json", "out.json", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    data = json.loads((tmp_path / "out.json").read_text())
    assert data["can_run"] is True
    assert [f["topic"] for f in data["findings"]] == ["step length", "sublane model", "surfaces"]
    # Nothing is cut off: every word of every finding is in the table, whatever the width.
    words = set(done.stdout.split())
    for finding in data["findings"]:
        assert set(" ".join(finding.values()).split()) <= words


def test_command_line_of_a_scenario_that_cannot(make: Make, tmp_path: Path) -> None:
    done = command(str(make(mesosim="true")), "--json", "out.json", folder=tmp_path)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"slrl-sumo: {tmp_path / 'x.sumocfg'}: cannot be run: ")
    assert "remove the option mesosim" in line
    assert "mesosim" in done.stdout
    assert json.loads((tmp_path / "out.json").read_text())["can_run"] is False


def test_turns_that_the_models_cannot_follow_are_counted_and_the_tightest_is_named(make: Make, tmp_path: Path) -> None:
    nodes = STRAIGHT + '<node id="c" x="50" y="60"/>'
    edges = "".join(f'<edge id="{n}" from="{n[0]}" to="{n[1]}" speed="8"/>' for n in ("ab", "bc"))
    net = make_net(tmp_path, nodes, edges)
    cars, bicycles = (f for f in examine(read_scenario(make("", net=net))) if f.topic == "sharp turns")
    assert cars.severity == bicycles.severity == "note"
    assert cars.what.startswith("1 turn of 1 for cars is tighter than the models of bundle 'intersection'")
    assert "from ab to bc" in bicycles.what
    # A bend of 45 degrees can be followed.
    assert network_topics(make, make_net(tmp_path, nodes.replace('x="50" y="60"', 'x="160" y="60"'), edges)) == []


@pytest.mark.parametrize(
    ("lane", "topic"), [('width="inf"', "lane widths"), ('width="0"', "lane widths"), ('allow="-1"', "permissions")]
)
def test_odd_lanes_are_counted(make: Make, tmp_path: Path, lane: str, topic: str) -> None:
    net = tmp_path / "n.net.xml"
    name = lane.partition("=")[0]
    line = re.search('<lane id="in0_0"[^>]*', NET.read_text())
    assert line
    bare = re.sub(f' {name}="[^"]*"', "", line[0])
    net.write_text(NET.read_text().replace(line[0], bare.replace("<lane", f"<lane {lane}")))
    finding = one(make(net=net), topic)
    assert finding.what.startswith("1 lane ")
    assert "in0_0" in finding.what


def test_edges_that_may_remove_vehicles_are_counted(make: Make) -> None:
    additional = (
        '<calibrator id="c" edge="in0" pos="0" period="60"><flow begin="0" end="60" vehsPerHour="0"/></calibrator>'
        '<vaporizer id="in1" begin="0" end="60"/>'
    )
    finding = one(make(additional=additional), "removing edges")
    assert finding.what == "2 edges have a calibrator or vaporizer (in0, in1), which may remove vehicles"


def test_vehicles_that_models_do_not_suit_are_told_before_a_run(make: Make) -> None:
    types = (
        '<vType id="bus" vClass="bus"/><vType id="van" length="6.5"/><vType id="tricycle" vClass="bicycle" length="3"/>'
        '<vTypeDistribution id="mixed"><vType id="m" vClass="motorcycle"/><vType id="p"/></vTypeDistribution>'
        '<vTypeDistribution id="named" vTypes="bus p"/>'
    )

    def vehicle(number: int, vtype: str) -> str:
        return f'<vehicle id="v{number}" type="{vtype}" depart="{number}"><route edges="in0 out2"/></vehicle>'

    demand = types + "".join(
        vehicle(n, t) for n, t in enumerate(["p", "tricycle", "bus", "bus", "van", "mixed", "named"])
    )
    finding = one(make(demand + CAR.replace('depart="1"', 'depart="9"')), "vehicle classes")
    assert finding.severity == "note"
    assert ": class bus 3, size 1, class motorcycle 1 (size: longer than 5.7 m" in finding.what
    assert "vehicle classes" not in {topic for _, topic in grave(make(types + vehicle(0, "p") + CAR))}


def test_lanes_that_are_too_fast_for_the_models_are_told_before_a_run(bare_network: Callable[[str], Path]) -> None:
    edges = '<edge id="slow" from="a" to="b" numLanes="1" speed="13.89"/>'
    fast = bare_network(edges + '<edge id="fast" from="b" to="c" numLanes="2" speed="50"/>')
    finding = one(fast, "fast lanes")
    assert finding.severity == "note"
    assert finding.what.startswith("2 lanes have limits far above the top speed of bundle 'intersection' (")
    assert "): 0.2 of 0.3 km for cars, up to 50 m/s" in finding.what
    assert "fast lanes" not in {topic for _, topic in grave(bare_network(edges))}
