"""The formats of NGSIM and TGSIM, written here as the data sets have them."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.formats import find_recordings
from slrl_sumo.formats.importers.ngsim import COLUMNS, FOOT, read_ngsim
from slrl_sumo.formats.importers.tgsim import read_tgsim
from slrl_sumo.scene.types import RoadUserType

Write = Callable[[str, Sequence[str], Sequence[Sequence[object]]], Path]

MORE = ("Lane_ID", "Preceding", "Following", "Space_Hdwy", "Time_Hdwy")
TGSIM = "id,time,xloc_kf,yloc_kf,lane_kf,speed_kf,acceleration_kf,length_smoothed,width_smoothed,type_most_common"


def rows(vehicle: int = 2, begin: int = 0, kind: int = 2, noise: float = 0.0) -> list[list[object]]:
    """A vehicle 15 ft long at 44 ft/s along the section, 20 ft from its edge; its front is at 0 ft at first."""
    random = np.random.default_rng(1)
    found: list[list[object]] = []
    for frame in range(101):
        y = round(4.4 * frame + noise * random.normal(), 3)
        where = [round(20 + noise * random.normal(), 3), y, 6451167.0, 1873344.0]
        found.append(
            [vehicle, 13 + frame, 101, 1118846980200 + begin + 100 * frame, *where, 15.0, 6.0, kind, 44.0, 0.0]
        )
        found[-1] += [2, 0, 0, 0.0, 0.0]
    return found


def test_feet_become_metres_and_the_front_the_centre(write: Write) -> None:
    t = read_ngsim(write("us-101.csv", (*COLUMNS, *MORE), rows()))
    assert (t.ids, t.type.tolist()) == (("2",), [RoadUserType.CAR])
    assert (t.length[0], t.width[0]) == (pytest.approx(15 * FOOT), pytest.approx(6 * FOOT))
    np.testing.assert_allclose(t.heading, np.pi / 2, atol=1e-6)
    np.testing.assert_allclose(t.x, 20 * FOOT, atol=1e-6)
    np.testing.assert_allclose(t.y, FOOT * (44.0 * 0.4 * np.arange(len(t)) - 7.5), atol=1e-3)
    assert len(t) == 26


def test_speed_noise_is_smoothed(write: Write) -> None:
    noisy = read_ngsim(write("noisy.csv", (*COLUMNS, *MORE), rows(noise=1.0)))
    np.testing.assert_allclose(noisy.speed, 44 * FOOT, rtol=0.05)  # 1 ft at 10 Hz alone would be 14 ft/s
    assert np.abs(noisy.acceleration).max() < 1.5


def test_text_without_a_header_is_the_same(write: Write, tmp_path: Path) -> None:
    plain = tmp_path / "trajectories-0750am-0805am.txt"
    plain.write_text("\n".join("  " + "   ".join(map(str, row)) for row in rows()) + "\n", encoding="utf-8")
    other = read_ngsim(write("a.csv", (*COLUMNS, *MORE), rows()))
    [recording] = find_recordings("NGSIM", plain)
    np.testing.assert_allclose(recording.read().y, other.y)


def test_numbers_that_begin_anew_are_other_vehicles(write: Write) -> None:
    later = [[*row[:2], 77, *row[3:]] for row in rows(begin=900_000, kind=3)]
    t = read_ngsim(write("both.csv", (*(name.lower() for name in COLUMNS), *MORE), [*rows(), *later]))
    assert len(t.ids) == 2
    assert t.frame.max() - t.frame.min() == 2250 + 25
    mixed = write("all.csv", (*COLUMNS, *MORE, "Location"), [[*rows()[0], "i-80"], [*rows()[1], "us-101"]])
    with pytest.raises(InputError, match="2 locations"):
        read_ngsim(mixed)
    lacking = write("bad.csv", [*COLUMNS[:3], *COLUMNS[4:]], [[*row[:3], *row[4:13]] for row in rows()])
    with pytest.raises(InputError, match="lacks the column 'Global_Time'"):
        read_ngsim(lacking)


def test_tgsim_has_all_types_and_runs_one_after_another(write: Write) -> None:
    ways = {(1, 0): (0.13, 0.5, 0.5), (2, 3): (1.0, 4.5, 1.9), (3, 1): (0.5, 0.0, 0.0)}  # id, type: step, length, width
    made = [
        [i, round(0.1 * k, 1), round(step * k, 3), 5.0 * i, 1, 10 * step, 0.0, length, width, kind, run]
        for run in (1, 2)
        for (i, kind), (step, length, width) in ways.items()
        for k in range(51)
    ]
    t = read_tgsim(write("foggy.csv", (*TGSIM.split(","), "run_index"), made))
    assert t.ids == ("1-1", "1-2", "1-3", "2-1", "2-2", "2-3")
    assert t.type.tolist() == [RoadUserType.PEDESTRIAN, RoadUserType.CAR, RoadUserType.BICYCLE] * 2
    assert t.length.tolist() == [0.5, 4.5, 1.6, 0.5, 4.5, 1.6]
    np.testing.assert_allclose(t.speed[t.track == 1], 10.0, atol=1e-6)
    np.testing.assert_allclose(t.heading, 0.0, atol=1e-6)
    assert t.frame[t.track == 3][0] - t.frame[t.track == 0][-1] >= 249  # 100 s
    one = read_tgsim(write("one.csv", TGSIM.split(","), [row[:-1] for row in made if row[-1] == 1]))
    assert one.ids == ("1", "2", "3")
    milliseconds = write("ms.csv", TGSIM.split(","), [[row[0], 1000 * row[1], *row[2:-1]] for row in made[:51]])
    with pytest.raises(InputError, match=r"ms\.csv: rows of .* every 100 s \(median\) instead of 0\.1 s; check that"):
        read_tgsim(milliseconds)
    unknown = write("bad.csv", TGSIM.split(","), [[*row[:9], 9] for row in made[:51]])
    with pytest.raises(InputError, match="unknown type_most_common '9'"):
        read_tgsim(unknown)
