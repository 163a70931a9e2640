"""The replay page as the command line writes it; what it does in a browser is in test_replay_page.py."""

import base64
import gzip
import json
import subprocess
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sumo
from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.table import read_table
from slrl_sumo.replay.page import describe, write_replay
from slrl_sumo.replay.vehicle_sizes import class_of, scenario_sizes, size_of
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.scenario import find_scenario

Cli = Callable[..., subprocess.CompletedProcess[str]]
CONFIG = find_scenario("intersection").config
NET = CONFIG.with_name("intersection.net.xml")
SUMO = Path(sumo.SUMO_HOME) / "bin" / "sumo"


def header(page: Path) -> dict[str, Any]:
    """What the page knows beside the rows."""
    root = etree.HTML(page.read_bytes())
    (data,) = root.xpath("//script[@id='data']/text()")
    raw = zlib.decompress(base64.b64decode(data), wbits=-15)
    size = int.from_bytes(raw[:4], "little")
    found: dict[str, Any] = json.loads(raw[4 : 4 + size])
    assert sum(found["streams"]) == len(raw) - 4 - size
    return found


@pytest.fixture(scope="module")
def sumo_traces(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """SUMO's own FCD of the same 40 s in all formats, with steps of 0.5 s."""
    folder = tmp_path_factory.mktemp("traces")
    for name in ("own.xml", "own.xml.gz", "own.csv", "own.parquet"):
        words = ["-c", CONFIG, "--end", 40, "--step-length", 0.5, "--seed", 3, "--no-step-log", "--fcd-output", name]
        subprocess.run([str(SUMO), *map(str, words)], cwd=folder, check=True, capture_output=True, timeout=60)
    return folder


@pytest.mark.parametrize("name", ["own.xml", "own.xml.gz", "own.csv", "own.parquet"])
def test_sumos_own_traces_keep_their_steps_ids_types_and_sizes(name: str, sumo_traces: Path) -> None:
    page = sumo_traces / f"{name}.html"
    write_replay(sumo_traces / name, "intersection", page)
    found = header(page)
    assert found["notes"] == []
    truth = etree.parse(str(sumo_traces / "own.xml")).getroot()
    times = [round(1000 * float(step.get("time", ""))) for step in truth]
    assert np.cumsum(found["times"]).tolist() == times
    types = {e.get("id"): e.get("type") for step in truth for e in step}
    users = found["users"]
    assert dict(zip(users["id"], (found["vtypes"][i] for i in users["vtype"]), strict=True)) == types
    persons = {e.get("id") for step in truth for e in step.iter("person")}
    kinds = dict(zip(users["id"], users["kind"], strict=True))
    assert {i for i, kind in kinds.items() if kind == RoadUserType.PEDESTRIAN} == persons
    assert persons
    vtypes = {e.get("id"): e for e in etree.parse(str(CONFIG.with_name("intersection.rou.xml"))).iter("vType")}
    for user, length in zip(users["id"], users["length"], strict=True):
        if vtypes[types[user]].get("length"):
            assert length == pytest.approx(float(vtypes[types[user]].get("length")), abs=0.01)
    assert {shape[0] for shape in found["ground"]} == {
        *("junction", "walkingarea", "sidewalk", "cycleway", "road", "crossing")
    }


def test_a_network_file_will_do_too(sumo_traces: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed.net.xml.gz"
    packed.write_bytes(gzip.compress(NET.read_bytes()))
    for net in (NET, packed, CONFIG, CONFIG.parent):
        write_replay(sumo_traces / "own.xml", str(net), tmp_path / "page.html")
        assert len(header(tmp_path / "page.html")["ground"]) > 30


def test_a_trace_that_is_cut_off_is_shown_as_far_as_it_goes(sumo_traces: Path, cli: Cli, tmp_path: Path) -> None:
    whole = (sumo_traces / "own.xml").read_bytes()
    cut = tmp_path / "cut.xml"
    cut.write_bytes(whole[: len(whole) // 2])
    complete = cut.read_bytes().count(b"</timestep>") + cut.read_bytes().count(b'"/>\n    <timestep')
    done = cli("replay", cut, "--net", NET, "--out", tmp_path / "page.html")
    assert done.returncode == 0
    assert done.stderr.count("\n") == 1
    found = header(tmp_path / "page.html")
    steps = len(found["times"])
    assert f"is cut off; {steps} complete time steps could be read" in done.stderr
    assert 0 <= complete - steps <= 1 < steps
    assert found["notes"] == [done.stderr.removeprefix("note: ").rstrip("\n")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "No such file"),
        ("", "is empty"),
        ("<fcd-export></fcd-export>", "holds no road users"),
        ("<fcd-export><timestep time='0'", "0 complete time steps could be read"),
        ("<routes/>", "<routes> where an FCD file has <fcd-export>"),
        ("<fcd-export><timestep></fcd-export>", "is not well-formed XML"),
    ],
)
def test_what_is_no_trace_gets_one_line(text: str | None, message: str, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / "bad.xml").write_text(text)
    with pytest.raises(InputError, match=r"bad\.xml[^\n]*$") as error:
        write_replay(tmp_path / "bad.xml", str(NET), tmp_path / "page.html")
    assert message in str(error.value)
    assert not (tmp_path / "page.html").exists()


def test_another_network_says_how_much_lies_off_it(sumo_traces: Path, tmp_path: Path) -> None:
    where = r"^\d\d% of the positions in .*own.xml lie off the network district, which reaches from \(-3, -7\) to"
    with pytest.raises(InputError, match=where):
        write_replay(sumo_traces / "own.xml", "district", tmp_path / "page.html")


@pytest.mark.parametrize(
    ("net", "message"),
    [
        ("nowhere.net.xml", "--net nowhere.net.xml: there is no such file"),
        ("nowhere", "--net nowhere: no such file, folder or shipped scenario"),
        (CONFIG.with_name("intersection.rou.xml"), "intersection.rou.xml: SUMO refuses it"),
    ],
)
def test_what_is_no_network_gets_one_line(net: str, message: str, sumo_traces: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^--net [^\n]*$") as error:
        write_replay(sumo_traces / "own.xml", str(net), tmp_path / "page.html")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("out", "message"), [("nowhere/page.html", "create it or name another"), ("page.txt", "ends in .html")]
)
def test_wrong_places_get_one_line(out: str, message: str, sumo_traces: Path, cli: Cli, tmp_path: Path) -> None:
    done = cli("replay", sumo_traces / "own.xml", "--net", "intersection", "--out", tmp_path / out)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert message in done.stderr


def test_sizes_are_the_scenarios_or_guessed_from_names(tmp_path: Path) -> None:
    assert size_of("truck_heavy", RoadUserType.CAR, {}) == (7.1, 2.4)
    assert size_of("Bus12", RoadUserType.CAR, {}) == (12.0, 2.5)
    assert size_of("semitrailer", RoadUserType.CAR, {}) == (16.5, 2.55)
    assert size_of("passenger3", RoadUserType.CAR, {}) == (5.0, 1.8)
    assert size_of("bus_passenger", RoadUserType.PEDESTRIAN, {}) == (0.215, 0.478)
    assert size_of("truck", RoadUserType.CAR, {"truck": (9.0, 2.3)}) == (9.0, 2.3)
    rows = "".join(f'<vehicle id="{i}" x="1" y="{i}" angle="0" type="{t}"/>' for i, t in enumerate(["velo", "Bus", ""]))
    (tmp_path / "t.xml").write_text(f'<fcd-export><timestep time="0">{rows}</timestep></fcd-export>')
    table, _ = read_table(tmp_path / "t.xml")
    users = describe(table, {"velo": (1.9, 0.7)}, {"velo": "bicycle"})
    assert users.kind.tolist() == [RoadUserType.BICYCLE, RoadUserType.CAR, RoadUserType.CAR]
    assert users.length.tolist() == [1.9, 12.0, 5.0]
    assert users.width.tolist() == [0.7, 2.5, 1.8]


def test_classes_tell_bicycles_whatever_they_are_called(tmp_path: Path) -> None:
    for name in ("intersection.net.xml", "intersection.sumocfg"):
        (tmp_path / name).write_bytes(CONFIG.with_name(name).read_bytes())
    (tmp_path / "intersection.rou.xml").write_text(
        '<routes><vType id="velo" vClass="bicycle"/><vType id="long" vClass="truck" length="9.5"/></routes>'
    )
    sizes, kinds = scenario_sizes(find_scenario(str(tmp_path)))
    assert kinds == {"velo": "bicycle"}
    assert sizes["velo"] == (1.6, 0.65)
    assert sizes["long"] == (9.5, 2.4)
    assert sizes["learned_bicycle"] == (1.6, 0.65)


def test_vehicles_have_the_words_of_their_classes() -> None:
    assert [
        class_of(name, 0, {}) for name in ("bus_12", "tram", "myTruck", "motorcycle", "passenger", "learned_car")
    ] == [*("bus", "tram", "lorry", "motorcycle", "", "")]
    assert class_of("line7", 0, {"line7": "bus"}) == "bus"
    assert class_of("bus_lane_car", 0, {"bus_lane_car": "passenger"}) == ""
    assert class_of("bus", 2, {}) == ""
