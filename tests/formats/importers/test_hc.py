from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.formats import find_recordings, join
from slrl_sumo.formats.importers.hc import PIXELS_PER_METRE, read_hc
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.types import DEFAULT_LENGTH, RoadUserType

CAR, BICYCLE, PEDESTRIAN = RoadUserType


def test_pixels_half_seconds_and_y_down(tmp_path: Path) -> None:
    frames = np.arange(100, 161)
    angle = 0.3 * (frames - 100) * 0.5  # left turn of radius 10 m: 3 m/s
    x, y = 10 * np.sin(angle), 10 - 10 * np.cos(angle)
    lines = []
    for number, kind in ((4, 1), (5, 2), (9, 3)):
        lines += [
            f"{f},{number},{PIXELS_PER_METRE * a:.9f},{-PIXELS_PER_METRE * b:.9f},{kind}"
            for f, a, b in zip(frames, x, y, strict=True)
        ]
    path = tmp_path / "D7.csv"
    path.write_text("\n".join(lines), encoding="utf-8")  # no newline at the end, as in the data
    t = read_hc(path)
    assert t.source == "HC D7"
    assert "MIT" in t.licence
    assert t.ids == ("4", "5", "9")
    assert t.type.tolist() == [PEDESTRIAN, BICYCLE, CAR]
    assert t.length.tolist() == [DEFAULT_LENGTH[k] for k in t.type]
    assert t.t0 == 50.0
    assert len(t) == 3 * 76
    for track in range(3):
        inner = slice(t.starts[track] + 4, t.starts[track + 1] - 4)
        np.testing.assert_allclose(t.speed[inner], 3.0, rtol=0.02)
        np.testing.assert_allclose(t.yaw_rate[inner], 0.3, atol=0.02)
        due = 0.3 * 0.4 * t.frame[inner]
        assert np.hypot(t.x[inner] - 10 * np.sin(due), t.y[inner] - 10 + 10 * np.cos(due)).max() < 0.05


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "D1.csv is empty"),
        ("1,1,2,3,4\n2,1,2,3,4\n", "line 1: unknown type '4'; known are 1, 2, 3"),
        ("1,1,2,3,1\n2,1,2", "line 2: the file is cut off, the last line has 3 of 5 columns"),
        ("1,1,2,3\n2,1,2,3\n", "line 1: 4 columns instead of 5"),
        ("frame,id,x,y,type\n1,1,2,3,1\n", "line 1: column 'frame' needs a number, it is 'frame'"),
        ("1,1,0,0,1\n2,1,900,0,1\n3,1,1800,0,1\n", "move 42.5 m within 0.5 s; check that positions are in metres"),
    ],
)
def test_errors_name_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "D1.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_hc(path)
    assert message in str(error.value)
    assert "D1.csv" in str(error.value)


def test_the_real_street(
    data: Path, sideslip: Callable[[Trajectories], np.ndarray[tuple[int], np.dtype[np.float64]]]
) -> None:
    parts = [(r.name, r.read()) for r in find_recordings("hc", data / "hc")]
    assert [name for name, _ in parts] == ["D1", "D2", "D3"]
    seconds = sum(len(t.frames) * t.dt for _, t in parts)
    assert seconds / 60 == pytest.approx(29.5, abs=0.1)

    t = join(parts)
    whole = [t.type[k] for k, name in enumerate(t.ids) if "#" not in name]
    assert [whole.count(kind) for kind in (PEDESTRIAN, BICYCLE, CAR)] == [382, 40, 15]
    assert len(t.ids) == 438  # one pedestrian jumps by 15 m
    assert t.notes == ("D1: 1 of 254 road users split at gaps or jumps",)
    assert np.ptp(t.x) < 20
    assert 55 < np.ptp(t.y) < 70

    kind = t.type[t.track]
    for one, median, top in ((PEDESTRIAN, 1.4, 6.0), (BICYCLE, 4.1, 8.0), (CAR, 1.6, 9.0)):
        assert np.median(t.speed[kind == one]) == pytest.approx(median, abs=0.15)
        assert t.speed[kind == one].max() < top
        assert np.percentile(np.abs(t.yaw_rate[kind == one]), 99) < 0.8
        assert np.percentile(np.abs(t.acceleration[kind == one]), 99) < 3.5
    assert np.percentile(sideslip(t), 99) < np.radians(8)


def test_the_same_bytes_twice(data: Path, tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        read_hc(data / "hc" / "D3.csv").save(tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
