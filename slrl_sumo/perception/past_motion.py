"""The motion of road users in the last 2 s: stored during a simulation, or read from a recording."""

import numpy as np

from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState

PAST = 4
"""Number of known intervals before the last one: 2 s in all."""


def recorded_past(recording: Trajectories, rows: Integers) -> Floats:
    """Speed (m/s) and yaw rate (rad/s) at the PAST rows before each of the `rows`, the latest first, (n, PAST, 2).

    Before the first row of a track, the motion is assumed to be that of the first row.
    """
    before = np.maximum(rows[:, None] - np.arange(1, PAST + 1), recording.starts[recording.track[rows]][:, None])
    return np.stack([recording.speed[before], recording.yaw_rate[before]], -1)


def steady_past(speed: Floats) -> Floats:
    """The assumed past of new road users, (n, PAST, 2): straight ahead at their `speed` (m/s, (n,))."""
    return np.repeat(np.stack([speed, np.zeros_like(speed)], -1)[:, None], PAST, 1)


def later(past: Floats, speed: Floats, yaw_rate: Floats) -> Floats:
    """Shift `past` (n, PAST, 2) by one interval, which began with `speed` (m/s) and `yaw_rate` (rad/s), (n,) each."""
    return np.concatenate([np.stack([speed, yaw_rate], -1)[:, None], past[:, :-1]], 1)


class PastMotion:
    """Stores the motion of road users from decision to decision."""

    def __init__(self) -> None:
        self._time = -np.inf
        self._rows: dict[str, int] = {}
        self._past = np.zeros((0, PAST, 2))
        self._now: tuple[Floats, Floats] = np.zeros(0), np.zeros(0)

    def of(self, world: WorldState, n: int) -> Floats:
        """The past of the first `n` road users of `world`, (n, PAST, 2); unchanged by further calls at the same
        time."""
        new_time = world.time > self._time + 1e-6
        if world.time < self._time - 1e-6:  # a simulation that was set back
            self._rows, new_time = {}, True
        if not new_time and all(road_user in self._rows for road_user in world.ids[:n]):
            return self._past[[self._rows[road_user] for road_user in world.ids[:n]]]
        speed, yaw_rate = world.speed[:n], world.yaw_rate[:n]
        past = steady_past(speed)
        rows = np.array([self._rows.get(road_user, -1) for road_user in world.ids[:n]], np.int64)
        known = rows >= 0
        before = rows[known]
        past[known] = later(self._past, *self._now)[before] if new_time else self._past[before]
        self._time, self._past, self._now = world.time, past, (speed, yaw_rate)
        self._rows = {road_user: row for row, road_user in enumerate(world.ids[:n])}
        return past
