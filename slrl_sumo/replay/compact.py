"""Compact encoding of positions of many road users, which the replay page decodes (assets/unpack.js)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats

Ints = NDArray[np.int64]

METRE = 100
"""Units of position in a metre: 1 cm."""
HEADING_UNITS = 1024
"""Units of heading in a whole turn: 0.35 degrees."""
SPEED_UNITS = 10
"""Units of speed in 1 m/s."""
JUMP_SPEED = 70.0
"""Speed (m/s) between two steps above which a road user has jumped."""
JUMP_SLACK = 4.0
"""Additional distance (m): without the sublane model, SUMO changes lanes in one step."""


@dataclass(frozen=True)
class Rows:
    """Positions of many road users, all of one after the other, in the order of time within each. n rows."""

    user: Ints
    """Index of the road user, (n,), ascending."""
    step: Ints
    """Index of the time step, (n,), ascending within a road user."""
    x: Floats
    """Centre, m, (n,)."""
    y: Floats
    heading: Floats
    """rad, (n,)."""
    speed: Floats
    """m/s, (n,); NaN where unknown."""
    state: Ints
    """(n,): 0 not learned, 1 learned without a mode, 2 + mode."""


def pack(rows: Rows, times: Ints) -> list[bytes]:
    """The rows as streams of bytes. `times`: ms of each time step, (steps,).

    A *run* is a road user in consecutive time steps. The streams, all of zigzag base-128 numbers: user of each run less
    that of the run before; its first step; its number of rows; then, for all rows of all runs: x and y (second
    differences), heading (first differences, over the shorter way), speed (less what the last movement was), state
    (first differences). The first row of a run counts from 0, the second has a first difference.
    """
    start = run_starts(rows, times)
    first = np.flatnonzero(start)
    count = np.diff(np.append(first, len(start)))
    x, y = (np.rint(METRE * v).astype(np.int64) for v in (rows.x, rows.y))
    heading = np.rint(rows.heading * (HEADING_UNITS / (2 * np.pi))).astype(np.int64) % HEADING_UNITS
    turn = np.where(
        start, heading, (_difference(heading, start) + HEADING_UNITS // 2) % HEADING_UNITS - HEADING_UNITS // 2
    )
    travelled = _travelled(x, y, start, times[rows.step])
    known = np.isfinite(rows.speed)
    speed = np.where(known, np.rint(SPEED_UNITS * np.where(known, rows.speed, 0.0)).astype(np.int64), travelled)
    columns = (
        np.diff(rows.user[first], prepend=0),
        rows.step[first],
        count,
        _second_difference(x, start),
        _second_difference(y, start),
        turn,
        speed - travelled,
        _difference(rows.state, start),
    )
    return [zigzag(column) for column in columns]


def run_starts(rows: Rows, times: Ints) -> NDArray[np.bool_]:
    """Where a run begins, (n,): another road user, steps left out, or further off than one can go in a step."""
    start = np.ones(len(rows.user), np.bool_)
    start[1:] = (np.diff(rows.user) != 0) | (np.diff(rows.step) != 1)
    seconds = np.diff(times[rows.step]) / 1000.0
    # Where speeds are known they say more: three times as far as the faster one of both rows is a jump.
    faster = np.fmax(rows.speed[1:], rows.speed[:-1])
    most = np.where(np.isfinite(faster), np.minimum(3.0 * faster, JUMP_SPEED), JUMP_SPEED)
    start[1:] |= np.hypot(np.diff(rows.x), np.diff(rows.y)) > most * seconds + JUMP_SLACK
    return start


def _travelled(x: Ints, y: Ints, start: NDArray[np.bool_], time: Ints) -> Ints:
    """Speed of the movement to each row, in units of speed; 0 at the first row of a run. The page computes the same."""
    square = (_difference(x, start) ** 2 + _difference(y, start) ** 2).astype(np.float64)
    milliseconds = np.where(start, 1, _difference(time, start)).astype(np.float64)
    speed = np.floor(np.sqrt(square) * (1000.0 * SPEED_UNITS / METRE) / milliseconds + 0.5).astype(np.int64)
    return np.where(start, 0, speed)


def _difference(values: Ints, start: NDArray[np.bool_]) -> Ints:
    return np.where(start, values, np.diff(values, prepend=0))


def _second_difference(values: Ints, start: NDArray[np.bool_]) -> Ints:
    step = _difference(values, start)
    second = np.diff(step, prepend=0)
    return np.where(start | np.concatenate([[False], start[:-1]]), step, second)


def zigzag(values: Ints) -> bytes:
    """Whole numbers as bytes: 0, -1, 1, -2 … become 0, 1, 2, 3 …, then seven bits a byte, the lowest ones first; a set
    top bit says that more follow. Numbers below 2**34 in size."""
    coded = np.where(values < 0, -2 * values - 1, 2 * values).astype(np.uint64)
    count = np.searchsorted(np.uint64(1) << np.array([7, 14, 21, 28], np.uint64), coded, side="right") + 1
    out = np.zeros(int(count.sum()), np.uint8)
    at = np.cumsum(count) - count
    for k in range(5):
        mine = count > k
        more = np.where(count[mine] > k + 1, 0x80, 0)
        piece = (coded[mine] >> np.uint64(7 * k)) & np.uint64(0x7F)
        out[at[mine] + k] = piece.astype(np.uint8) | more.astype(np.uint8)
    return out.tobytes()
