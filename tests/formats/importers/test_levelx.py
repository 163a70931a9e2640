"""The format of inD, rounD, uniD and exiD, written here as the data sets have it, with its traps."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.levelx import read_levelx
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, RoadUserType

TRACKS = (  # noqa: SIM905
    "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,xAcceleration,"
    "yAcceleration,lonVelocity,latVelocity,lonAcceleration,latAcceleration"
).split(",")
META = "recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class".split(",")  # noqa: SIM905
ABOUT = (  # noqa: SIM905
    "recordingId,locationId,frameRate,speedLimit,weekday,startTime,duration,numTracks,numVehicles,numVRUs,latLocation,"
    "lonLocation,xUtmOrigin,yUtmOrigin,orthoPxToMeter"
).split(",")
CLASSES = ["car", "van", "truck_bus", "bus", "truck", "pedestrian", "bicycle", "motorcycle"]

Write = Callable[[str, Sequence[str], Sequence[Sequence[object]]], Path]
Row = tuple[int, int, float, float, float]


def recording(write: Write, rows: list[Row], classes: dict[int, tuple[str, float, float]], rate: float = 25) -> Path:
    """Files of recording 07: rows of track, frame, x, y, degrees; class, width and length per track."""
    numbers = {track: [frame for i, frame, *_ in rows if i == track] for track in classes}
    write("07_recordingMeta.csv", ABOUT, [[7, 1, rate, 13.9, "tuesday", 9, 60, 1, 1, 0, 50.7, 6.1, 0, 0, 0.0126]])
    write(
        "07_tracksMeta.csv",
        META,
        [[7, i, min(f), max(f), len(f), *classes[i][1:], classes[i][0]] for i, f in numbers.items()],
    )
    return write(
        "07_tracks.csv",
        TRACKS,
        [[7, i, f, 0, x, y, degrees, *classes[i][1:], *[0] * 8] for i, f, x, y, degrees in rows],
    )


def straight(track: int, frames: range, degrees: float, speed: float = 5.0, rate: float = 25) -> list[Row]:
    a = np.radians(degrees)
    way = [speed * f / rate for f in frames]
    return [(track, f, w * np.cos(a), 10 * track + w * np.sin(a), degrees) for f, w in zip(frames, way, strict=True)]


def test_every_class_and_its_box(write: Write) -> None:
    boxes = {
        i: (name, 0.0, 0.0) if name in ("pedestrian", "bicycle") else (name, 2.0, 4.0 + i)
        for i, name in enumerate(CLASSES)
    }
    t = read_levelx(recording(write, [r for i in boxes for r in straight(i, range(51), 30)], boxes))
    car, bicycle, pedestrian = RoadUserType
    assert t.ids == tuple(str(i) for i in range(8))
    assert t.type.tolist() == [car] * 5 + [pedestrian, bicycle, car]
    assert t.length.tolist() == [4, 5, 6, 7, 8, DEFAULT_LENGTH[pedestrian], DEFAULT_LENGTH[bicycle], 11]
    assert t.width.tolist() == [2, 2, 2, 2, 2, DEFAULT_WIDTH[pedestrian], DEFAULT_WIDTH[bicycle], 2]
    assert len(t) == 8 * 6
    np.testing.assert_allclose(t.heading, np.radians(30), atol=1e-5)
    np.testing.assert_allclose(t.speed, 5.0, atol=1e-9)
    assert t.source == "levelXdata 07"
    assert t.licence


def test_frame_rate_is_the_recordings_own(write: Write) -> None:
    rows = straight(1, range(100, 151), 90, rate=12.5)
    t = read_levelx(recording(write, rows, {1: ("car", 1.8, 4.5)}, rate=12.5))
    assert len(t) == 11
    assert t.t0 == 8.0
    np.testing.assert_allclose(t.y, 10 + 5 * (t.t0 + t.frame * 0.4), atol=1e-9)


def test_headings_in_degrees_wrap(write: Write) -> None:
    turning = [(1, f, 100 * np.cos(0.1 * f / 25), 100 * np.sin(0.1 * f / 25)) for f in range(2000)]
    rows = [(*row, float(np.degrees(0.1 * f / 25 + np.pi / 2) % 360)) for f, row in enumerate(turning)]
    assert max(np.diff([r[4] for r in rows]).tolist(), key=abs) < -350  # the data jumps from 360 to 0
    t = read_levelx(recording(write, rows, {1: ("car", 1.8, 4.5)}))
    np.testing.assert_allclose(t.yaw_rate[1:], 0.1, atol=1e-6)


def test_a_vru_that_stands_keeps_still_though_its_heading_jitters(write: Write) -> None:
    rng = np.random.default_rng(0)
    rows = [(1, f, 3.0, 4.0, float(h)) for f, h in enumerate(rng.uniform(0, 360, 200))]
    t = read_levelx(recording(write, rows, {1: ("pedestrian", 0.0, 0.0)}))
    assert np.abs(t.yaw_rate).max() < 1e-9
    assert t.heading[0] == pytest.approx(np.angle(np.exp(1j * np.radians(rows[0][4]))), abs=1e-6)


def test_gaps_parked_cars_and_single_rows(write: Write) -> None:
    gap = straight(1, range(30), 0) + straight(1, range(60, 90), 0)
    parked = [(2, f, 5.0, 5.0, 45.0) for f in range(200)]
    single = [(3, 50, 1.0, 1.0, -90.0)]
    sizes = {1: ("car", 1.8, 4.5), 2: ("car", 1.8, 4.5), 3: ("van", 2.0, 5.0)}
    t = read_levelx(recording(write, gap + parked + single, sizes))
    assert t.ids == ("1", "1#1", "2", "3")
    assert t.parked.tolist() == [False, False, True, False]
    assert t.frame[t.track == 0].tolist() == [0, 1, 2]
    assert t.frame[t.track == 1].tolist() == [6, 7, 8]
    assert t.frame[t.track == 3].tolist() == [5]
    assert t.heading[t.track == 3].tolist() == pytest.approx([-np.pi / 2])


def test_left_turns_are_left_turns(write: Write) -> None:
    rows = [
        (1, f, 20 * np.sin(0.2 * f / 25), 20 - 20 * np.cos(0.2 * f / 25), float(np.degrees(0.2 * f / 25)))
        for f in range(100)
    ]
    for name, size in (("car", 2.0), ("bicycle", 0.0)):
        t = read_levelx(recording(write, rows, {1: (name, size, size)}))
        np.testing.assert_allclose(t.yaw_rate[2:-2], 0.2, atol=0.03)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("07_tracks.csv", "xCenter", "x", "07_tracks.csv lacks the column 'xCenter'"),
        ("07_tracksMeta.csv", "class", "type", "07_tracksMeta.csv lacks the column 'class'"),
        ("07_tracksMeta.csv", "car", "hovercraft", "07_tracksMeta.csv, line 2: unknown class 'hovercraft'"),
        ("07_tracksMeta.csv", ",4.5,", ",450,", "07_tracksMeta.csv, line 2: length 450 is not a box in metres"),
        ("07_recordingMeta.csv", "7,1,25,", "7,1,0,", "column 'frameRate' is 0, which is not a rate"),
        ("07_recordingMeta.csv", "7,1,25,", "7,1,240,", "m within 0.00417 s; check that positions are in metres"),
    ],
)
def test_errors_name_file_and_line(write: Write, file: str, old: str, new: str, message: str) -> None:
    tracks = recording(write, straight(1, range(60), 0, speed=25), {1: ("car", 1.8, 4.5)})
    path = tracks.with_name(file)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_levelx(tracks)
    assert message in str(error.value)


def test_headings_in_radians_are_refused(write: Write) -> None:
    rows = [(i, f, x, y, float(np.radians(d))) for i, f, x, y, d in straight(1, range(60), 120)]
    with pytest.raises(InputError, match=r"headings and motion differ by 118 degrees"):
        read_levelx(recording(write, rows, {1: ("car", 1.8, 4.5)}))


def test_truncated_files_are_refused(write: Write) -> None:
    tracks = recording(write, straight(1, range(60), 0), {1: ("car", 1.8, 4.5)})
    text = tracks.read_text(encoding="utf-8")
    tracks.write_text(text[:-20], encoding="utf-8")
    with pytest.raises(InputError, match=r"07_tracks\.csv, line 61: the file is cut off"):
        read_levelx(tracks)
    tracks.write_text("".join(text.splitlines(keepends=True)[:40]), encoding="utf-8")
    with pytest.raises(InputError, match=r"39 rows of trackId 1, 07_tracksMeta\.csv says 60; the file is cut off"):
        read_levelx(tracks)
    tracks.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=r"07_tracks\.csv is empty"):
        read_levelx(tracks)
    tracks.with_name("07_tracksMeta.csv").unlink()
    with pytest.raises(InputError, match=r"cannot read .*07_tracksMeta\.csv"):
        read_levelx(tracks)
