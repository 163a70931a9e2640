import gzip
import os
import resource
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sumo
import sumolib
from builders import make_world
from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import CSV_COLUMNS, Heights, Places
from slrl_sumo.formats.fcd.write import FcdWriter, open_fcd
from slrl_sumo.scene.state import WorldState, empty_world

HOME = Path(sumo.SUMO_HOME)


def scene(time: float, n: int = 6) -> tuple[WorldState, Places]:
    """Road users of all types along a line; every third is a person, every fourth has no lane."""
    i = np.arange(n)
    kind = (i % 3).astype(np.int8)
    world = make_world(
        10.0 * i + time,
        100.0 - i,
        0.3 * i - 1,
        1.0 + i,
        type=kind,
        learned=i % 2 == 0,
        ids=[f"u{k}" for k in i],
        time=time,
    )
    places = Places(
        sumo_type=tuple(("passenger", "bicycle", "pedestrian")[k] for k in kind),
        lane=tuple("" if k % 4 == 3 else f"edge{k}" if k % 3 == 2 else f"edge{k}_0" for k in i),
        lane_position=np.where(i % 4 == 3, np.nan, 5.0 * i),
        person=kind == 2,
    )
    return world, places


def write(path: Path, steps: int = 3, n: int = 6) -> None:
    with FcdWriter(path) as writer:
        for k in range(steps):
            world, places = scene(0.4 * k, n)
            writer.write(world.time, world, places)


def text_of(path: Path) -> str:
    data = path.read_bytes()
    return (gzip.decompress(data) if path.suffix == ".gz" else data).decode()


def validate(path: Path) -> etree._Element:
    schema = etree.XMLSchema(file=str(HOME / "data" / "xsd" / "fcd_file.xsd"))
    root = etree.fromstring(text_of(path).encode())
    schema.assertValid(root)
    return root


def hill(time: float, n: int = 4) -> tuple[WorldState, Places]:
    """`scene` in a network with heights."""
    world, places = scene(time, n)
    slope = np.where(np.arange(n) % 4 == 3, np.nan, -2.756)
    return world, replace(places, heights=Heights(100.0 + np.arange(n), slope))


def test_heights_are_where_sumo_writes_them(tmp_path: Path) -> None:
    world, places = hill(0.0)
    for name in ("t.xml", "t.csv"):
        with open_fcd(tmp_path / name, elevated=True) as writer:
            writer.write(0.0, world, places)
    vehicle, _, nowhere, person = validate(tmp_path / "t.xml")[0]
    assert list(vehicle.attrib) == ["id", "x", "y", "z", "angle", "type", "speed", "pos", "lane", "slope"]
    assert list(person.attrib) == ["id", "x", "y", "z", "angle", "type", "speed", "pos", "edge", "slope"]
    assert (person.get("z"), person.get("slope"), person.get("edge")) == ("102.000", "-2.76", "edge2")
    assert list(nowhere.attrib) == ["id", "x", "y", "z", "angle", "type", "speed"]
    head, *rows = text_of(tmp_path / "t.csv").splitlines()
    table = [dict(zip(head.split(";"), row.split(";"), strict=True)) for row in rows]
    assert head.split(";")[:5] == ["timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_z"]
    assert [row["vehicle_z"] for row in table] == ["100.000", "101.000", "103.000", "102.000"]
    assert [row["vehicle_slope"] for row in table] == ["-2.76", "-2.76", "", "-2.76"]


@pytest.mark.parametrize("name", ["t.xml", "t.csv", "t.parquet"])
def test_heights_are_in_all_steps_or_in_none(tmp_path: Path, name: str) -> None:
    for elevated, step in ((True, scene), (False, hill)):
        with (
            open_fcd(tmp_path / name, elevated=elevated) as writer,
            pytest.raises(ValueError, match="in all time steps"),
        ):
            writer.write(0.0, *step(0.0))


def test_xml_is_what_sumo_would_write(tmp_path: Path) -> None:
    world, places = scene(0.0, 4)
    with FcdWriter(tmp_path / "t.xml") as writer:
        writer.write(0.0, world, places)
        writer.write(0.4, empty_world(), Places((), (), np.zeros(0), np.zeros(0, np.bool_)))
    x = 2.5 * np.cos(-1)
    assert text_of(tmp_path / "t.xml") == (
        '<?xml version="1.0" encoding="UTF-8"?>\n\n'
        '<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        'xsi:noNamespaceSchemaLocation="http://sumo.dlr.de/xsd/fcd_file.xsd">\n'
        '    <timestep time="0.00">\n'
        f'        <vehicle id="u0" x="{x:.3f}" y="97.896" angle="147.30" type="passenger" speed="1.000" '
        'pos="0.000" lane="edge0_0" slope="0.00"/>\n'
        '        <vehicle id="u1" x="10.612" y="98.485" angle="130.11" type="bicycle" speed="2.000" '
        'pos="5.000" lane="edge1_0" slope="0.00"/>\n'
        '        <vehicle id="u3" x="32.488" y="96.750" angle="95.73" type="passenger" speed="4.000" slope="0.00"/>\n'
        '        <person id="u2" x="20.099" y="97.958" angle="112.92" type="pedestrian" speed="3.000" '
        'pos="10.000" edge="edge2" slope="0.00"/>\n'
        "    </timestep>\n"
        '    <timestep time="0.40"/>\n'
        "</fcd-export>\n"
    )


@pytest.mark.parametrize("suffix", [".xml", ".xml.gz"])
def test_xml_is_valid_and_sumolib_reads_it(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"t{suffix}"
    write(path, steps=4, n=9)
    root = validate(path)
    assert len(root) == 4
    assert [e.tag for e in root[0]] == ["vehicle"] * 6 + ["person"] * 3
    steps = list(sumolib.xml.parse(str(path), "timestep"))
    assert [s.time for s in steps] == ["0.00", "0.40", "0.80", "1.20"]
    assert [p.id for p in steps[1].person] == ["u2", "u5", "u8"]
    assert [v.id for v in steps[1].vehicle] == ["u0", "u1", "u3", "u4", "u6", "u7"]


def test_sumolib_reads_it_fast(tmp_path: Path) -> None:
    path = tmp_path / "t.xml"
    with FcdWriter(path) as writer:
        for k in range(3):
            world, places = scene(0.4 * k, 3)
            writer.write(world.time, world, places)
    rows = list(sumolib.xml.parse_fast_nested(str(path), "timestep", ["time"], "vehicle", ["id", "x", "speed", "lane"]))
    assert [(step.time, v.id, v.lane) for step, v in rows] == [
        (time, name, lane) for time in ("0.00", "0.40", "0.80") for name, lane in (("u0", "edge0_0"), ("u1", "edge1_0"))
    ]


def test_sumo_replays_it(tmp_path: Path, cross_fcd: Path) -> None:
    """SUMO's own reader (fcd-replay) takes a file of ours, compressed, and lets the vehicle stand where we said."""
    path, out = tmp_path / "t.xml.gz", tmp_path / "out.xml"
    first = etree.parse(cross_fcd).find("timestep/vehicle")
    assert first is not None
    heading = np.radians(90 - float(first.attrib["angle"]))
    with FcdWriter(path) as writer:
        for k in range(20):
            world, _ = scene(0.4 * k, 1)
            front = [float(first.attrib["x"]), float(first.attrib["y"])] + 4.0 * k * np.array(
                [np.cos(heading), np.sin(heading)]
            )
            world = replace(
                world,
                x=front[:1] - 2.5 * np.cos(heading),
                y=front[1:] - 2.5 * np.sin(heading),
                heading=np.array([heading]),
                speed=np.array([10.0]),
            )
            lane = (first.attrib["lane"],)
            writer.write(world.time, world, Places(("car",), lane, np.array([5.1 + 4 * k]), np.zeros(1, np.bool_)))
    types = tmp_path / "types.add.xml"
    types.write_text('<additional><vType id="car"/></additional>')
    net = HOME / "tools" / "game" / "cross" / "cross.net.xml"
    command = [HOME / "bin" / "sumo", "-n", net, "-a", types, "--device.fcd-replay.files", path]
    subprocess.run([*command, "--step-length", "0.4", "--end", "8", "--fcd-output", out], check=True, timeout=60)
    seen = {s.get("time"): s.find("vehicle") for s in etree.parse(out).getroot()}
    vehicle = seen["4.00"]
    assert vehicle is not None
    assert float(vehicle.attrib["x"]) == pytest.approx(float(first.attrib["x"]) + 40 * np.cos(heading), abs=0.02)


def test_csv_has_the_columns_of_sumo(tmp_path: Path, cross_fcd: Path) -> None:
    path = tmp_path / "t.csv"
    world, places = scene(0.4, 4)
    with FcdWriter(path) as writer:
        writer.write(0.4, world, places)
    lines = text_of(path).splitlines()
    native = cross_fcd.with_suffix(".csv").read_text().splitlines()
    assert native[0] == ";".join(CSV_COLUMNS)
    assert lines[0] == f"{native[0]};mode;learned"
    assert {line.count(";") for line in lines} == {native[1].count(";") + 2}
    assert lines[1].split(";")[4:] == ["147.30", "passenger", "1.000", "0.000", "edge0_0", "", "0.00", "", "1"]
    assert lines[3].split(";")[4:] == ["95.73", "passenger", "4.000", "", "", "", "0.00", "", "0"]
    assert lines[4].split(";")[4:] == ["112.92", "pedestrian", "3.000", "10.000", "", "edge2", "0.00", "", "1"]


def test_csv_has_the_modes_of_learned_road_users(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    world, places = scene(0.0, 6)  # 0, 2 and 4 are learned; 2 and 5 are persons, which come last
    with FcdWriter(path) as writer:
        writer.write(0.0, world, places, np.array([19, 0, 7]))
        with pytest.raises(ValueError, match="2 modes for 3 learned road users"):
            writer.write(0.4, world, places, np.array([1, 2]))
    fields = [line.split(";") for line in text_of(path).splitlines()[1:]]
    assert [(f[1], f[-2], f[-1]) for f in fields] == [
        *(("u0", "19", "1"), ("u1", "", "0"), ("u3", "", "0"), ("u4", "7", "1"), ("u2", "0", "1"), ("u5", "", "0")),
    ]


def test_figures_never_look_odd(tmp_path: Path) -> None:
    world, places = scene(0.0, 3)
    world = replace(
        world,
        x=np.array([-0.0001, -0.0, 0.0]),
        y=np.array([-2.5002, 0.0, 0.0]),
        heading=np.array([np.pi / 2, np.pi / 2 + 1e-9, np.pi / 2 + 2e-5]),
        speed=np.array([-0.0001, -1.0, -0.0]),
    )
    places = replace(places, lane_position=np.array([-0.3, -0.0, -0.0001]))
    with FcdWriter(tmp_path / "t.xml") as writer:
        writer.write(0.0, world, places)
    rows = list(validate(tmp_path / "t.xml")[0])
    assert [r.get("angle") for r in rows] == ["0.00", "0.00", "0.00"]
    assert [r.get("speed") for r in rows] == ["0.000", "0.000", "0.000"]
    assert [r.get("pos") for r in rows] == ["0.000", "0.000", "0.000"]
    assert rows[0].get("x") == rows[0].get("y") == "0.000"


def test_figures_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    world, places = scene(0.4)
    with FcdWriter(tmp_path / "t.xml") as writer:
        with pytest.raises(ValueError, match=r"0\.4 s: positions, headings and speeds must be finite"):
            writer.write(0.4, replace(world, y=world.y * np.nan), places)
        with pytest.raises(ValueError, match="must be finite"):
            writer.write(0.4, world, replace(places, lane=("lane",) * 6))


def test_ids_are_escaped(tmp_path: Path) -> None:
    names = ('a<b>&"c"', "tab\tline\nend", "größe;'x'")
    world, places = scene(0.0, 3)
    world = replace(world, ids=names)
    places = replace(places, lane=("l<1>", 'l"2"', "l&3"))
    for path in (tmp_path / "t.xml", tmp_path / "t.xml.gz"):
        with FcdWriter(path) as writer:
            writer.write(0.0, world, places)
        rows = list(validate(path)[0])
        assert tuple(r.get("id") for r in rows) == names
        assert [r.get("lane") or r.get("edge") for r in rows] == list(places.lane)
    with FcdWriter(tmp_path / "u.xml") as writer, pytest.raises(InputError, match=r"id 'a\\x01' has a character"):
        writer.write(0.0, replace(world, ids=("a\x01", "b", "c")), places)


@pytest.mark.parametrize("suffix", [".xml", ".xml.gz", ".csv"])
def test_the_same_run_gives_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    first, second = tmp_path / f"one{suffix}", tmp_path / f"two{suffix}"
    write(first, n=50)
    write(second, n=50)
    assert first.read_bytes() == second.read_bytes()
    if suffix == ".xml.gz":
        assert first.read_bytes()[3:8] == b"\0" * 5  # no flags (file name), no time


@pytest.mark.parametrize("suffix", [".xml", ".xml.gz"])
def test_an_interrupted_run_leaves_whole_steps(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"t{suffix}"

    def interrupted() -> None:
        with FcdWriter(path) as writer:
            for k in range(3):
                world, places = scene(0.4 * k)
                writer.write(world.time, world, places)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [s.get("time") for s in validate(path)] == ["0.00", "0.40", "0.80"]


@pytest.mark.parametrize("suffix", [".xml", ".xml.gz"])
def test_the_file_is_valid_even_while_it_is_written(tmp_path: Path, suffix: str) -> None:
    """A process that is killed closes nothing."""
    path = tmp_path / f"t{suffix}"
    writer = FcdWriter(path)
    assert len(validate(path)) == 0
    for k in range(12):
        world, places = scene(0.4 * k, 0 if k == 7 else 7)
        writer.write(world.time, world, places)
        assert len(validate(path)) == k + 1, "a step that was written is not on disk"
    writer.close()
    assert len(validate(path)) == 12


def test_csv_on_disk_ends_with_the_last_step(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    with FcdWriter(path) as writer:
        for k in range(3):
            writer.write(0.4 * k, *scene(0.4 * k))
            rows = text_of(path).splitlines()[1:]
            assert len(rows) == 6 * (k + 1)


@pytest.mark.parametrize("suffix", [".xml", ".xml.gz"])
def test_a_full_disk_leaves_whole_steps(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"t{suffix}"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill() -> None:
        with FcdWriter(path) as writer:
            for k in range(100):
                world, places = scene(0.4 * k, 300)
                writer.write(world.time, world, places)

    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (400_000 if suffix == ".xml" else 100_000, limits[1]))
        with pytest.raises(InputError, match=r"cannot write .*t\.xml.*: File too large"):
            fill()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    steps = validate(path)
    assert 5 < len(steps) < 100
    assert {len(s) for s in steps} == {300}


def test_after_close_nothing_can_be_written(tmp_path: Path) -> None:
    writer = FcdWriter(tmp_path / "t.xml")
    writer.close()
    writer.close()
    with pytest.raises(ValueError, match="is closed"):
        writer.write(0.0, *scene(0.0))


def test_a_bad_path_is_reported_before_the_run(tmp_path: Path) -> None:
    for name in ("t.parq", "t.txt", "xml", "t.gz"):
        with pytest.raises(InputError, match=r"FCD files end in \.xml, \.xml\.gz, \.csv or \.parquet"):
            open_fcd(tmp_path / name)
    with pytest.raises(InputError, match=r"/missing/t\.xml: the folder .*/missing does not exist"):
        FcdWriter(tmp_path / "missing" / "t.xml")
    (tmp_path / "folder.xml").mkdir()
    with pytest.raises(InputError, match="is a folder; name a file"):
        FcdWriter(tmp_path / "folder.xml")
    (tmp_path / "full.xml").symlink_to("/dev/full")
    with pytest.raises(InputError, match="is a device or a pipe; name a file"):
        FcdWriter(tmp_path / "full.xml")
    os.mkfifo(tmp_path / "pipe.xml")  # opening it would wait for a reader
    with pytest.raises(InputError, match="is a device or a pipe; name a file"):
        FcdWriter(tmp_path / "pipe.xml")
    with pytest.raises(InputError, match="open_fcd"):
        FcdWriter(tmp_path / "t.parquet")
