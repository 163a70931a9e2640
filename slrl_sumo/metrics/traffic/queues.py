"""Queues of vehicles: places, times, lengths and the vehicles that waited longest."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

QUEUE_SPEED = 0.5
"""Speed (m/s) below which a vehicle stands in a queue. With STANDING_SPEED, vehicles that move up would not count."""
QUEUE_CELL = 40.0
"""Side (m) of a square; standing vehicles in the same square form one queue."""
WAIT = 5.0
"""Least continuous standing time (s) of a vehicle in a queue: a vehicle that gives way briefly is no queue."""


@dataclass(frozen=True)
class Queue:
    """Standing vehicles at one place."""

    x: float
    """Mean position of the standing vehicles, m."""
    y: float
    begin: float
    """Simulation time at which the first vehicle stands, s."""
    end: float
    longest: int
    """Greatest number of vehicles that stand at the same time."""
    waited_s: float
    """Sum of the standing times of all vehicles, s."""
    first_id: str
    """The vehicle with the longest standing time; `first_s`: this time, s."""
    first_s: float


class StandingLanes:
    """The lanes on which vehicles stand, for the names of queues, because `Trajectories` have no lanes."""

    def __init__(self) -> None:
        self._lanes: dict[tuple[int, int], Counter[str]] = {}

    def add(self, world: WorldState, lanes: Sequence[str]) -> None:
        """Count the standing vehicles of `world`; `lanes`: SUMO's lane of each road user of `world`, '' without one."""
        for row in np.flatnonzero((world.speed < QUEUE_SPEED) & (world.type != RoadUserType.PEDESTRIAN)).tolist():
            if lanes[row]:
                self._lanes.setdefault(_square(world.x[row], world.y[row]), Counter())[lanes[row]] += 1

    def lane_of(self, queue: Queue) -> str:
        """The lane with most standing vehicles in the square of a queue; '' if unknown."""
        found = self._lanes.get(_square(queue.x, queue.y))
        return found.most_common(1)[0][0] if found else ""


def _square(x: float, y: float) -> tuple[int, int]:
    return int(x // QUEUE_CELL), int(y // QUEUE_CELL)


def find_queues(trajectories: Trajectories) -> list[Queue]:
    """All places at which vehicles stand for WAIT or longer, the greatest total standing time first."""
    t = trajectories
    standing = (t.speed < QUEUE_SPEED) & (t.type[t.track] != RoadUserType.PEDESTRIAN)
    new = np.ones(len(t), np.bool_)
    new[1:] = (np.diff(t.track) != 0) | (np.diff(t.frame) != 1) | (standing[1:] != standing[:-1])
    stop = np.cumsum(new) - 1
    long = np.bincount(stop)[stop] * t.dt >= WAIT
    rows = np.flatnonzero(standing & long)
    if not len(rows):
        return []
    # A stop belongs to the square in which it begins.
    begins = np.flatnonzero(new)[stop[rows]]
    squares = np.floor(np.column_stack([t.x[begins], t.y[begins]]) / QUEUE_CELL).astype(np.int64)
    _, place = np.unique(squares, axis=0, return_inverse=True)
    queues = [_queue(t, rows[place == k]) for k in range(int(place.max()) + 1)]
    return sorted(queues, key=lambda queue: (-queue.waited_s, queue.x, queue.y))


def _queue(t: Trajectories, rows: np.ndarray) -> Queue:
    tracks, waited = np.unique(t.track[rows], return_counts=True)
    first = int(np.argmax(waited))
    frames = t.frame[rows]
    return Queue(
        x=float(t.x[rows].mean()),
        y=float(t.y[rows].mean()),
        begin=float(t.t0 + t.dt * frames.min()),
        end=float(t.t0 + t.dt * frames.max()),
        longest=int(np.bincount(frames - frames.min()).max()),
        waited_s=float(len(rows) * t.dt),
        first_id=t.ids[int(tracks[first])].partition("#")[0],
        first_s=float(waited[first] * t.dt),
    )
