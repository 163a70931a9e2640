"""Contents of the rows of FCD files, in any format (https://sumo.dlr.de/docs/Simulation/Output/FCDOutput.html)."""

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.extras import require
from slrl_sumo.scene.geometry import Floats, front_from_centre, heading_to_sumo
from slrl_sumo.scene.state import WorldState

SUFFIXES = (".xml.gz", ".xml", ".csv", ".parquet")
"""Suffixes of FCD files; they decide the format."""

CSV_COLUMNS = (
    *("timestep_time", "vehicle_id", "vehicle_x", "vehicle_y", "vehicle_angle", "vehicle_type"),
    *("vehicle_speed", "vehicle_pos", "vehicle_lane", "vehicle_edge", "vehicle_slope"),
)
"""Columns of the CSV and Parquet of SUMO 1.28. Persons use the same columns: they have an edge and no lane."""
HEIGHT_COLUMN = "vehicle_z"
"""The column that follows vehicle_y in networks that have heights."""
OWN_COLUMNS = ("mode", "learned")
"""Additional columns: the mode of a learned road user, empty where there is none, and 1 for learned ones, else 0. The
schema of SUMO's XML has neither: see `trace`."""


@dataclass(frozen=True)
class Heights:
    """What traces have in networks with heights only."""

    z: Floats
    """m, (n,)."""
    slope: Floats
    """Degrees in the direction of the lane or edge, (n,); no meaning where the road user is on none."""


@dataclass(frozen=True)
class Places:
    """FCD of the road users of a WorldState apart from their motion; parallel to it."""

    sumo_type: tuple[str, ...]
    """SUMO vehicle type id of each."""
    lane: tuple[str, ...]
    """Lane id of a vehicle, edge id of a person; '' where SUMO maps the road user nowhere."""
    lane_position: Floats
    """m from the start of the lane or edge, (n,); no meaning where `lane` is ''."""
    person: NDArray[np.bool_]
    """True for SUMO's persons, False for its vehicles, (n,)."""
    heights: Heights | None = None
    """None where the network is flat."""


def check_fcd_path(path: str | os.PathLike[str]) -> str:
    """The suffix (one of SUFFIXES) of an FCD file's name; InputError where there is none, or pyarrow is missing."""
    for suffix in SUFFIXES:
        if os.fspath(path).lower().endswith(suffix):
            if suffix == ".parquet":
                require("pyarrow", f"{os.fspath(path)}: Parquet")
            return suffix
    raise InputError(f"{os.fspath(path)}: FCD files end in .xml, .xml.gz, .csv or .parquet; give it one of these names")


def figures(time: float, world: WorldState, places: Places) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """x, y (m, of front bumpers), angle (degrees), speed (m/s) and position on the lane (m) as in FCD, (n,) each.

    Raises ValueError where one is not finite.
    """
    x, y = front_from_centre(world.x, world.y, world.heading, world.length)
    position = places.lane_position
    if not np.isfinite(position).all():
        position = np.where(np.array(places.lane) == "", 0.0, position)
    numbers = np.stack([x, y, world.speed, position])
    angle = np.round(heading_to_sumo(world.heading), 2) % 360.0  # 359.996 would print as 360.00
    if not (np.isfinite(numbers).all() and np.isfinite(angle).all()):
        raise ValueError(f"world at {time} s: positions, headings and speeds must be finite")
    numbers = np.round(numbers, 3)
    numbers[2:] = np.maximum(numbers[2:], 0.0)  # the schema allows no negative speed or pos
    x, y, speed, position = numbers + 0.0  # no "-0.000"
    return x, y, angle, speed, position


def table_columns(elevated: bool) -> tuple[str, ...]:
    """CSV_COLUMNS with HEIGHT_COLUMN if `elevated`, and OWN_COLUMNS."""
    after_y = CSV_COLUMNS.index("vehicle_y") + 1
    return (*CSV_COLUMNS[:after_y], *((HEIGHT_COLUMN,) if elevated else ()), *CSV_COLUMNS[after_y:], *OWN_COLUMNS)


def height_figures(places: Places, elevated: bool) -> tuple[Floats, Floats] | None:
    """z (m) and slope (degrees) as in FCD, (n,) each; None in a trace that is not `elevated`.

    Raises ValueError where that disagrees with `places`, or a value is not finite that has a meaning.
    """
    heights = places.heights
    if (heights is not None) != elevated:
        raise ValueError("heights are in all time steps of a trace or in none")
    if heights is None:
        return None
    slope: Floats = np.where(np.array(places.lane, np.object_) == "", 0.0, heights.slope)
    if not (np.isfinite(heights.z).all() and np.isfinite(slope).all()):
        raise ValueError("heights and slopes must be finite")
    z, slope = np.round(heights.z, 3), np.round(slope, 2)
    return z + 0.0, slope + 0.0  # no "-0.00"


def time_text(time: float) -> str:
    """A time (s) as FCD has it: two decimals, three where they are needed."""
    return f"{time + 0.0:.2f}" if abs(round(time, 2) - time) < 1e-6 else f"{time:.3f}"


def learned_modes(world: WorldState, modes: NDArray[np.integer] | None) -> tuple[list[int], list[int] | list[str]]:
    """Rows of the learned road users, and their modes; '' where they have none.

    Raises ValueError if the numbers of `modes` and learned road users differ.
    """
    learned: list[int] = np.flatnonzero(world.learned).tolist()
    if modes is None:
        return learned, [""] * len(learned)
    if len(modes) != len(learned):
        raise ValueError(f"{len(modes)} modes for {len(learned)} learned road users")
    return learned, modes.tolist()
