from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.camera import camera_moves
from slrl_sumo.formats.importers.formats import find_recordings, join
from slrl_sumo.formats.importers.sdd import read_sdd
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import RoadUserType

CAR, BICYCLE, PEDESTRIAN = RoadUserType

SCALES = """# estimated
other:
   video0:
      scale: 0.5
      certainty: 1.0

gates:
   video1:
      scale: 0.9
      certainty: 1.0
   video3:
      scale: 0.04
      certainty: 1.0
"""

Line = tuple[int, float, float, float, float, int, int, str]


def box(
    track: int, frame: int, x: float, y: float, label: str, lost: int = 0, size: tuple[int, int] = (40, 40)
) -> Line:
    """A row around the pixel (x, y)."""
    w, h = size
    left, top = round(x - w / 2), round(y - h / 2)
    return track, left, top, left + w, top + h, frame, lost, label


def video(tmp_path: Path, rows: list[Line], scales: str = SCALES) -> Path:
    path = tmp_path / "gates" / "video3" / "annotations.txt"
    path.parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / "estimated_scales.yaml").write_text(scales, encoding="utf-8")
    text = "".join(f'{a} {b} {c} {d} {e} {f} {lost} 0 1 "{label}"\n' for a, b, c, d, e, f, lost, label in rows)
    path.write_text(text, encoding="utf-8")
    return path


def test_every_label_its_type_and_box(tmp_path: Path) -> None:
    labels = ["Pedestrian", "Biker", "Skater", "Car", "Cart", "Bus"]
    rows = [box(i, f, 100 + 2 * f, 100 * i + 100, name) for i, name in enumerate(labels) for f in range(61)]
    t = read_sdd(video(tmp_path, rows))
    assert t.source == "SDD gates-video3"
    assert "NC" in t.licence
    assert t.type.tolist() == [PEDESTRIAN, BICYCLE, BICYCLE, CAR, CAR, CAR]
    assert t.length.tolist() == [0.215, 1.6, 1.6, 5.0, 2.4, 8.5]
    np.testing.assert_allclose(t.speed, 2 * 0.04 * 30, rtol=1e-6)
    np.testing.assert_allclose(t.heading, 0.0, atol=1e-6)
    np.testing.assert_allclose(t.y[t.starts[:-1]], [-4, -8, -12, -16, -20, -24], atol=1e-9)


def test_lost_rows_are_gaps(tmp_path: Path) -> None:
    rows = [box(3, f, 100 + f, 100, "Biker", lost=int(40 <= f < 80 or f < 5)) for f in range(121)]
    t = read_sdd(video(tmp_path, rows))
    assert t.ids == ("3", "3#1")
    assert t.t0 == pytest.approx(5 / 30)
    at = (t.t0 + t.frame * t.dt) * 30
    np.testing.assert_allclose(t.x, 0.04 * (100 + at), atol=1e-6)
    assert not ((at >= 40) & (at < 80)).any()


def test_y_down_is_turned_so_that_left_stays_left(tmp_path: Path) -> None:
    angle = 0.3 * np.arange(301) / 30
    x, y = 1000 + 250 * np.sin(angle), 1000 - (250 - 250 * np.cos(angle))  # left as seen in the picture
    t = read_sdd(video(tmp_path, [box(0, f, x[f], y[f], "Biker") for f in range(301)]))
    np.testing.assert_allclose(t.yaw_rate[4:-4], 0.3, atol=0.05)  # though boxes are whole pixels
    np.testing.assert_allclose(t.speed[4:-4], 3.0, rtol=0.05)


def test_parked_cars_look_along_their_box(tmp_path: Path) -> None:
    rows = [box(0, f, 500 + f % 2, 500, "Car", size=(60, 120)) for f in range(301)]
    rows += [box(1, f, 500, 900, "Car", size=(120, 60)) for f in range(301)]
    t = read_sdd(video(tmp_path, rows))
    assert t.parked.tolist() == [True, True]
    np.testing.assert_allclose(t.heading[t.starts[:-1]], [np.pi / 2, 0])


def test_times_when_the_camera_moves_are_left_out(tmp_path: Path) -> None:
    slide = np.clip(np.arange(601) - 200, 0, 100) * 2.0  # pixels, in frames 200 to 300
    rows = [box(i, f, 300 * (i + 1) + slide[f], 500, "Car") for i in range(6) for f in range(601)]
    rows += [box(9, f, 800 + slide[f] + f, 800, "Pedestrian") for f in range(601)]
    t = read_sdd(video(tmp_path, rows))
    at = 12 * t.frame  # its frame in the video
    assert not ((at > 200) & (at < 300)).any()
    # Frames 0 to 168 and 336 to 600 are untouched, for all seven.
    assert ((at <= 168) | (at >= 336)).sum() == 7 * (15 + 23)
    assert t.speed[t.type[t.track] == CAR].max() < 0.1
    # Walkers in a crowd, a few cars, and cars both ways do not make a moving camera.
    crowd = [box(i, f, 300 * i + 300 + 3 * f, 500, "Pedestrian") for i in range(9) for f in range(301)]
    cars = [box(9 + i, f, 900 * i + (1 - 2 * (i % 2)) * 5 * f, 900, "Car") for i in range(6) for f in range(301)]
    assert len(read_sdd(video(tmp_path, crowd + cars))) == 15 * 26


def test_camera_moves_joins_what_lies_close() -> None:
    frame = np.tile(np.arange(601), 5)
    car = np.repeat(np.arange(5), 601)
    x: Floats = np.interp(frame, [0, 100, 160, 200, 260, 600], [0, 0, 5, 5, 9, 9]).astype(np.float64)
    y: Floats = np.multiply(car, 10.0, dtype=np.float64)
    spans = camera_moves(car, frame, x, y, 30.0)
    assert len(spans) == 1
    assert abs(spans[0, 0] - 100) <= 30
    assert abs(spans[0, 1] - 260) <= 30
    assert camera_moves(car, frame, 0 * x, y, 30.0).shape == (0, 2)
    assert camera_moves(car[:0], frame[:0], x[:0], x[:0], 30.0).shape == (0, 2)


@pytest.mark.parametrize(
    ("scales", "line", "message"),
    [
        (SCALES, '0 1 2 3 4 5 0 0 1 "Dog"', "annotations.txt, line 1: unknown label 'Dog'"),
        (SCALES, '0 1 2 3 4 5 0 0 "Car"', "annotations.txt, line 1: the file is cut off, the last line has 9 of 10"),
        (SCALES, '0 1 2 x 4 5 0 0 1 "Car"', "annotations.txt, line 1: column 'xmax' needs a number, it is 'x'"),
        (SCALES, '0 9 2 3 4 5 0 0 1 "Car"', "annotations.txt, line 1: the box ends before it begins"),
        (SCALES, '0 1 2 3 4 5 1 0 1 "Car"', "every row has lost = 1"),
        (SCALES.replace("0.04", "4"), '0 1 2 3 4 5 0 0 1 "Car"', "line 12: '4' is not a scale in metres per pixel"),
        (SCALES.replace("video3", "video4"), '0 1 2 3 4 5 0 0 1 "Car"', "has no scale of gates, video3"),
        (SCALES, "", "annotations.txt is empty"),
    ],
)
def test_errors_name_file_and_line(tmp_path: Path, scales: str, line: str, message: str) -> None:
    path = video(tmp_path, [], scales)
    path.write_text(line, encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_sdd(path)
    assert message in str(error.value)


def test_scales_must_be_there(tmp_path: Path) -> None:
    path = video(tmp_path, [])
    (tmp_path / "estimated_scales.yaml").unlink()
    with pytest.raises(InputError, match=r"there is no estimated_scales\.yaml in the folders above"):
        read_sdd(path)


def test_the_real_campus(
    data: Path, sideslip: Callable[[Trajectories], np.ndarray[tuple[int], np.dtype[np.float64]]]
) -> None:
    names = ["gates-video4", "gates-video5", "nexus-video10", "nexus-video5"]
    found = [r for r in find_recordings("sdd", data / "sdd") if r.name in names]
    assert [r.name for r in found] == names
    t = join([(r.name, r.read()) for r in found])
    kind = t.type[t.track]
    for one, low, high, top in ((PEDESTRIAN, 0.8, 1.5, 9.0), (BICYCLE, 3.0, 5.0, 12.0)):
        assert low < np.median(t.speed[kind == one]) < high
        assert t.speed[kind == one].max() < top
    for one in (PEDESTRIAN, BICYCLE, CAR):
        assert np.percentile(np.abs(t.yaw_rate[kind == one]), 99) < 1.3
    assert t.parked.sum() >= 10
    assert (
        np.percentile(t.speed[t.parked[t.track]], 98) < 0.6
    )  # parked cars that a moving camera makes slide are left out
    assert np.percentile(sideslip(t), 99) < np.radians(25)


def test_real_speeds_are_usual(data: Path) -> None:
    """The recordings nearest to the bounds: 18 parked cars with noise, and "pedestrians" of which most ride."""
    names = {"nexus-video5", "quad-video2", "quad-video3"}
    found = [r.read() for r in find_recordings("sdd", data / "sdd") if r.name in names]
    assert len(found) == 3
    assert [note for t in found for note in t.notes if "usual" in note] == []


def test_the_same_bytes_twice(data: Path, tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        read_sdd(data / "sdd" / "quad" / "video0" / "annotations.txt").save(tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
