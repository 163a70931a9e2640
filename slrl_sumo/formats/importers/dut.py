"""DUT and CITR: NAME_traj_ped_filtered.csv and NAME_traj_veh_filtered.csv."""

from pathlib import Path

import numpy as np

from slrl_sumo.formats.importers.classes import CAR, PEDESTRIAN, RoadUserClass, users_of
from slrl_sumo.formats.importers.parts import Part, parts_of, samples_of
from slrl_sumo.formats.importers.resampling.resample import resample
from slrl_sumo.formats.importers.table import codes, read_table
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.geometry import wrap_angle
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
    """A clip; one of its two files may be missing. y and headings are turned; boxes are defaults."""
    name = pedestrians.name.removesuffix("_traj_ped_filtered.csv")

    def read_pedestrians(file: Path) -> Part:
        return _part(file, rate, "ped", PEDESTRIAN)

    def read_vehicles(file: Path) -> Part:
        return _part(file, rate, "veh", vehicle)

    vehicles = pedestrians.with_name(f"{name}_traj_veh_filtered.csv")
    parts, notes = parts_of([(pedestrians, read_pedestrians), (vehicles, read_vehicles)])
    return resample(samples_of(parts, f"{dataset} {name}", LICENCE, 1 / rate, notes))


def _part(file: Path, rate: float, label: str, kind: RoadUserClass) -> Part:
    headings = ["psi_est"] if label == "veh" else []
    table = read_table(file, ["id", "frame", "x_est", "y_est", *headings], ["label"], optional=headings)
    numbers, _, user = codes(table.integers("id"))
    return Part(
        table=table,
        users=users_of(table, "label", user, sizes=False, classes={label: kind}),
        ids=tuple(f"{label}{number}" for number in numbers),
        user=user,
        time=table.integers("frame") / rate,
        x=table.numbers("x_est"),
        y=-table.numbers("y_est"),
        heading=wrap_angle(-table.numbers("psi_est")) if headings else np.full(len(table), np.nan),
    )
