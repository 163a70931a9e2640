"""Trajectories from floating car data (FCD): SUMO's own files and ours."""

import gzip
import os
import re
import zlib
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.records.fcd_steps import FcdStep, csv_steps, xml_steps
from slrl_sumo.records.fcd_write import check_fcd_path
from slrl_sumo.records.trajectories import Trajectories, track_names
from slrl_sumo.world.geometry import centre_from_front, heading_from_sumo, wrap_angle
from slrl_sumo.world.types import DECISION_INTERVAL, DEFAULT_LENGTH, DEFAULT_WIDTH, TYPE_NAMES, RoadUserType

_INTERVAL_MS = round(1000 * DECISION_INTERVAL)
_BICYCLE = re.compile("bike|cycl")
_PEDESTRIAN = re.compile("pedestrian|default_pedtype")


@dataclass
class _Table:
    """All rows of a file; compact arrays, so that memory follows the number of rows, not the size of the text."""

    untagged: bool
    """Whether persons and vehicles look alike, as in CSV."""
    steps: "array[int]" = field(default_factory=lambda: array("q"))
    """Time of each time step, ms."""
    key: "array[int]" = field(default_factory=lambda: array("q"))
    """Index into the road users below."""
    time: "array[int]" = field(default_factory=lambda: array("q"))
    """ms"""
    x: "array[float]" = field(default_factory=lambda: array("d"))
    y: "array[float]" = field(default_factory=lambda: array("d"))
    angle: "array[float]" = field(default_factory=lambda: array("d"))
    users: list[tuple[str, str]] = field(default_factory=list)
    """id and vehicle type id of each road user."""
    persons: set[int] = field(default_factory=set)
    """Road users that were seen as a person."""


def read_fcd(path: str | os.PathLike[str], types: Mapping[str, str] | None = None) -> Trajectories:
    """Read an FCD file (.xml, .xml.gz, .csv) of any constant step as Trajectories of 0.4 s from its first time step on.

    Rows at multiples of 0.4 s are taken as they are, others are interpolated linearly between two neighbouring steps
    of the file; a road user that is absent for a step goes on in a new track (`id#1`). Front bumpers become centres.

    `types` says which road user type ('car', 'bicycle', 'pedestrian') a vehicle type id is. Those it does not name:
    persons are pedestrians, ids with "bike" or "cycl" and without "motor" bicycles, the rest cars. In CSV, where
    SUMO does not tag persons, a person is who has an edge and no lane, or whose type id says "pedestrian". Lengths
    and widths are the defaults of the types. Containers, and persons at exactly the place of a vehicle (riding in it),
    are left out.

    Raises InputError, with file and line, where the file is missing, empty, malformed, cut off (and after how many
    complete time steps), of an irregular step or in geographic coordinates.
    """
    name = os.fspath(path)
    for vtype, kind in (types or {}).items():
        if kind not in TYPE_NAMES:
            raise InputError(f"type {vtype!r}: {kind!r} is none of {', '.join(TYPE_NAMES)}")
    suffix = check_fcd_path(path)
    try:
        if os.path.getsize(name) == 0:
            raise InputError(f"{name} is empty; give it a whole FCD file")
        with gzip.open(name) if suffix == ".xml.gz" else open(name, "rb") as file:
            table = _collect(name, csv_steps(name, file) if suffix == ".csv" else xml_steps(name, file))
    except (OSError, EOFError, zlib.error) as e:
        raise InputError(f"cannot read {name}: {getattr(e, 'strerror', None) or e}") from e
    if not table.users:
        raise InputError(f"{name} holds no road users")
    return _resample(name, table, _user_types(table, types or {}))


def _collect(name: str, steps: Iterator[FcdStep]) -> _Table:
    table = _Table(untagged=name.lower().endswith(".csv"))
    index: dict[tuple[str, bool], int] = {}
    for step in steps:
        time = _milliseconds(name, step)
        if table.steps and time <= table.steps[-1]:
            raise InputError(f"{name}, line {step.line}: time {step.time} does not come after the one before")
        table.steps.append(time)
        vehicles = {(row.x, row.y) for row in step.rows if not row.person}
        seen: set[int] = set()
        for row in step.rows:
            if row.person and (row.x, row.y) in vehicles:
                continue
            # A vehicle and a person may have the same id; only in XML can they be told apart in every step.
            key = index.setdefault((row.id, row.person and not table.untagged), len(table.users))
            if key == len(table.users):
                table.users.append((row.id, row.vtype))
            if key in seen:
                raise InputError(f"{name}, line {row.line}: {row.id!r} is twice in the time step {step.time}")
            seen.add(key)
            if row.person:
                table.persons.add(key)
            try:
                x, y, angle = float(row.x), float(row.y), float(row.angle)
            except ValueError:
                x = y = angle = np.nan
            if not np.isfinite(x + y + angle):
                raise InputError(
                    f"{name}, line {row.line}: {row.id!r} needs numbers as x, y and angle, "
                    f"they are {row.x!r}, {row.y!r}, {row.angle!r}"
                )
            table.key.append(key)
            table.time.append(time)
            table.x.append(x)
            table.y.append(y)
            table.angle.append(angle)
    return table


def _milliseconds(name: str, step: FcdStep) -> int:
    """Times are seconds or, with SUMO's --human-readable-time, [days:]hours:minutes:seconds."""
    try:
        seconds = 0.0
        for part, unit in zip(reversed(step.time.split(":")), (1, 60, 3600, 86400), strict=False):
            seconds += unit * float(part)
        return round(1000 * seconds)
    except (ValueError, OverflowError):
        raise InputError(f"{name}, line {step.line}: {step.time!r} is not a time") from None


def _user_types(table: _Table, types: Mapping[str, str]) -> NDArray[np.int8]:
    """RoadUserType of each road user of the table, (U,)."""
    # In CSV a person beside every edge looks like a vehicle, but its type may have been seen on a person elsewhere.
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


def _resample(name: str, table: _Table, user_type: NDArray[np.int8]) -> Trajectories:
    key, time = np.frombuffer(table.key, np.int64), np.frombuffer(table.time, np.int64)
    times = np.array(table.steps, np.int64)
    step = int(np.diff(times).min()) if len(times) > 1 else _INTERVAL_MS
    if (odd := np.diff(times) % step != 0).any():
        raise InputError(
            f"{name}: time steps are irregular: {step / 1000} s between some, "
            f"but {times[:-1][odd][0] / 1000} s is followed by {times[1:][odd][0] / 1000} s; write all of one length"
        )

    order = np.argsort(key, kind="stable")  # times came in order
    key, time = key[order], time[order]
    heading = heading_from_sumo(np.frombuffer(table.angle)[order])
    length = DEFAULT_LENGTH[user_type]
    x, y = centre_from_front(np.frombuffer(table.x)[order], np.frombuffer(table.y)[order], heading, length[key])

    # Runs without a gap, [start, end), and the frames within each.
    start = np.flatnonzero((np.diff(key, prepend=-1) != 0) | (np.diff(time, prepend=-1) != step))
    end = np.append(start[1:], len(key))
    first = -((times[0] - time[start]) // _INTERVAL_MS)  # rounded up
    last = (time[end - 1] - times[0]) // _INTERVAL_MS
    kept = first <= last
    start, first, count = start[kept], first[kept], (last - first + 1)[kept]

    track = np.repeat(np.arange(len(start)), count)
    frame = np.arange(len(track)) - np.repeat(np.cumsum(count) - count, count) + first[track]
    ahead = times[0] + frame * _INTERVAL_MS - time[start][track]  # ms since the first row of the run
    row = start[track] + ahead // step
    share = (ahead % step) / step
    following = row + (share > 0)
    users = key[start]
    return Trajectories(
        track=track,
        frame=frame,
        x=x[row] + share * (x[following] - x[row]),
        y=y[row] + share * (y[following] - y[row]),
        heading=wrap_angle(heading[row] + share * wrap_angle(heading[following] - heading[row])),
        ids=track_names(table.users[user][0] for user in users),
        type=user_type[users],
        length=length[users],
        width=DEFAULT_WIDTH[user_type[users]],
        dt=DECISION_INTERVAL,
        t0=float(times[0] / 1000),
        source=name,
    )
