import gzip
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import sumo
from builders import make_world
from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import CSV_COLUMNS, Places
from slrl_sumo.formats.fcd.read import read_fcd
from slrl_sumo.formats.fcd.trace import TraceWriter
from slrl_sumo.formats.fcd.write import open_fcd
from slrl_sumo.formats.trajectories import Trajectories, road_users
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH

HOME = Path(sumo.SUMO_HOME)
SUFFIXES = [".xml", ".xml.gz", ".csv", ".parquet"]


def row(name: str, x: float, y: float = 0.0, angle: float = 90.0, vtype: str = "t", tag: str = "vehicle") -> str:
    return f'<{tag} id="{name}" x="{x}" y="{y}" angle="{angle}" type="{vtype}" speed="1" pos="0" lane="l" slope="0"/>'


def fcd(path: Path, steps: dict[str, list[str]]) -> Path:
    text = "".join(f'<timestep time="{t}">\n' + "\n".join(rows) + "\n</timestep>\n" for t, rows in steps.items())
    path.write_text(f"<fcd-export>\n{text}</fcd-export>\n")
    return path


def track(t: Trajectories, name: str) -> tuple[list[int], list[float]]:
    rows = t.track == t.ids.index(name)
    return t.frame[rows].tolist(), np.round(t.x[rows] + 0.5 * t.length[t.ids.index(name)], 6).tolist()


def worlds(n: int, steps: int) -> list[tuple[WorldState, Places]]:
    rng = np.random.default_rng(1)
    kind = np.arange(n) % 3
    x, y, heading = rng.uniform(-300, 300, n), rng.uniform(-300, 300, n), rng.uniform(-np.pi, np.pi, n)
    places = Places(
        sumo_type=tuple(("slrl_car", "slrl_bicycle", "slrl_pedestrian")[k] for k in kind),
        lane=tuple(f"e{i}" if i % 4 else "" for i in range(n)),
        lane_position=rng.uniform(0, 90, n),
        person=kind == 2,
    )
    out = []
    for k in range(steps):
        way = rng.uniform(0, 1.5, n)
        x, y = x + way * np.cos(heading), y + way * np.sin(heading)
        heading = np.mod(heading + rng.normal(0, 0.2, n) + np.pi, 2 * np.pi) - np.pi
        world = make_world(x, y, heading, type=kind, ids=[f"a{i}" for i in range(n)], learned=False, time=7.2 + 0.4 * k)
        out.append((world, places))
    return out


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_written_is_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"t{suffix}"
    series = worlds(24, 30)
    with open_fcd(path) as writer:
        for world, places in series:
            writer.write(world.time, world, places)
    t = read_fcd(path)
    assert t.frames == range(30)
    for frame, (world, _) in enumerate(series):
        read = t.world(frame)
        order = [read.ids.index(name) for name in world.ids]
        assert sorted(read.ids) == sorted(world.ids)
        assert read.time == pytest.approx(world.time)
        np.testing.assert_array_equal(read.type[order], world.type)
        np.testing.assert_allclose(read.x[order], world.x, atol=0.001)
        np.testing.assert_allclose(read.y[order], world.y, atol=0.001)
        turn = read.heading[order] - world.heading
        np.testing.assert_allclose(np.cos(turn), 1, atol=1e-7)
        np.testing.assert_array_equal(read.length[order], world.length)
        np.testing.assert_array_equal(read.width[order], world.width)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_speeds_of_sumo_are_ours(cross_fcd: Path, suffix: str) -> None:
    """SUMO moves by the new speed (Euler update): on straight lanes its `speed` is distance over time.

    Up to the rounding of lane lengths in the network (1fi_0: 40.70 m, its shape 40.69 m).
    """
    t = read_fcd(cross_fcd.with_name(f"cross{suffix}"))
    user_of = dict(
        zip(t.ids, road_users(t.ids), strict=True)
    )  # those that turn by 90° in one step go on in a new track
    compared = 0
    for frame, step in enumerate(etree.parse(cross_fcd).getroot()):
        world = t.world(frame)
        assert world.time == pytest.approx(float(step.attrib["time"]))
        users = [user_of[name] for name in world.ids]
        assert sorted(users) == sorted(v.attrib["id"] for v in step)
        for vehicle in step:
            i = users.index(vehicle.attrib["id"])
            before = t.world(frame - 1)
            if world.ids[i] in before.ids and before.heading[before.ids.index(world.ids[i])] == world.heading[i]:
                assert world.speed[i] == pytest.approx(float(vehicle.attrib["speed"]), rel=3e-4, abs=1e-4)
                compared += 1
    assert compared > 150


def test_a_finer_file_gives_the_same_moments(tmp_path: Path) -> None:
    steps = {f"{3 + 0.1 * k:.2f}": [row("a", 2.0 * k), *([row("b", 1.0 * k)] if k != 6 else [])] for k in range(11)}
    t = read_fcd(fcd(tmp_path / "t.xml", steps))
    assert t.t0 == 3.0
    assert track(t, "a") == ([0, 1, 2], [0.0, 8.0, 16.0])
    # b was absent between two moments that are kept: nothing may join them.
    assert track(t, "b") == ([0, 1], [0.0, 4.0])
    assert track(t, "b#1") == ([2], [8.0])


def test_a_file_of_another_step_is_interpolated(tmp_path: Path) -> None:
    steps = {str(k): [row("a", 10.0 * k, angle=(70 + 10 * k) % 360)] for k in range(4) if k}
    t = read_fcd(fcd(tmp_path / "t.xml", steps))
    frames, _ = track(t, "a")
    assert frames == [0, 1, 2, 3, 4, 5]  # 1.0 to 3.0 s
    front = t.x + 2.5 * np.cos(t.heading)
    assert t.t0 == 1.0
    np.testing.assert_allclose(np.degrees(t.heading), [10.0, 6.0, 2.0, -2.0, -6.0, -10.0])
    np.testing.assert_allclose(front, [10.0, 14.0, 18.0, 22.0, 26.0, 30.0], atol=0.02)  # centres are interpolated


def test_angles_are_interpolated_the_short_way(tmp_path: Path) -> None:
    # Heading 170° to -170° within one second.
    t = read_fcd(fcd(tmp_path / "t.xml", {"0": [row("a", 0, angle=280)], "1": [row("a", 0, angle=260)]}))
    np.testing.assert_allclose(np.degrees(t.heading), [170.0, 178.0, -174.0])


def test_interpolation_never_bridges_a_gap(tmp_path: Path) -> None:
    steps: dict[str, list[str]] = {str(k): [row("a", 10.0 * k), row("c", 0.0)] for k in (0, 1, 2, 4, 5)}
    steps["3"] = [row("c", 0.0)]
    t = read_fcd(fcd(tmp_path / "t.xml", dict(sorted(steps.items()))))
    assert track(t, "a") == ([0, 1, 2, 3, 4, 5], [0.0, 4.0, 8.0, 12.0, 16.0, 20.0])
    assert track(t, "a#1") == ([10, 11, 12], [40.0, 44.0, 48.0])


def test_left_out_empty_steps_are_gaps(tmp_path: Path) -> None:
    """SUMO's --fcd-output.skip-empty."""
    t = read_fcd(fcd(tmp_path / "t.xml", {k: [row("a", 0.0)] for k in ("0", "0.4", "2.0", "2.4")}))
    assert t.ids == ("a", "a#1")
    assert t.frame.tolist() == [0, 1, 5, 6]


def test_a_jump_ends_a_track(tmp_path: Path) -> None:
    """At each step of the file: a reinserted at the other rim, b changes the lane in one step, c drives on."""
    for step in (0.1, 0.2, 0.25, 0.4, 1.0):
        moments = np.round(np.arange(0.0, 8.0 + 1e-9, step), 2)
        steps = {
            f"{t:.2f}": [
                row("a", 8.0 * t - (300.0 if t > 4.0 else 0.0)),
                row("b", 8.0 * t, 20.0 + (4.0 if t > 4.0 else 0.0)),
                row("c", 20.0 * t, 40.0),
            ]
            for t in moments.tolist()
        }
        t = read_fcd(fcd(tmp_path / "t.xml", steps))
        assert t.ids == ("a", "a#1", "b", "b#1", "c"), step
        speed = {name: t.speed[t.track == number] for number, name in enumerate(t.ids)}
        np.testing.assert_allclose(np.concatenate([speed[name] for name in t.ids[:4]]), 8.0, err_msg=str(step))
        np.testing.assert_allclose(speed["c"], 20.0)


def test_what_a_type_can_do_is_no_jump(tmp_path: Path) -> None:
    """A pedestrian turns on the spot, a car takes a curve of 6 m at 5 m/s, another is twice as fast as most cars."""
    for step in (0.1, 0.3, 0.4, 1.0):
        moments = np.round(np.arange(0.0, 4.0 + 1e-9, step), 2).tolist()
        angle = [5.0 / 6.0 * t for t in moments]
        steps = {
            f"{t:.2f}": [
                row("p", 1.0, 0.0, 90.0 if t < 2.0 else 270.0, tag="person"),
                row("c", 6.0 * np.sin(a), 60.0 - 6.0 * np.cos(a), 90.0 - np.degrees(a)),
                row("f", 55.0 * t, 90.0),
            ]
            for t, a in zip(moments, angle, strict=True)
        }
        assert read_fcd(fcd(tmp_path / "t.xml", steps)).ids == ("p", "c", "f"), step


@pytest.mark.parametrize("suffix", [".csv", ".xml", ".parquet"])
def test_learned_road_users_and_their_modes_are_read(tmp_path: Path, suffix: str) -> None:
    """a is taken over after 0.8 s, b is learned from the start, c never; modes change every 0.4 s."""
    for step, modes in ((0.2, True), (0.4, True), (0.8, False)):
        path = tmp_path / f"t{suffix}"
        places = Places(("t",) * 3, ("l",) * 3, np.zeros(3), np.zeros(3, np.bool_))
        with TraceWriter(path) as writer:
            for now in np.arange(0.0, 2.4 + 1e-9, step):
                number = int(np.ceil(now / 0.4 - 1e-6))  # of the interval that leads to this moment
                learned = np.array([number > 2, True, False])
                world = make_world(2.0 * now, np.arange(3.0) * 10, 0.0, learned=learned, ids=["a", "b", "c"])
                chosen = np.array([number, 10 + number])[-learned.sum() :] if number else None
                writer.write(now, world, places, chosen)
        t = read_fcd(path)
        assert t.ids == ("a", "a#1", "b", "c")
        assert t.learned.tolist() == [False, True, True, False]
        expected = [*[-1] * 3, 3, 4, 5, 6, -1, 11, 12, 13, 14, 15, 16, *[-1] * 7]
        if modes:
            assert t.mode.tolist() == expected
        else:
            assert (t.mode == -1).all()


def test_a_table_of_learned_road_users_of_another_trace_is_refused(tmp_path: Path) -> None:
    path = fcd(tmp_path / "t.xml", {"0": [row("a", 0)], "0.4": [row("a", 1)]})
    (tmp_path / "t.learned.csv").write_text("timestep_time;vehicle_id;person_id;mode\n0.00;b;;3\n")
    with pytest.raises(InputError, match=r"t\.learned\.csv: 1 of its 1 rows are not in the trace"):
        read_fcd(path)


def test_types_and_sizes(tmp_path: Path) -> None:
    vtypes = ["passenger", "my_Bike", "DEFAULT_BIKETYPE", "motorcycle", "motorbike", "bus", "cyclist", "scooter"]
    rows = [row(v, i, vtype=v) for i, v in enumerate(vtypes)]
    path = fcd(tmp_path / "t.xml", {"0": [*rows, row("p", 50, vtype="x", tag="person")]})
    t = read_fcd(path)
    bicycles = {name for name, kind in zip(t.ids, t.type.tolist(), strict=True) if kind == 1}
    assert bicycles == {"my_Bike", "DEFAULT_BIKETYPE", "cyclist"}
    assert t.type[t.ids.index("p")] == 2
    assert np.count_nonzero(t.type == 0) == 5
    np.testing.assert_array_equal(t.length, DEFAULT_LENGTH[t.type])
    np.testing.assert_array_equal(t.width, DEFAULT_WIDTH[t.type])
    t = read_fcd(path, {"scooter": "bicycle", "x": "car", "my_Bike": "pedestrian"})
    assert [int(t.type[t.ids.index(i)]) for i in ("scooter", "p", "my_Bike", "bus")] == [1, 0, 2, 0]
    with pytest.raises(InputError, match="'bus': 'lorry' is none of car, bicycle, pedestrian"):
        read_fcd(path, {"bus": "lorry"})


def test_the_front_bumper_becomes_the_centre(tmp_path: Path) -> None:
    t = read_fcd(fcd(tmp_path / "t.xml", {"0": [row("a", 10.0, 20.0, 0.0), row("b", 10.0, 20.0, 270.0, "bike")]}))
    np.testing.assert_allclose((t.x, t.y), ([10.0, 10.8], [17.5, 20.0]))


def test_riders_are_left_out_and_ids_may_be_shared(tmp_path: Path) -> None:
    rows = [row("a", 10.0), row("a", 10.5, tag="person"), row("rider", 10.0, tag="person")]
    rows.append('<person id="r" x="1" y="2" angle="3" vehicle="a"/><container id="c" x="1" y="2" angle="3"/>')
    t = read_fcd(fcd(tmp_path / "t.xml", {"0": rows, "0.4": rows}))
    assert t.ids == ("a", "a#1")
    assert t.type.tolist() == [0, 2]


@pytest.mark.parametrize("first", ["vehicle", "person"])
def test_sumos_own_csv_with_persons(tmp_path: Path, first: str) -> None:
    """Whichever comes first names the columns; a rider is at the place of his car."""
    net, routes, out = tmp_path / "n.net.xml", tmp_path / "r.rou.xml", tmp_path / "o.csv"
    grid = ["--grid", "--grid.number=2", "--grid.length=80", "--sidewalks.guess", "--sidewalks.guess.min-speed=0"]
    subprocess.run([HOME / "bin" / "netgenerate", *grid, "-o", net], check=True, capture_output=True, timeout=60)
    depart = {"vehicle": 0.0, "person": 0.4} if first == "vehicle" else {"vehicle": 0.4, "person": 0.0}
    demand = {
        "vehicle": '<trip id="v" depart="{}" from="A0A1" to="A1B1"/>',
        "person": '<person id="p" depart="{}"><walk from="A0A1" to="A1B1"/></person>',
    }
    lines = [demand[k].format(depart[k]) for k in sorted(depart, key=lambda k: depart[k])]
    lines.append(
        '<person id="r" depart="0.8" departPos="28"><ride from="A0A1" to="A1B1" lines="w"/></person>'
        '<trip id="w" depart="1.2" from="A0A1" to="A1B1"><stop lane="A0A1_1" endPos="30" triggered="true"/></trip>'
    )
    routes.write_text(f"<routes>{''.join(lines)}</routes>")
    command = [HOME / "bin" / "sumo", "-n", net, "-r", routes, "--end", "16", "--step-length", "0.4"]
    for path in (out, out.with_suffix(".xml")):
        subprocess.run([*command, "--fcd-output", path], check=True, capture_output=True, timeout=60)
    assert out.read_text().startswith(f"timestep_time;{first}_id;")
    from_csv, from_xml = read_fcd(out), read_fcd(out.with_suffix(".xml"))
    users = road_users(from_csv.ids)  # w turns by 90° in one step
    assert dict(zip(users, from_csv.type.tolist(), strict=True)) == {"v": 0, "p": 2, "w": 0, "r": 2}
    for name in ("ids", "type", "track", "frame", "x", "y", "heading"):
        np.testing.assert_array_equal(getattr(from_csv, name), getattr(from_xml, name), name)
    rider, car = (np.array([user == i for user in users])[from_csv.track] for i in ("r", "w"))
    assert from_csv.frame[rider].max() < from_csv.frame[car].max()

    # SUMO's xml2csv.py keeps persons and vehicles in columns of their own.
    table = tmp_path / "x.csv"
    script = HOME / "tools" / "xml" / "xml2csv.py"
    command = [sys.executable, script, out.with_suffix(".xml"), "-o", table]
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    assert "person_id" in table.read_text()
    from_table = read_fcd(table)
    assert sorted(zip(from_table.ids, from_table.type, strict=True)) == sorted(
        zip(from_csv.ids, from_csv.type, strict=True)
    )
    assert len(from_table) == len(from_csv)


def test_a_person_off_every_edge_stays_a_person_in_csv(tmp_path: Path) -> None:
    lines = ["0.00;a;0;0;0;walker;1;5;;edge;0", "0.00;b;5;0;0;walker;1;;;;0", "0.40;a;0;0;0;walker;1;;;;0"]
    path = tmp_path / "t.csv"
    path.write_text("\n".join([";".join(CSV_COLUMNS), *lines, ""]))
    t = read_fcd(path)
    assert t.ids == ("a", "b")
    assert t.type.tolist() == [2, 2]


def test_human_readable_times(tmp_path: Path) -> None:
    t = read_fcd(
        fcd(tmp_path / "t.xml", {s: [row("a", 0.0)] for s in ("1:00:59:59.60", "1:01:00:00", "1:01:00:00.40")})
    )
    assert t.t0 == pytest.approx(86400 + 3599.6)
    assert t.frame.tolist() == [0, 1, 2]


def big(path: Path) -> list[str]:
    steps = {f"{0.4 * k:.1f}": [row(f"v{i}", i + k) for i in range(40)] for k in range(100)}
    return fcd(path, steps).read_text().splitlines(keepends=True)


def test_a_truncated_xml_file_says_how_much_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "t.xml"
    lines = big(path)
    path.write_text("".join(lines)[: len("".join(lines[: 1 + 42 * 70 + 20])) + 30])
    with pytest.raises(InputError, match=rf"{path}, line 2962: is cut off; 70 complete time steps could be read"):
        read_fcd(path)


def test_a_truncated_gzip_file_is_reported(tmp_path: Path) -> None:
    text = "".join(big(tmp_path / "t.xml")).encode()
    path = tmp_path / "t.xml.gz"
    data = gzip.compress(text)
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=rf"{path}: it is cut off; [1-9][0-9]* complete time steps could be read"):
        read_fcd(path)
    path.write_bytes(gzip.compress(text[: len(text) // 2]))
    with pytest.raises(InputError, match=rf"{path}, line \d+: is cut off; (49|50) complete"):
        read_fcd(path)
    path.write_bytes(b"no gzip at all")
    with pytest.raises(InputError, match="0 complete time steps"):
        read_fcd(path)


def test_a_truncated_csv_file_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    lines = [";".join(CSV_COLUMNS)] + [f"{0.4 * k:.2f};a;{k};0;0;t;1;5;l;;0" for k in range(5)]
    path.write_text("\n".join(lines)[:-8])
    with pytest.raises(InputError, match=r"line 6: has 7 fields, not 11; is the file cut off\? 3 complete time steps"):
        read_fcd(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('x="2.0"', 'x="two"'), r"line 7: 'a' needs numbers as x, y and angle, they are 'two', '0.0', '90.0'"),
        (('x="2.0"', 'x="nan"'), r"line 7: 'a' needs numbers"),
        (('x="2.0"', ""), r"line 7: <vehicle> needs the attributes id, x, y and angle"),
        (('x="2.0"', 'x="2.0'), r"line 7: is not well-formed XML \(.+\); 1 complete time steps could be read"),
        (('time="0.4"', 'time="soon"'), r"line 6: 'soon' is not a time"),
        (('time="0.4"', ""), r"line 6: '' is not a time"),
        (('time="0.4"', 'time="0"'), r"line 6: time 0 does not come after the one before"),
        (
            ('time="0.4"', 'time="0.3"'),
            r"time steps are irregular: 0\.3 s between some, but 0\.3 s is followed by 0\.8 s",
        ),
        (('id="b" x="2.5"', 'id="a" x="2.5"'), r"line 8: 'a' is twice in the time step 0\.4"),
        (("fcd-export", "routes"), r"line 1: <routes> where an FCD file has <fcd-export>"),
    ],
)
def test_a_malformed_file_is_reported_with_its_line(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    path = tmp_path / "t.xml"
    fcd(path, {t: [row("a", x), row("b", x + 0.5)] for t, x in (("0", 1.0), ("0.4", 2.0), ("0.8", 3.0))})
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(InputError) as info:
        read_fcd(path)
    assert info.match(message)
    assert str(info.value).startswith(str(path))
    assert "\n" not in str(info.value)


def test_files_without_content_are_reported(tmp_path: Path) -> None:
    for name in ("t.xml", "t.xml.gz", "t.csv"):
        (tmp_path / name).touch()
        with pytest.raises(InputError, match=rf"{name} is empty"):
            read_fcd(tmp_path / name)
    with pytest.raises(InputError, match="holds no road users"):
        read_fcd(fcd(tmp_path / "t.xml", {"0": [], "0.4": []}))
    (tmp_path / "t.csv").write_text("a;b\n1;2\n")
    with pytest.raises(InputError, match=r"t\.csv, line 1: an FCD file in CSV has at least the columns"):
        read_fcd(tmp_path / "t.csv")
    needed = ["timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_angle"]
    for missing in needed:
        (tmp_path / "t.csv").write_text(";".join(column for column in needed if column != missing) + "\n0;1;2;3\n")
        with pytest.raises(InputError, match=f"t\\.csv, line 1: .* lacks {missing}$"):
            read_fcd(tmp_path / "t.csv")
    for separator in (",", "\t"):
        (tmp_path / "t.csv").write_text(separator.join(needed) + "\n")
        with pytest.raises(InputError, match=re.escape(f"are separated by {separator!r}; write it with semicolons")):
            read_fcd(tmp_path / "t.csv")
    (tmp_path / "t.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"t\.csv, line 1: not CSV text"):
        read_fcd(tmp_path / "t.csv")
    with pytest.raises(InputError, match=r"cannot read .*none\.xml: No such file"):
        read_fcd(tmp_path / "none.xml")
    with pytest.raises(InputError, match=r"FCD files end in"):
        read_fcd(tmp_path / "t.txt")


def test_geographic_coordinates_are_refused(tmp_path: Path) -> None:
    path = fcd(tmp_path / "t.xml", {"0": [row("a", 11.5)]})
    comment = '<!-- by SUMO <output><fcd-output.geo value="true"/></output> -->\n'
    path.write_text(comment + path.read_text())
    with pytest.raises(InputError, match=r"geographic coordinates; write it without --fcd-output\.geo"):
        read_fcd(path)
