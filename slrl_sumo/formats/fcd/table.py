"""All rows of an FCD file as compact columns."""

import os
import re
from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import check_fcd_path
from slrl_sumo.formats.fcd.steps import FcdRow, FcdStep, csv_steps, xml_steps
from slrl_sumo.formats.sumo_time import parse_time
from slrl_sumo.input_files import open_input, plain_xml
from slrl_sumo.scene.types import MAX_POSITION, TYPE_NAMES, RoadUserType

_BICYCLE = re.compile("bike|cycl")
_PEDESTRIAN = re.compile("pedestrian|default_pedtype")
_COLUMNS = ("key", "step", "x", "y", "angle", "speed", "mode", "learned")


@dataclass
class FcdTable:
    """All rows of a file in its order, as compact arrays: memory grows with the number of rows, not with the text."""

    untagged: bool
    """Whether rows of persons and vehicles look alike, as in CSV and Parquet."""
    steps: "array[int]" = field(default_factory=lambda: array("q"))
    """Time of each time step, ms."""
    key: "array[int]" = field(default_factory=lambda: array("i"))
    """Index into the road users below."""
    step: "array[int]" = field(default_factory=lambda: array("i"))
    """Index into the time steps."""
    x: "array[float]" = field(default_factory=lambda: array("d"))
    """m, of the front bumper, as in the file; y and angle (degrees clockwise from north) likewise."""
    y: "array[float]" = field(default_factory=lambda: array("d"))
    angle: "array[float]" = field(default_factory=lambda: array("d"))
    speed: "array[float]" = field(default_factory=lambda: array("f"))
    """m/s; NaN where the file has none."""
    mode: "array[int]" = field(default_factory=lambda: array("b"))
    """1 + mode of learned road users, 0 where the file has none."""
    learned: "array[int]" = field(default_factory=lambda: array("b"))
    """1 where the file marks the road user as learned."""
    marks_learned: bool = False
    """Whether the file marks learned road users."""
    users: list[tuple[str, str]] = field(default_factory=list)
    """id and vehicle type id of each road user."""
    persons: set[int] = field(default_factory=set)
    """Road users that appear as a person."""

    def drop_last_step(self, rows: int) -> None:
        """Drop the last time step, and all rows after the first `rows`."""
        self.steps.pop()
        for name in _COLUMNS:
            del getattr(self, name)[rows:]


def read_table(
    path: str | os.PathLike[str], progress: Callable[[float], object] = lambda share: None
) -> tuple[FcdTable, InputError | None]:
    """All complete time steps of an FCD file up to its first error, and that error, or None.

    Containers, and persons at exactly the position of a vehicle (riding in it), are omitted. Raises InputError if there
    is no complete time step, or the file is missing, empty, not FCD or in geographic coordinates. `progress` is called
    with the share of the file that has been read.
    """
    name = os.fspath(path)
    suffix = check_fcd_path(path)
    table = FcdTable(untagged=suffix in (".csv", ".parquet"))
    try:
        with open_input(name) as raw:
            size = os.fstat(raw.fileno()).st_size
            if size == 0:
                raise InputError(f"{name} is empty; give it a whole FCD file")
            if suffix == ".parquet":
                from slrl_sumo.formats.fcd.parquet import parquet_steps  # pyarrow is an extra

                steps = parquet_steps(name, raw)
            else:
                steps = csv_steps(name, raw) if suffix == ".csv" else xml_steps(name, plain_xml(raw))
            for _ in _collect(name, steps, table):
                progress(raw.tell() / size)
    except OSError as e:
        raise InputError(f"cannot read {name}: {e.strerror or e}") from e
    except InputError as flaw:
        if not table.key:
            raise
        return table, flaw
    if not table.users:
        raise InputError(f"{name} holds no road users")
    return table, None


def _collect(name: str, steps: Iterator[FcdStep], table: FcdTable) -> Iterator[None]:
    """Append all steps to `table`, pausing after each; a step that raises InputError is not appended."""
    index: dict[tuple[str, bool], int] = {}
    for step in steps:
        time = _milliseconds(name, step)
        if table.steps and time <= table.steps[-1]:
            raise InputError(f"{name}, line {step.line}: time {step.time} does not come after the one before")
        before = len(table.key)
        table.steps.append(time)
        try:
            _append(name, step, table, index)
        except InputError:
            table.drop_last_step(before)
            raise
        yield


def _append(name: str, step: FcdStep, table: FcdTable, index: dict[tuple[str, bool], int]) -> None:
    vehicles = {(row.x, row.y) for row in step.rows if not row.person}
    now = len(table.steps) - 1
    seen: set[int] = set()
    for row in step.rows:
        if row.person and (row.x, row.y) in vehicles:
            continue
        # A vehicle and a person may have the same id; only XML distinguishes them in every step.
        key = index.setdefault((row.id, row.person and not table.untagged), len(table.users))
        if key == len(table.users):
            table.users.append((row.id, row.vtype))
        if key in seen:
            raise InputError(f"{name}, line {row.line}: {row.id!r} is twice in the time step {step.time}")
        seen.add(key)
        if row.person:
            table.persons.add(key)
        x, y, angle, speed, mode = _numbers(name, row)
        table.key.append(key)
        table.step.append(now)
        table.x.append(x)
        table.y.append(y)
        table.angle.append(angle)
        table.speed.append(speed)
        table.mode.append(mode)
        table.learned.append(bool(row.learned))
        table.marks_learned |= row.learned is not None


def _numbers(name: str, row: FcdRow) -> tuple[float, float, float, float, int]:
    """x, y, angle, speed and 1 + mode of a row, see FcdTable."""
    try:
        x, y, angle = float(row.x), float(row.y), float(row.angle)
    except ValueError:
        x = y = angle = np.nan
    if not (abs(x) <= MAX_POSITION and abs(y) <= MAX_POSITION and abs(angle) <= 1e4):
        raise InputError(
            f"{name}, line {row.line}: {row.id!r} needs numbers as x, y and angle, "
            f"they are {row.x!r}, {row.y!r}, {row.angle!r}"
        )
    try:
        speed = np.nan if row.speed == "" else float(row.speed)
        # pandas writes columns with gaps as floats: 3.0 for 3.
        mode = 0 if row.mode == "" else 1 + int(float(row.mode))
        if not 0 <= mode <= 100:
            raise ValueError
    except ValueError:
        raise InputError(
            f"{name}, line {row.line}: {row.id!r} has the speed {row.speed!r} and the mode {row.mode!r}; "
            "a number and a mode from 0 on, or nothing, are due"
        ) from None
    return x, y, angle, speed, mode


def _milliseconds(name: str, step: FcdStep) -> int:
    seconds = parse_time(step.time)
    if seconds is None or not abs(seconds) <= 1e10:
        raise InputError(f"{name}, line {step.line}: {step.time!r} is not a time")
    return round(1000 * seconds)


def user_types(table: FcdTable, types: Mapping[str, str]) -> NDArray[np.int8]:
    """RoadUserType of each road user of the table, (U,). `types`: vehicle type id to type name, see `read_fcd`."""
    # In CSV a person off all edges looks like a vehicle, but its type may belong to a person elsewhere.
    walking = {vtype for key in table.persons if (vtype := table.users[key][1])} if table.untagged else set()
    kinds = []
    for key, (_, vtype) in enumerate(table.users):
        lower = vtype.lower()
        if vtype in types:
            kind = RoadUserType(TYPE_NAMES.index(types[vtype]))
        elif key in table.persons or vtype in walking or (table.untagged and _PEDESTRIAN.search(lower)):
            kind = RoadUserType.PEDESTRIAN
        elif _BICYCLE.search(lower) and "motor" not in lower:
            kind = RoadUserType.BICYCLE
        else:
            kind = RoadUserType.CAR
        kinds.append(kind)
    return np.array(kinds, np.int8)
