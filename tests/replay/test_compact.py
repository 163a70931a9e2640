import numpy as np
import pytest

from slrl_sumo.replay.compact import HEADING_UNITS, METRE, SPEED_UNITS, Rows, pack, run_starts, zigzag


def numbers(data: bytes) -> list[int]:
    """Zigzag base-128 numbers, read one by one as the format is described."""
    values, value, shift = [], 0, 0
    for byte in data:
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            values.append(-(value + 1) // 2 if value % 2 else value // 2)
            value = shift = 0
    return values


def unpack(streams: list[bytes], times: np.ndarray) -> np.ndarray:
    """Rows of user, step, x, y, heading, speed, state, by additions alone."""
    user, first, count, *columns = map(numbers, streams)
    rows, at, road_user = [], 0, 0
    for du, step, n in zip(user, first, count, strict=True):
        road_user += du
        x = y = vx = vy = heading = state = 0
        for k in range(n):
            dx, dy, turn, slip, change = (column[at] for column in columns)
            travelled = 0
            if k == 0:
                x, y = dx, dy
            else:
                vx, vy = (dx, dy) if k == 1 else (vx + dx, vy + dy)
                x, y = x + vx, y + vy
                ms = int(times[step + k] - times[step + k - 1])
                travelled = int(np.floor(np.sqrt(float(vx**2 + vy**2)) * (1000 * SPEED_UNITS / METRE) / ms + 0.5))
            heading, state = heading + turn, state + change
            angle = 2 * np.pi * heading / HEADING_UNITS
            rows.append((road_user, step + k, x / METRE, y / METRE, angle, (travelled + slip) / SPEED_UNITS, state))
            at += 1
    return np.array(rows)


@pytest.mark.parametrize("values", [[0], [-1, 1, 63, -64, 64, -65, 8191, 8192], [2**31, -(2**33), 0, 5]])
def test_numbers_come_back(values: list[int]) -> None:
    assert numbers(zigzag(np.array(values, np.int64))) == values


def test_numbers_are_as_small_as_they_can_be() -> None:
    assert zigzag(np.array([0, -1, 1, -2, 63, -64])) == bytes([0, 1, 2, 3, 126, 127])
    assert zigzag(np.array([64])) == bytes([0x80, 1])


def test_rows_come_back_within_half_a_unit() -> None:
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.integers(100, 900, 80))
    parts = []
    for user in (0, 2, 7):
        steps = np.flatnonzero(rng.random(80) < 0.9)
        n = len(steps)
        heading = np.cumsum(rng.normal(0, 1.5, n))
        x = 5e6 + np.cumsum(rng.normal(0, 1.0, n))
        y = -3e5 + np.cumsum(rng.normal(0, 1.0, n))
        parts.append((np.full(n, user), steps, x, y, heading, rng.uniform(0, 30, n), rng.integers(0, 22, n)))
    rows = Rows(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    back = unpack(pack(rows, times), times)
    assert back[:, 0].tolist() == rows.user.tolist()
    assert back[:, 1].tolist() == rows.step.tolist()
    assert np.abs(back[:, 2] - rows.x).max() <= 0.5 / METRE + 1e-9
    assert np.abs(back[:, 3] - rows.y).max() <= 0.5 / METRE + 1e-9
    off = np.mod(back[:, 4] - rows.heading + np.pi, 2 * np.pi) - np.pi
    assert np.abs(off).max() <= np.pi / HEADING_UNITS + 1e-9
    assert np.abs(back[:, 5] - rows.speed).max() <= 0.5 / SPEED_UNITS + 1e-9
    assert back[:, 6].tolist() == rows.state.tolist()


def row_line(x: list[float], step: list[int], user: list[int], speed: float) -> Rows:
    none = np.zeros(len(x))
    return Rows(np.array(user), np.array(step), np.array(x), none, none, none + speed, np.zeros(len(x), np.int64))


def test_runs_end_at_gaps_at_others_and_at_jumps() -> None:
    times = np.arange(0, 8000, 400)
    rows = row_line([0, 4, 8, 8, 100, 104, 104], [0, 1, 2, 4, 5, 6, 7], [0, 0, 0, 0, 0, 0, 1], 10.0)
    assert run_starts(rows, times).tolist() == [True, False, False, True, True, False, True]


def test_unknown_speeds_are_those_of_the_movement() -> None:
    times = np.arange(0, 4000, 400)
    rows = row_line([0, 4, 9], [0, 1, 2], [3, 3, 3], np.nan)
    assert unpack(pack(rows, times), times)[:, 5].tolist() == [0.0, 10.0, 12.5]
    # Fast trains are no jumps where nothing says how fast they are.
    assert run_starts(row_line([0, 24, 48], [0, 1, 2], [0, 0, 0], np.nan), times).tolist() == [True, False, False]
