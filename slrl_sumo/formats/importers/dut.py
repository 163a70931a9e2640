"""DUT and CITR: NAME_traj_ped_filtered.csv and NAME_traj_veh_filtered.csv."""

from pathlib import Path

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.classes import CAR, PEDESTRIAN, RoadUserClass
from slrl_sumo.formats.importers.resample import Samples, resample
from slrl_sumo.formats.importers.table import codes, read_table
from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.types import RoadUserType

LICENCE = "DUT and CITR: MIT (Dongfang Yang 2019, https://github.com/dongfang-steven-yang/vci-dataset-dut)"

GOLF_CART = RoadUserClass(RoadUserType.CAR, 2.4, 1.2)


def read_dut(pedestrians: Path) -> Trajectories:
    """Read one clip of DUT: cars and crowds on a campus, 23.98 frames per second."""
    return _read(pedestrians, 23.98, CAR, "DUT")


def read_citr(pedestrians: Path) -> Trajectories:
    """Read one clip of CITR: a golf cart and pedestrians in an experiment, 29.97 frames per second."""
    return _read(pedestrians, 29.97, GOLF_CART, "CITR")


def _read(pedestrians: Path, rate: float, vehicle: RoadUserClass, dataset: str) -> Trajectories:
    """A clip; vehicles, if any, are in a file beside the pedestrians. y and headings are turned; boxes are defaults."""
    name = pedestrians.name.removesuffix("_traj_ped_filtered.csv")
    vehicles = pedestrians.with_name(f"{name}_traj_veh_filtered.csv")
    files = [(pedestrians, "ped", PEDESTRIAN), (vehicles, "veh", vehicle)]
    columns: list[list[Floats]] = []
    user: list[Integers] = []
    ids: list[str] = []
    classes: list[RoadUserClass] = []
    for file, label, kind in files:
        if file == vehicles and not file.exists():
            continue
        table = read_table(file, ["id", "frame", "x_est", "y_est", *(["psi_est"] if label == "veh" else [])], ["label"])
        words = table.words("label")
        if (unknown := np.char.lower(words) != label).any():
            row = int(np.flatnonzero(unknown)[0])
            raise InputError(f"{table.where(row)}: unknown label {str(words[row])!r}; known here is {label!r}")
        heading = wrap_angle(-table.numbers("psi_est")) if label == "veh" else np.full(len(table), np.nan)
        numbers, _, which = codes(table.integers("id"))
        user.append(which + len(ids))
        ids += [f"{label}{number}" for number in numbers]
        classes += [kind] * len(numbers)
        columns.append([table.integers("frame") / rate, table.numbers("x_est"), -table.numbers("y_est"), heading])
    time, x, y, heading = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    return resample(
        Samples(
            file=str(pedestrians),
            source=f"{dataset} {name}",
            licence=LICENCE,
            user=np.concatenate(user),
            time=time,
            x=x,
            y=y,
            heading=heading,
            period=1 / rate,
            ids=tuple(ids),
            type=np.array([c.type for c in classes], np.int8),
            length=np.array([c.length for c in classes]),
            width=np.array([c.width for c in classes]),
            still=np.zeros(len(ids)),
        )
    )
