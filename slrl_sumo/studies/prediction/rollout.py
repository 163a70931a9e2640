"""Prediction error: recorded road users, simulated from their true state and compared with their recorded motion.

All road users of a start frame are simulated together (paper, section 3.5). Many start frames run as one batch: each is
a separate scene, and road users of different scenes do not perceive each other.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.learning.supervised.windows import PAST, reversing
from slrl_sumo.perception.past_motion import later, recorded_past, steady_past
from slrl_sumo.scene.advance import advance
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState

STEPS = 16
"""Intervals of a rollout: 6.4 s (paper, section 4.1)."""


@dataclass(frozen=True, eq=False)
class Cast:
    """U road users of the rollouts from some start frames: their scenes, and the intervals in which they take part.

    A road user moves as recorded until its motion is known (PAST intervals, as in training); then it is simulated to
    the end of its track or of the rollout. Parked road users, types without models, and cars that reverse move as
    recorded throughout: the models do not drive backwards, so that a simulation of reversing cars would measure
    nothing.
    """

    scene: Integers
    """Index of the start frame, (U,)."""
    track: Integers
    row: Integers
    """Row of the recording at the start frame, (U,); outside the track's rows if the road user appears later."""
    appears: Integers
    """First interval in which the road user is visible, (U,)."""
    enters: Integers
    """First interval in which the road user is simulated, (U,)."""
    leaves: Integers
    """Number of intervals from the start to the end of its track or of the rollout, (U,)."""
    reverses: NDArray[np.bool_]
    """Whether the road user is a reversing car, which moves as recorded instead of being simulated, (U,)."""

    def __len__(self) -> int:
        return len(self.scene)

    def take(self, rows: NDArray[np.intp]) -> "Cast":
        """The members `rows`."""
        return Cast(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


@dataclass(frozen=True, eq=False)
class Moment:
    """The input of the decisions of one interval of all scenes."""

    world: WorldState
    """All visible road users of all scenes."""
    scene: Integers
    """Scene of each road user of `world`."""
    rows: NDArray[np.intp]
    """Rows of `world` of the simulated road users, (m,)."""
    users: NDArray[np.intp]
    """Indices of the same road users in the cast, (m,)."""
    step: int
    next_x: Floats
    """True positions after the interval, (m,), m."""
    next_y: Floats
    past: Floats
    """Motion of the road users of `world` in the last 2 s, (n, PAST, 2) (see perception.past_motion)."""

    def scenes(self) -> Iterator[tuple["Moment", NDArray[np.intp]]]:
        """Each scene with simulated road users as a separate moment, with their indices (k,) in `rows`."""
        mine = self.scene[self.rows]
        for scene in np.unique(mine).tolist():
            members, places = np.flatnonzero(self.scene == scene), np.flatnonzero(mine == scene)
            yield (
                Moment(
                    self.world.take(members),
                    self.scene[members],
                    np.searchsorted(members, self.rows[places]),
                    self.users[places],
                    self.step,
                    self.next_x[places],
                    self.next_y[places],
                    self.past[members],
                ),
                places,
            )


Motion = tuple[Floats, Floats, Floats]
"""Acceleration (m/s²), yaw rate (rad/s) and top speed (m/s), each (m,)."""

Move = Callable[[Moment], Motion]
"""Returns the motion of the simulated road users of a moment."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Displacement errors of U simulated road users."""

    type: NDArray[np.int8]
    """RoadUserType, (U,)."""
    steps: Integers
    """Simulated intervals, (U,)."""
    error: Floats
    """Distance (m) to the true position after each interval since the entry, (U, STEPS); 0 after `steps`."""
    off_surface: Integers
    """Number of intervals that ended off the own surfaces, (U,); 0 without a map."""
    path: Floats
    """x, y (m) and heading at the start and after each interval, (U, STEPS + 1, 3), including recorded motion; without
    meaning while the road user is not visible."""


def cast_of(
    recording: Trajectories, starts: Integers, steps: int = STEPS, types: NDArray[np.bool_] | None = None
) -> Cast:
    """The cast of the rollouts that begin at the frames `starts` (S,), scene by scene, in the order of tracks.

    Only road users of the `types` (3,) are simulated, None: all types; all other road users move as recorded.
    """
    first_row = recording.starts[:-1]
    first, last = recording.frame[first_row], recording.frame[recording.starts[1:] - 1]
    scene, track = np.nonzero((first <= starts[:, None] + steps) & (last >= starts[:, None]))
    begin = starts[scene]
    row = first_row[track] + begin - first[track]
    enters = np.maximum(first[track] + PAST - begin, 0)
    leaves = np.minimum(last[track] - begin, steps)
    backwards = np.cumsum(reversing(recording))
    reverses = (enters < leaves) & (backwards[row + leaves] > backwards[np.minimum(row + enters - PAST, row + leaves)])
    as_recorded = recording.parked[track]
    if types is not None:
        as_recorded = as_recorded | ~types[recording.type[track]]
    reverses &= ~as_recorded
    return Cast(
        scene=scene,
        track=track,
        row=row,
        appears=np.maximum(first[track] - begin, 0),
        enters=np.where(as_recorded | reverses, steps, enters),
        leaves=leaves,
        reverses=reverses,
    )


def rollout(recording: Trajectories, cast: Cast, move: Move, roadmap: RoadMap | None = None) -> Errors:
    """Simulate the cast: in each interval `move` gives the motion, and `advance` applies it.

    With a map, it counts intervals that end off the own surfaces.
    """
    steps = STEPS
    users, kind = len(cast), recording.type[cast.track]
    length, width = recording.length[cast.track], recording.width[cast.track]
    state = np.zeros((6, users))  # x, y, heading, speed, acceleration, yaw rate
    recorded = np.stack(
        [recording.x, recording.y, recording.heading, recording.speed, recording.acceleration, recording.yaw_rate]
    )
    past = steady_past(np.zeros(users))
    errors, off_surface = np.zeros((users, steps)), np.zeros(users, np.int64)
    path = np.zeros((users, steps + 1, 3))
    for step in range(steps + 1):
        seen = np.flatnonzero((cast.appears <= step) & (step <= cast.leaves))
        as_recorded = seen[step <= cast.enters[seen]]
        state[:, as_recorded] = recorded[:, cast.row[as_recorded] + step]
        path[:, step] = state[:3].T
        if step == steps:
            break
        past[as_recorded] = recorded_past(recording, cast.row[as_recorded] + step)
        moving = (cast.enters[seen] <= step) & (step < cast.leaves[seen])
        world = _world(state[:, seen], kind[seen], length[seen], width[seen], moving)
        rows = np.flatnonzero(moving)
        moved = seen[rows]
        after = cast.row[moved] + step + 1
        truth = recording.x[after], recording.y[after]
        moment = Moment(world, cast.scene[seen], rows, moved, step, *truth, past[seen])
        acceleration, yaw_rate, top = move(moment)
        here = _world(state[:, moved], kind[moved], length[moved], width[moved], moving[rows])
        then = advance(here, acceleration, yaw_rate, top, recording.dt)
        past[moved] = later(past[moved], here.speed, here.yaw_rate)
        state[:, moved] = then.x, then.y, then.heading, then.speed, then.acceleration, then.yaw_rate
        off = np.hypot(then.x - moment.next_x, then.y - moment.next_y)
        errors[moved, step - cast.enters[moved]] = off
        if roadmap is not None:
            off_surface[moved] += ~OWN_SURFACE[kind[moved], roadmap.surface_at(then.x, then.y)]
    return Errors(kind, np.maximum(cast.leaves - cast.enters, 0), errors, off_surface, path)


def _world(
    state: Floats, kind: NDArray[np.int8], length: Floats, width: Floats, moving: NDArray[np.bool_]
) -> WorldState:
    # Selected columns are not contiguous; compiled functions would be compiled again for this layout.
    x, y, heading, speed, acceleration, yaw_rate = np.ascontiguousarray(state)
    names = ("",) * len(x)  # not used
    return WorldState(0.0, names, kind, x, y, heading, speed, acceleration, yaw_rate, length, width, moving)
