"""SinD: folders with Veh_smoothed_tracks.csv and Ped_smoothed_tracks.csv."""

from pathlib import Path

from slrl_sumo.formats.importers.parts import parts_of, samples_of
from slrl_sumo.formats.importers.resampling.resample import resample
from slrl_sumo.formats.importers.timed import period_of, read_timed
from slrl_sumo.formats.trajectories import Trajectories

LICENCE = "SinD: for non-commercial research, on request (https://github.com/SOTIF-AVLab/SinD)"


def read_sind(vehicles: Path) -> Trajectories:
    """Read the recording with vehicles in `Veh_smoothed_tracks.csv`; pedestrians, if any, are in files beside it.

    Headings of vehicles and bicycles are yaw_rad, the direction of the box (heading_rad is that of its motion).
    """
    walkers = vehicles.with_name("Ped_smoothed_tracks.csv")
    parts, notes = parts_of(
        [(vehicles, lambda file: read_timed(file, "yaw_rad")), (walkers, lambda file: read_timed(file, None))]
    )
    return resample(samples_of(parts, f"SinD {vehicles.resolve().parent.name}", LICENCE, period_of(parts), notes))
