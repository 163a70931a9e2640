"""The format of DUT and CITR, written here as the data sets have it: y down, other frame rates."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.dut import read_citr, read_dut
from slrl_sumo.formats.importers.formats import find_recordings
from slrl_sumo.scene.types import RoadUserType

PED = "id,frame,label,x_est,y_est,vx_est,vy_est".split(",")  # noqa: SIM905
VEH = "id,frame,label,x_est,y_est,psi_est,vel_est".split(",")  # noqa: SIM905

Write = Callable[[str, Sequence[str], Sequence[Sequence[object]]], Path]


def clip(write: Write, rate: float, name: str = "intersection_01") -> Path:
    """A pedestrian walks up the picture; a car turns left as its driver sees it, from the right to down the picture."""
    frames = np.arange(10, 200)
    angle = 0.3 * frames / rate  # of its heading, counter-clockwise as seen
    car = [
        [0, f, "veh", 20 * np.sin(a), -(20 - 20 * np.cos(a)), np.mod(-a, 2 * np.pi), 6.0]
        for f, a in zip(frames, angle, strict=True)
    ]
    write(f"{name}_traj_veh_filtered.csv", VEH, car)
    walker = [[0, f, "ped", 5.0, 30 - 1.2 * f / rate, 0.0, -1.2] for f in frames]
    return write(f"{name}_traj_ped_filtered.csv", PED, walker)


@pytest.mark.parametrize(("read", "rate", "length"), [(read_dut, 23.98, 5.0), (read_citr, 29.97, 2.4)])
def test_y_is_turned_and_time_is_the_data_sets(
    write: Write, read: Callable[[Path], object], rate: float, length: float
) -> None:
    t = read_dut(clip(write, rate)) if read is read_dut else read_citr(clip(write, rate))
    assert t.ids == ("ped0", "veh0")
    assert t.type.tolist() == [RoadUserType.PEDESTRIAN, RoadUserType.CAR]
    assert t.length[1] == length
    walks = t.track == 0
    np.testing.assert_allclose(t.heading[walks], np.pi / 2, atol=1e-3)
    np.testing.assert_allclose(t.speed[walks], 1.2, atol=1e-6)
    assert t.y[0] == pytest.approx(-30 + 1.2 * 10 / rate)
    np.testing.assert_allclose(t.yaw_rate[~walks][1:], 0.3, atol=1e-3)  # left stays left
    np.testing.assert_allclose(t.speed[~walks], 6.0, rtol=0.01)


def test_pedestrians_alone(write: Write) -> None:
    path = clip(write, 29.97)
    path.with_name("intersection_01_traj_veh_filtered.csv").unlink()
    assert read_citr(path).ids == ("ped0",)


def test_a_clip_of_one_file_says_what_is_missing(write: Write) -> None:
    """A clip without pedestrians, or with a file for them that has no rows, is read and noted."""
    path = clip(write, 23.98)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.splitlines()[0] + "\n", encoding="utf-8")
    assert read_dut(path).ids == ("veh0",)
    assert read_dut(path).notes == ("intersection_01_traj_ped_filtered.csv has no rows",)
    path.unlink()
    (found,) = find_recordings("dut", path.parent)
    assert (found.name, found.read().ids) == ("intersection_01", ("veh0",))
    assert found.read().notes[0].startswith("there is no intersection_01_traj_ped_filtered.csv")
    vehicles = path.with_name("intersection_01_traj_veh_filtered.csv")
    vehicles.write_text(",".join(VEH) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="no file of this recording has rows"):
        found.read()


def test_errors(write: Write) -> None:
    path = clip(write, 23.98)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("ped", "dog"), encoding="utf-8")
    with pytest.raises(InputError, match=r"ped_filtered\.csv, line 2: unknown label 'dog'"):
        read_dut(path)
    path.write_text(text.replace("y_est", "y", 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"ped_filtered\.csv lacks the column 'y_est'"):
        read_dut(path)
    path.write_text(text.rstrip()[:-12], encoding="utf-8")
    with pytest.raises(InputError, match=r"ped_filtered\.csv, line 191: the file is cut off"):
        read_dut(path)
