"""The formats of SinD, INTERACTION and TAF-BW, written here as the data sets have them, with their traps."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.formats import find_recordings
from slrl_sumo.formats.importers.interaction import read_interaction, read_taf_bw
from slrl_sumo.formats.importers.sind import read_sind
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.types import DEFAULT_LENGTH, RoadUserType

VEH = (  # noqa: SIM905
    "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,yaw_rad,heading_rad,length,width,ax,ay,v_lon,v_lat,a_lon,a_lat"
).split(",")
PED = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,ax,ay".split(",")  # noqa: SIM905
INTERACTION = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width".split(",")  # noqa: SIM905
CAR, BICYCLE, PEDESTRIAN = RoadUserType

Write = Callable[[str, Sequence[str], Sequence[Sequence[object]]], Path]


def vehicles(kinds: Sequence[str], step_ms: float = 100.1, yaw: float = 0.5, slip: float = 0.3) -> list[list[object]]:
    """5 m/s along yaw for 4 s; heading_rad is off by `slip`, to see that it is not the column taken."""
    tail = [yaw, yaw + slip]
    return [
        [n, f, round(f * step_ms, 1), kind, a * np.cos(yaw), 9 * n + a * np.sin(yaw), 0, 0, *tail, 4 + n, 2, *[0] * 6]
        for n, kind in enumerate(kinds)
        for f, a in enumerate(0.5005 * np.arange(41))
    ]


def test_sind_every_class_with_boxes_and_yaw(write: Write) -> None:
    kinds = ["car", "truck", "bus", "motorcycle", "bicycle", "tricycle"]
    path = write("8_02_1/Veh_smoothed_tracks.csv", VEH, vehicles(kinds))
    walkers = [
        [f"P{i}", f, round(f * 100.1, 1), "pedestrian", 3.0, -0.12 * f, 0, -1.2, 0, 0]
        for i in (1, 2)
        for f in range(41)
    ]
    write("8_02_1/Ped_smoothed_tracks.csv", PED, walkers)
    t = read_sind(path)
    assert t.source == "SinD 8_02_1"
    assert t.ids == ("0", "1", "2", "3", "4", "5", "P1", "P2")
    assert t.type.tolist() == [CAR, CAR, CAR, CAR, BICYCLE, CAR, PEDESTRIAN, PEDESTRIAN]
    assert t.length[:6].tolist() == [4, 5, 6, 7, 8, 9]
    assert t.length[6] == DEFAULT_LENGTH[PEDESTRIAN]
    walks = t.track >= 6
    np.testing.assert_allclose(t.heading[~walks], 0.5, atol=1e-9)
    np.testing.assert_allclose(t.heading[walks], -np.pi / 2, atol=1e-4)
    np.testing.assert_allclose(t.speed[~walks], 5.0, atol=1e-2)
    assert t.frame.max() == 10


def test_sind_without_pedestrians_and_with_a_gap(write: Write) -> None:
    rows = [row for row in vehicles(["car"]) if not 15 <= int(str(row[1])) <= 20]
    t = read_sind(write("r/Veh_smoothed_tracks.csv", VEH, rows))
    assert t.ids == ("0", "0#1")
    assert t.frame.tolist() == [0, 1, 2, 3, 6, 7, 8, 9, 10]


def test_sind_errors(write: Write) -> None:
    with pytest.raises(InputError, match=r"Veh_smoothed_tracks\.csv, line 2: unknown agent_type 'horse'"):
        read_sind(write("a/Veh_smoothed_tracks.csv", VEH, vehicles(["horse", "ufo"])))
    degrees = [[*row[:8], 28.6, *row[9:]] for row in vehicles(["car"])]
    with pytest.raises(InputError, match=r"line 2: column 'yaw_rad' is 28\.6, not an angle in radians"):
        read_sind(write("b/Veh_smoothed_tracks.csv", VEH, degrees))
    with pytest.raises(InputError, match=r"rows of a track follow each other every 0\.0001 s"):
        read_sind(write("c/Veh_smoothed_tracks.csv", VEH, vehicles(["car"], step_ms=0.1)))
    with pytest.raises(InputError, match=r"lacks the column 'yaw_rad'"):
        read_sind(write("d/Veh_smoothed_tracks.csv", PED, [row[:10] for row in vehicles(["car"])]))


def tracks(kinds: Sequence[str], angle: float = -1.1, size: float = 1.8) -> list[list[object]]:
    return [
        [n, f, 100 * f, kind, 0.5 * f * np.cos(angle), 9 * n + 0.5 * f * np.sin(angle), 0, 0, angle, 4.5, size]
        for n, kind in enumerate(kinds)
        for f in range(1, 42)
    ]


def walkers(kinds: Sequence[tuple[str, float]]) -> list[list[object]]:
    return [
        [f"P{n}", f, 100 * f, kind, 30 + n, -0.1 * f * speed, 0, -speed]
        for n, (kind, speed) in enumerate(kinds)
        for f in range(1, 42)
    ]


def test_interaction_settles_its_mixed_class_by_speed(write: Write) -> None:
    path = write("DR_USA_Intersection_EP0/vehicle_tracks_000.csv", INTERACTION, tracks(["car"]))
    mixed = [("pedestrian/bicycle", 1.3), ("pedestrian/bicycle", 4.5), ("pedestrian/bicycle", 0.0)]
    write("DR_USA_Intersection_EP0/pedestrian_tracks_000.csv", INTERACTION[:8], walkers(mixed))
    t = read_interaction(path)
    assert t.source == "DR_USA_Intersection_EP0 vehicle_tracks_000"
    assert t.type.tolist() == [CAR, PEDESTRIAN, BICYCLE, PEDESTRIAN]
    assert t.length[2] == DEFAULT_LENGTH[BICYCLE]
    assert t.t0 == 0.1
    np.testing.assert_allclose(t.heading[t.track == 0], -1.1, atol=1e-9)
    np.testing.assert_allclose(t.heading[(t.track == 1) | (t.track == 2)], -np.pi / 2, atol=1e-3)


def test_taf_bw_capitals_and_order_of_columns(write: Write) -> None:
    order = [0, 1, 2, 3, 6, 7, 8, 9, 10, 4, 5]
    kinds = ["Car", "Truck", "Bike", "Pedestrian", "Van", "Bus", "Motorbike", "Tractor"]
    rows = [[row[i] for i in order] for row in tracks(kinds)]
    t = read_taf_bw(write("k733/vehicle_tracks_000.csv", [INTERACTION[i] for i in order], rows))
    assert t.type.tolist() == [CAR, CAR, BICYCLE, PEDESTRIAN, CAR, CAR, CAR]
    assert t.notes == ("1 road user of the unknown agent_type 'tractor' left out",)
    assert "CC BY-NC-SA 4.0" in t.licence
    np.testing.assert_allclose(t.speed, 5.0, atol=1e-6)


def test_taf_bw_is_smoothed_and_headings_follow_the_motion(write: Write) -> None:
    """As published: the axis of the motion instead of a heading, noise, duplicated rows that go on from the later."""
    random = np.random.default_rng(1)
    rows = []
    for n, way in enumerate((0.4, 0.4 + np.pi, 2.5, 2.5 - np.pi)):
        for f in range(100):
            x, y = 0.8 * f * np.cos(way), 9 * n + 0.8 * f * np.sin(way)
            noise = random.normal(0.0, 0.2, 2)
            psi = np.arctan(np.tan(way))
            if f == 50:  # another object, lost by the tracker at once
                rows.append([n, f, 100 * f, "Car", x + 3, y + 3, 0, 0, psi, 4, 2])
            rows.append([n, f, 100 * f, "Car", x + noise[0], y + noise[1], 0, 0, psi, 4, 2])
    path = write("k733/vehicle_tracks_000.csv", INTERACTION, rows)
    t = read_taf_bw(path)
    assert t.ids == ("0", "1", "2", "3")
    assert t.notes == (
        "4 of 404 rows twice for one road user and time, the first of each two dropped",
        "2 of 4 road users: headings against the motion, replaced by those of the motion",
    )
    for n, way in enumerate((0.4, 0.4 + np.pi, 2.5, 2.5 - np.pi)):
        assert np.abs(np.sin(0.5 * (t.heading[t.track == n] - way))).max() < 0.1
    np.testing.assert_allclose(t.speed, 8.0, atol=1.0)
    assert np.percentile(np.abs(t.acceleration), 90) < 1.0


def test_the_published_taf_bw(data: Path) -> None:
    (recording,) = find_recordings("taf-bw", data / "taf-bw")
    t = recording.read()
    assert len({name.partition("#")[0] for name in t.ids}) == 132
    assert t.notes[0].startswith("104 of 12079 rows twice")
    assert t.notes[1].startswith("48 of 132 road users: headings against the motion")
    assert t.notes[2:] == ("1 of 132 road users split at gaps or jumps",)
    assert t.speed.max() < 20
    assert np.percentile(np.abs(t.acceleration), 90) < 2
    assert np.percentile(np.abs(t.acceleration), 99) < 4
    assert np.percentile(np.abs(t.yaw_rate), 99) < 0.6
    row = np.flatnonzero((np.diff(t.track) == 0) & (t.speed[1:] > 2))
    slip = wrap_angle(np.arctan2(np.diff(t.y)[row], np.diff(t.x)[row]) - t.heading[row])
    assert np.percentile(np.abs(slip), 99) < 0.25


def test_reversed_headings_are_turned_per_track(write: Write) -> None:
    """Also where most tracks are right, so that a median over all of them shows nothing."""
    rows = tracks(["car", "car", "car", "car"])
    for row in rows:
        psi = float(str(row[8]))
        if row[0] == 2:
            row[8] = psi + np.pi
        elif row[0] == 3:
            row[8] = psi + 1.2
    t = read_interaction(write("a/vehicle_tracks_000.csv", INTERACTION, rows))
    np.testing.assert_allclose(t.heading, -1.1, atol=1e-6)
    assert t.notes == (
        "1 of 4 road users: headings against the motion, turned",
        "1 of 4 road users: headings that differ from the motion, replaced by those of the motion",
    )


def test_a_car_that_reverses_out_of_a_place_keeps_its_heading(write: Write) -> None:
    rows = [
        [0, f, 100 * f, "car", -0.15 * min(f, 40) + 0.5 * max(f - 40, 0), 0.0, 0, 0, 0.0, 4.5, 1.8] for f in range(80)
    ]
    t = read_interaction(write("a/vehicle_tracks_000.csv", INTERACTION, rows))
    assert not t.notes
    np.testing.assert_allclose(t.heading, 0.0, atol=1e-9)


def test_spreadsheet_forms_of_the_same_table(write: Write) -> None:
    """A byte-order mark, CRLF, semicolons, any order of rows and empty cells of boxes change nothing but the boxes."""
    path = write("a/vehicle_tracks_000.csv", INTERACTION, tracks(["car", "pedestrian"]))
    plain = read_interaction(path)
    lines = path.read_text(encoding="utf-8").splitlines()
    shuffled = [lines[0], *np.random.default_rng(0).permutation(lines[1:])]
    odd = [line.replace(",", ";") for line in shuffled]
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(odd).encode() + b"\r\n")
    again = read_interaction(path)
    for name in ("track", "frame", "x", "y", "heading", "type", "length", "width"):
        np.testing.assert_array_equal(getattr(again, name), getattr(plain, name))
    rows = [[*row[:8], "", "", ""] if row[3] == "pedestrian" else row for row in tracks(["car", "pedestrian"])]
    empty = read_interaction(write("a/vehicle_tracks_000.csv", INTERACTION, rows))
    assert empty.length.tolist() == [4.5, DEFAULT_LENGTH[PEDESTRIAN]]
    np.testing.assert_allclose(empty.heading, -1.1, atol=1e-3)


def test_a_class_that_changes_and_pedestrians_alone(write: Write) -> None:
    rows = tracks(["car"])
    rows[3][3] = "truck"
    t = read_interaction(write("a/vehicle_tracks_000.csv", INTERACTION, rows))
    assert t.type.tolist() == [CAR]
    assert t.notes == ("1 road user with changing agent_type: the most frequent one counts",)
    write("b/pedestrian_tracks_001.csv", INTERACTION[:8], walkers([("pedestrian", 1.3)]))
    (found,) = find_recordings("interaction", tmp := write("b/x.txt", [], []).parent)
    assert (found.name, found.read().ids) == (f"{tmp.name}-vehicle_tracks_001", ("P0",))


def test_interaction_errors(write: Write) -> None:
    with pytest.raises(InputError, match=r"line 2: unknown agent_type 'ufo'"):
        read_interaction(write("a/vehicle_tracks_000.csv", INTERACTION, tracks(["ufo"])))
    with pytest.raises(InputError, match=r"vehicle_tracks_000\.csv lacks the column 'psi_rad'"):
        read_interaction(write("b/vehicle_tracks_000.csv", INTERACTION[:8], walkers([("car", 2.0)])))
    with pytest.raises(InputError, match=r"line 2: width -1 is not a box in metres"):
        read_interaction(write("c/vehicle_tracks_000.csv", INTERACTION, tracks(["car"], size=-1)))
    centimetres = [[*row[:4], 100 * float(str(row[4])), 100 * float(str(row[5])), *row[6:]] for row in tracks(["car"])]
    with pytest.raises(InputError, match=r"move 50 m within 0\.1 s; check that positions are in metres"):
        read_interaction(write("d/vehicle_tracks_000.csv", INTERACTION, centimetres))
    two = [[0, *row[1:]] for row in tracks(["car", "car"])]  # of the same id
    with pytest.raises(InputError, match=r"'0' is twice at 0\.1 s, as in 41 of 82 rows; check that every road user"):
        read_interaction(write("e/vehicle_tracks_000.csv", INTERACTION, two))
