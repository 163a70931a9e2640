"""Classes of recordings as one of the three types, with a default box where the data has none."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.table import Table, codes
from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, RoadUserType


class RoadUserClass(NamedTuple):
    """Meaning of a class name of the data."""

    type: RoadUserType
    length: float
    """Box length in m where the data has none."""
    width: float


def default_class(kind: RoadUserType) -> RoadUserClass:
    """The type with its default box."""
    return RoadUserClass(kind, float(DEFAULT_LENGTH[kind]), float(DEFAULT_WIDTH[kind]))


CAR = default_class(RoadUserType.CAR)
BICYCLE = default_class(RoadUserType.BICYCLE)
PEDESTRIAN = default_class(RoadUserType.PEDESTRIAN)

# Boxes are SUMO's defaults of the nearest vehicle class
# (https://sumo.dlr.de/docs/Vehicle_Type_Parameter_Defaults.html); that of a cargo tricycle is a typical one.
CLASSES = {
    "car": CAR,
    "van": RoadUserClass(RoadUserType.CAR, 6.5, 2.16),
    "truck": RoadUserClass(RoadUserType.CAR, 7.1, 2.4),
    "truck_bus": RoadUserClass(RoadUserType.CAR, 12.0, 2.5),
    "bus": RoadUserClass(RoadUserType.CAR, 12.0, 2.5),
    "trailer": RoadUserClass(RoadUserType.CAR, 7.1, 2.4),
    "tram": RoadUserClass(RoadUserType.CAR, 22.0, 2.4),
    "motorcycle": RoadUserClass(RoadUserType.CAR, 2.2, 0.9),
    "tricycle": RoadUserClass(RoadUserType.CAR, 2.8, 1.1),
    "bicycle": BICYCLE,
    "cyclist": BICYCLE,
    "pedestrian": PEDESTRIAN,
    "pedestrain": PEDESTRIAN,  # spelled as in SinD
    "person": PEDESTRIAN,
}
"""Class names of levelXdata, SinD, INTERACTION and TAF-BW, in lower case."""


@dataclass(frozen=True, eq=False)
class Users:
    """U road users: their type and box."""

    type: NDArray[np.int8]
    length: Floats
    width: Floats

    def take(self, users: Integers) -> "Users":
        """The road users `users` (indices)."""
        return Users(self.type[users], self.length[users], self.width[users])


def users_of(
    table: Table, column: str, rows: Integers, sizes: bool, classes: dict[str, RoadUserClass] = CLASSES
) -> Users:
    """The road users whose first rows in the table are `rows`; with `sizes`, from its columns length and width.

    Where these are 0 (VRUs of levelXdata), the default of the class is used. Raises InputError, with line, for an
    unknown class or an implausible size.
    """
    words = table.words(column)
    values, first, _ = codes(words)
    unknown = [int(row) for row, word in zip(first, values.tolist(), strict=True) if str(word).lower() not in classes]
    if unknown:
        row = min(unknown)
        raise InputError(f"{table.where(row)}: unknown {column} {str(words[row])!r}; known are {', '.join(classes)}")
    known = [classes[word.lower()] for word in words[rows].tolist()]
    length, width = np.array([one.length for one in known]), np.array([one.width for one in known])
    if sizes:
        for name, values in (("length", length), ("width", width)):
            given = table.numbers(name)[rows]
            if (odd := (given < 0) | (given > 60)).any():
                at = int(np.flatnonzero(odd)[0])
                raise InputError(f"{table.where(int(rows[at]))}: {name} {given[at]:g} is not a box in metres")
            values[given > 0] = given[given > 0]
    return Users(np.array([one.type for one in known], np.int8), length, width)
