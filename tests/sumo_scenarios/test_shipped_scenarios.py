"""What ships is what netgen makes, and plain SUMO runs it to the end with nothing to say."""

import subprocess
import sys
from pathlib import Path

import pytest
from lxml import etree

from slrl_sumo import scenarios
from slrl_sumo.netgen.binaries import binary
from slrl_sumo.netgen.reach import CLASSES, reachable, read_graph
from slrl_sumo.netgen.shipped import SHIPPED, main

SHIPPED_FOLDER = Path(scenarios.__file__).parent
NAMES = ("intersection", "signalised", "shared-space", "district")


def net_of(name: str) -> bytes:
    return (SHIPPED_FOLDER / name / f"{name}.net.xml").read_bytes()


def test_the_shipped_scenarios_are_the_promised_ones() -> None:
    folders = {p.name for p in SHIPPED_FOLDER.iterdir() if p.is_dir() and p.name != "__pycache__"}
    assert folders == set(NAMES) == set(SHIPPED)


def test_made_again_in_another_process_they_are_the_same_byte_for_byte(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "slrl_sumo.netgen.shipped", "--out", str(tmp_path)], check=True, capture_output=True
    )
    for name in NAMES:
        shipped, made = (
            {f.name: f.read_bytes() for f in (folder / name).iterdir()} for folder in (SHIPPED_FOLDER, tmp_path)
        )
        assert shipped == made


@pytest.mark.parametrize("name", NAMES)
def test_plain_sumo_runs_it_to_the_end_with_nothing_to_say(name: str, tmp_path: Path) -> None:
    outputs = ["--duration-log.statistics", "--statistic-output", str(tmp_path / "statistics.xml")]
    outputs += ["--tripinfo-output", str(tmp_path / "trips.xml")]
    config = SHIPPED_FOLDER / name / f"{name}.sumocfg"
    done = subprocess.run([binary("sumo"), "-c", str(config), *outputs], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stderr == ""
    statistics = etree.parse(tmp_path / "statistics.xml")
    vehicles, safety = statistics.find("vehicles"), statistics.find("safety")
    assert statistics.find("performance").get("end") == "600.00"
    assert (vehicles.get("waiting"), safety.get("collisions")) == ("0", "0")
    # No gridlock: few are still on their way, and every type gets through in numbers.
    assert int(vehicles.get("running")) < 30
    trips = [row.get("id") for row in etree.parse(tmp_path / "trips.xml").getroot()]
    arrived = {c: sum(i.startswith(f"{c}.") for i in trips) for c in CLASSES}
    assert arrived["passenger"] >= 20
    assert arrived["bicycle"] >= 10
    assert arrived["pedestrian"] >= 20


@pytest.mark.parametrize("name", NAMES)
def test_it_has_surfaces_for_all_types_and_all_its_ends_are_connected(name: str) -> None:
    graph = read_graph(net_of(name))
    inward = {i: e.start for i, e in graph.edges.items() if e.start in graph.dead_ends}
    outward = {i: e.end for i, e in graph.edges.items() if e.end in graph.dead_ends}
    assert len(inward) >= 4
    for vehicle_class in CLASSES:
        assert all(vehicle_class in e.classes for e in graph.edges.values())
        for start, end_of_start in inward.items():
            others = {i for i, end in outward.items() if end != end_of_start}
            assert others <= reachable(graph, start, vehicle_class)


def test_each_holds_what_its_name_says() -> None:
    roots = {name: etree.fromstring(net_of(name)) for name in NAMES}
    crossings = {name: len(root.findall("edge[@function='crossing']")) for name, root in roots.items()}
    assert (crossings["intersection"], crossings["signalised"], crossings["shared-space"]) == (4, 4, 0)
    assert crossings["district"] > 10
    signals = {name: len(root.findall("tlLogic")) for name, root in roots.items()}
    assert (signals["intersection"], signals["signalised"], signals["shared-space"]) == (0, 1, 0)
    assert signals["district"] >= 2
    # Sidewalk and cycle lane besides the car lanes; one surface for all on the shared space.
    lanes = {name: len(roots[name].findall("edge[@id='in0']/lane")) for name in NAMES if name != "district"}
    assert lanes == {"intersection": 3, "signalised": 4, "shared-space": 1}
    assert all(len(net_of(name)) < 200_000 for name in NAMES)


def test_the_program_reports_an_unwritable_folder_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["--out", str(tmp_path / "file")]) == 1
    said = capsys.readouterr().err
    assert said.startswith("Error: cannot write the scenario to")
    assert said.count("\n") == 1
