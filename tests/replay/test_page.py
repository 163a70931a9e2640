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
    where = r"^\d\d% of the positions in .*own.xml lie off the network district, which reaches from \(-3, -8\) to"
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


@pytest.fixture(scope="module")
def signalised(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """SUMO's own trace of the signalised intersection, and what its signals showed, as SUMO writes it."""
    folder = tmp_path_factory.mktemp("signals")
    (folder / "tls.add.xml").write_text(
        '<additional><timedEvent type="SaveTLSStates" source="centre" dest="tls.xml"/></additional>'
    )
    words = ["-c", find_scenario("signalised").config, "--end", "60", "--no-step-log", "--seed", "1"]
    words += ["--fcd-output", folder / "own.csv", "-a", folder / "tls.add.xml"]
    subprocess.run([str(SUMO), *map(str, words)], cwd=folder, check=True, capture_output=True, timeout=60)
    return folder


def test_signals_of_sumos_own_output_lie_at_the_stop_lines(signalised: Path, cli: Cli) -> None:
    words = ("replay", "own.csv", "--net", "signalised", "--out", "a.html")
    assert cli(*words, cwd=signalised).returncode == 0
    assert header(signalised / "a.html")["signals"] == []
    done = cli(*words, "--signals", "tls.xml", cwd=signalised)
    assert done.returncode == 0, done.stderr
    (found,) = header(signalised / "a.html")["signals"]
    truth = [(e.get("time"), e.get("state", "")) for e in etree.parse(str(signalised / "tls.xml")).getroot()]
    shown = dict(zip(np.cumsum(found["times"]).tolist(), found["states"], strict=True))
    state = ""
    for time, letters in truth:
        state = shown.get(round(1000 * float(time or "")), state)
        assert state == letters
    assert len(shown) >= 4
    # Twelve lanes end at stop lines with a width of all their links, four crossings have two ends.
    net = etree.parse(str(find_scenario("signalised").config.with_name("signalised.net.xml"))).getroot()
    lanes = {lane.get("id"): lane for lane in net.iter("lane")}
    ends = {}
    for connection in net.iter("connection"):
        if connection.get("tl") and not str(connection.get("from")).startswith(":"):
            lane = lanes[f"{connection.get('from')}_{connection.get('fromLane')}"]
            ends[int(connection.get("linkIndex", ""))] = [
                float(v) for v in lane.get("shape", "").split()[-1].split(",")
            ]
    bars = {link: np.reshape(bar, (2, 2)) / 100 for link, *bar in found["bars"]}
    assert bars.keys() == set(range(len(truth[0][1])))
    for link, end in ends.items():
        assert np.hypot(*(bars[link].mean(axis=0) - end)) < 0.5 * 3.2 + 0.5
    crossings = [bar for link, *bar in found["bars"] if link not in ends]
    assert len(crossings) == 8
    assert {round(float(np.hypot(*np.diff(np.reshape(bar, (2, 2)), axis=0)[0]))) for bar in crossings} == {400}


def test_a_run_has_its_signals_and_learned_road_users_in_the_page(cli: Cli, tmp_path: Path) -> None:
    run = ("run", "signalised", "--agents", 3, "--takeover", "car=1", "--steps", 60, "--quiet", "--fcd")
    for name in ("a.xml.gz", "b.csv"):
        assert cli(*run, name, cwd=tmp_path).returncode == 0
        done = cli("replay", name, "--net", "signalised", "--out", f"{name}.html", cwd=tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
    assert sorted(file.name for file in tmp_path.iterdir() if file.suffix != ".html") == [
        *("a.learned.csv", "a.signals.xml", "a.xml.gz", "b.csv", "b.signals.xml"),
    ]
    xml, table = header(tmp_path / "a.xml.gz.html"), header(tmp_path / "b.csv.html")
    assert xml["signals"] == table["signals"]
    assert xml["marks_learned"] is table["marks_learned"] is True
    assert xml["streams"][-1] == table["streams"][-1] > 100  # modes
    written = [e.get("state") for e in etree.parse(str(tmp_path / "a.signals.xml")).getroot()]
    assert [signal["states"] for signal in xml["signals"]] == [written]
    assert len(written) > 2


def test_files_beside_a_trace_that_do_not_fit_are_told(signalised: Path, cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes((signalised / "own.csv").read_bytes())
    (tmp_path / "a.signals.xml").write_text("<tlsStates>")
    done = cli("replay", "a.csv", "--net", "signalised", "--out", "a.html", cwd=tmp_path)
    assert done.returncode == 0
    assert done.stderr.startswith("note: a.signals.xml, line 1: is not well-formed XML")
    assert done.stderr.endswith("; the page shows no signals\n")
    done = cli("replay", "a.csv", "--net", "signalised", "--out", "a.html", "--signals", "a.signals.xml", cwd=tmp_path)
    assert done.returncode == 1
    done = cli("replay", "a.csv", "--net", "signalised", "--out", "a.signals.xml.html", cwd=tmp_path)
    assert done.returncode == 0
    (tmp_path / "s.xml").write_text('<tlsStates><tlsState time="0" id="other" state="G"/></tlsStates>')
    done = cli("replay", "a.csv", "--net", "signalised", "--out", "a.html", "--signals", "s.xml", cwd=tmp_path)
    assert done.returncode == 1
    assert "s.xml: the network signalised has none of its traffic lights" in done.stderr
    rows = '<vehicle id="a" x="0" y="100" angle="0"/>'
    (tmp_path / "c.xml").write_text(f'<fcd-export><timestep time="0">{rows}</timestep></fcd-export>')
    (tmp_path / "c.learned.csv").write_text("timestep_time;vehicle_id;person_id;mode\n0.00;b;;3\n")
    done = cli("replay", "c.xml", "--net", "signalised", "--out", "c.html", cwd=tmp_path)
    assert done.returncode == 0
    assert "c.learned.csv: 1 of its 1 rows are not in the trace" in done.stderr
    assert not header(tmp_path / "c.html")["marks_learned"]
