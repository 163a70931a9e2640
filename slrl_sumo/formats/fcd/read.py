"""Trajectories from floating car data (FCD), SUMO's files and ours."""

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.table import FcdTable, read_table, user_types
from slrl_sumo.formats.fcd.trace import add_learned, learned_file
from slrl_sumo.formats.trajectories import Trajectories, track_names
from slrl_sumo.scene.geometry import Floats, centre_from_front, heading_from_sumo, wrap_angle
from slrl_sumo.scene.jumps import beyond_type
from slrl_sumo.scene.types import DECISION_INTERVAL, DEFAULT_LENGTH, DEFAULT_WIDTH, TYPE_NAMES

_INTERVAL_MS = round(1000 * DECISION_INTERVAL)


def read_fcd(
    path: str | os.PathLike[str],
    types: Mapping[str, str] | None = None,
    sizes: Mapping[str, tuple[float, float]] | None = None,
) -> Trajectories:
    """Read an FCD file (.xml, .xml.gz, .csv, .parquet) of any constant step as Trajectories of 0.4 s.

    Rows at multiples of 0.4 s after its first time step are kept; others are interpolated linearly between two
    neighbouring steps of the file. A road user that is absent for a step, that jumps (see `scene.jumps`), or that
    becomes learned or SUMO's again, continues in a new track (`id#1`). Front bumpers become centres.

    `learned` and `mode` come from the columns of CSV and Parquet, and of XML from the `.learned.csv` that a run leaves
    beside its trace. Files whose step does not divide 0.4 s have no mode: their moments are others than those to which
    modes led.

    `types` maps vehicle type ids to road user types ('car', 'bicycle', 'pedestrian'). Others are guessed: persons are
    pedestrians, ids with "bike" or "cycl" and without "motor" are bicycles, the rest cars. In CSV and Parquet, where
    SUMO does not mark persons, rows with an edge and no lane, or with "pedestrian" in the type id, are persons.
    `sizes` has lengths and widths (m) by vehicle type id; those of others are the defaults of the types. Containers,
    and persons at exactly the position of a vehicle (riding in it), are omitted.

    Raises InputError, with file and line, if the file is missing, empty, malformed, cut off (with the number of
    complete time steps), has irregular steps or geographic coordinates, or the file beside it is another trace's.
    """
    return read_fcd_types(path, types, sizes)[0]


def read_fcd_types(
    path: str | os.PathLike[str],
    types: Mapping[str, str] | None = None,
    sizes: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Trajectories, dict[str, str]]:
    """As `read_fcd`, with the vehicle type id of each vehicle, by its id; '' where the file names none."""
    for vtype, kind in (types or {}).items():
        if kind not in TYPE_NAMES:
            raise InputError(f"type {vtype!r}: {kind!r} is none of {', '.join(TYPE_NAMES)}")
    table, flaw = read_table(path)
    if flaw is not None:
        raise flaw
    if (beside := learned_file(Path(path))) is not None and beside.is_file():
        add_learned(table, beside)
    try:
        tracks = _resample(os.fspath(path), table, user_types(table, types or {}), sizes or {})
    except ValueError as error:  # Trajectories that cannot be
        raise InputError(f"{os.fspath(path)}: {error}") from None
    return tracks, {name: vtype for key, (name, vtype) in enumerate(table.users) if key not in table.persons}


def _resample(
    name: str, table: FcdTable, user_type: NDArray[np.int8], sizes: Mapping[str, tuple[float, float]]
) -> Trajectories:
    key, times = np.frombuffer(table.key, np.int32), np.array(table.steps, np.int64)
    time = times[np.frombuffer(table.step, np.int32)]
    step = int(np.diff(times).min()) if len(times) > 1 else _INTERVAL_MS
    if (odd := np.diff(times) % step != 0).any():
        raise InputError(
            f"{name}: time steps are irregular: {step / 1000} s between some, "
            f"but {times[:-1][odd][0] / 1000} s is followed by {times[1:][odd][0] / 1000} s; write all of one length"
        )

    order = np.argsort(key, kind="stable")  # times came in order
    key, time, learned = key[order], time[order], np.frombuffer(table.learned, np.int8)[order] > 0
    run = np.cumsum((np.diff(key, prepend=-1) != 0) | (np.diff(time, prepend=-1) != step))  # runs without a gap
    on_grid = _INTERVAL_MS % step == 0
    if on_grid:  # what lies between two moments can only be a gap
        at = np.flatnonzero((time - times[0]) % _INTERVAL_MS == 0)
        order, key, time, learned, run, step = order[at], key[at], time[at], learned[at], run[at], _INTERVAL_MS
    heading = heading_from_sumo(np.frombuffer(table.angle)[order])
    length, width = DEFAULT_LENGTH[user_type], DEFAULT_WIDTH[user_type]
    for user, (_, vtype) in enumerate(table.users):
        if vtype in sizes:
            length[user], width[user] = sizes[vtype]
    x, y = centre_from_front(np.frombuffer(table.x)[order], np.frombuffer(table.y)[order], heading, length[key])

    # Runs without a jump, [start, end), and the frames within each.
    new = (np.diff(run) != 0) | (np.diff(learned) != 0) | _jumps(user_type[key], x, y, heading, step / 1000)
    start = np.flatnonzero(np.append(True, new)[: len(key)])
    end = np.append(start, len(key))[1:]
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
        width=width[users],
        dt=DECISION_INTERVAL,
        t0=float(times[0] / 1000),
        source=name,
        learned=learned[start],
        mode=np.frombuffer(table.mode, np.int8)[order][row] - np.int8(1) if on_grid else np.zeros(0, np.int8),
    )


def _jumps(kind: NDArray[np.int8], x: Floats, y: Floats, heading: Floats, step: float) -> NDArray[np.bool_]:
    """Whether each row but the first is a jump from the one before, (n - 1,), in a file with a step of `step` s.

    SUMO's jumps take one step of any length: steps shorter than 0.4 s that do not divide it have the limits of 0.4 s.
    """
    return beyond_type(
        kind[1:],
        dx=np.diff(x),
        dy=np.diff(y),
        heading=heading[:-1],
        turn=wrap_angle(np.diff(heading)),
        seconds=max(step, DECISION_INTERVAL),
    )
