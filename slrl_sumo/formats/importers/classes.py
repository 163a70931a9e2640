"""Classes of recordings as one of the three types, with a default box where the data has none."""

from collections import Counter
from dataclasses import dataclass, replace
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
    "motorbike": RoadUserClass(RoadUserType.CAR, 2.2, 0.9),
    "tricycle": RoadUserClass(RoadUserType.CAR, 2.8, 1.1),
    "bicycle": BICYCLE,
    "bike": BICYCLE,  # TAF-BW
    "cyclist": BICYCLE,
    "pedestrian": PEDESTRIAN,
    "pedestrain": PEDESTRIAN,  # spelled as in SinD
    "person": PEDESTRIAN,
}
"""Class names of levelXdata, SinD, INTERACTION and TAF-BW, in lower case."""


UNKNOWN = -1
"""Type of road users of a class that is not known: they are left out."""


@dataclass(frozen=True, eq=False)
class Users:
    """U road users: their type and box."""

    type: NDArray[np.int8]
    """RoadUserType, or UNKNOWN."""
    length: Floats
    width: Floats
    notes: tuple[str, ...] = ()
    """What was done with classes that are not as documented."""

    def take(self, users: Integers) -> "Users":
        """The road users `users` (indices)."""
        return replace(self, type=self.type[users], length=self.length[users], width=self.width[users])


def users_of(
    table: Table, column: str, user: Integers, sizes: bool, classes: dict[str, RoadUserClass] = CLASSES
) -> Users:
    """The road users of a table of which `user` (N,) has the index for each row; with `sizes`, with the boxes of the
    columns length and width in their first rows.

    Where a size is 0 or empty, the default of the class is used. Road users of an unknown class get the type UNKNOWN;
    where a road user changes its class, the most frequent one counts; both are noted. Raises InputError, with line,
    where no class is known, and for an implausible size.
    """
    words = np.char.lower(table.words(column))
    values, _, which = codes(words)
    count = np.zeros((int(user.max()) + 1, len(values)), np.int64)
    np.add.at(count, (user, which), 1)
    names = [str(values[k]) for k in count.argmax(1).tolist()]
    unknown = Counter(name for name in names if name not in classes)
    if len(unknown) and unknown.total() == len(names):
        row = int(np.flatnonzero(words == next(iter(unknown)))[0])
        word = str(table.words(column)[row])
        raise InputError(f"{table.where(row)}: unknown {column} {word!r}; known are {', '.join(classes)}")
    notes = [
        f"{number} road user{'s' * (number > 1)} of the unknown {column} {name!r} left out"
        for name, number in sorted(unknown.items())
    ]
    if changing := int((np.count_nonzero(count, axis=1) > 1).sum()):
        notes.append(f"{changing} road user{'s' * (changing > 1)} with changing {column}: the most frequent one counts")
    known = [classes.get(name) for name in names]
    kind = np.array([UNKNOWN if one is None else one.type for one in known], np.int8)
    length = np.array([np.nan if one is None else one.length for one in known])
    width = np.array([np.nan if one is None else one.width for one in known])
    if sizes:
        _, rows = np.unique(user, return_index=True)
        for name, box in (("length", length), ("width", width)):
            given = table.numbers(name)[rows]
            if (odd := (given < 0) | (given > 60)).any():
                at = int(np.flatnonzero(odd)[0])
                raise InputError(f"{table.where(int(rows[at]))}: {name} {given[at]:g} is not a box in metres")
            box[given > 0] = given[given > 0]
    return Users(kind, length, width, tuple(notes))
