"""SinD: folders with Veh_smoothed_tracks.csv and Ped_smoothed_tracks.csv."""

from pathlib import Path

from slrl_sumo.formats.importers.resample import resample
from slrl_sumo.formats.importers.timed import read_timed, samples_of
from slrl_sumo.formats.trajectories import Trajectories

LICENCE = "SinD: for non-commercial research, on request (https://github.com/SOTIF-AVLab/SinD)"


def read_sind(vehicles: Path) -> Trajectories:
    """Read the recording whose vehicles are in `Veh_smoothed_tracks.csv`; pedestrians, if any, are in files beside it.

    Headings of vehicles and bicycles are yaw_rad, the direction of the box (heading_rad is that of its motion).
    """
    parts = [read_timed(vehicles, "yaw_rad")]
    walkers = vehicles.with_name("Ped_smoothed_tracks.csv")
    if walkers.exists():
        parts.append(read_timed(walkers, None))
    return resample(samples_of(parts, f"SinD {vehicles.resolve().parent.name}", LICENCE))
