"""The state of a traffic scene at one time."""

from dataclasses import dataclass, fields
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats


@dataclass(frozen=True)
class WorldState:
    """All road users at one time, as parallel arrays of length n.

    Frame: metres, x east, y north; headings in radians counter-clockwise from +x, in (-pi, pi].
    Positions are centres of boxes. No sentinels: every entry is a real value.
    """

    time: float
    """Simulation time in s."""
    ids: tuple[str, ...]
    """SUMO's ids, (n,)."""
    type: NDArray[np.int8]
    """RoadUserType of each road user, (n,): 0 car, 1 bicycle, 2 pedestrian."""
    x: Floats
    """x of the centre of the box, m; SUMO's positions of vehicles are those of front bumpers."""
    y: Floats
    """y of the centre of the box, m."""
    heading: Floats
    """Heading, rad counter-clockwise from +x, in (-pi, pi]."""
    speed: Floats
    """Speed in the direction of motion, m/s, not negative: distance covered in the last interval over its duration."""
    acceleration: Floats
    """Acceleration, m/s²: change of `speed` in the last interval over its duration; 0 without an earlier state."""
    yaw_rate: Floats
    """Yaw rate, rad/s: change of `heading` in the last interval over its duration; 0 without an earlier state."""
    length: Floats
    """Box length in m, along the heading."""
    width: Floats
    """Box width in m."""
    learned: NDArray[np.bool_]
    """True for road users that are moved by learned models, False for background traffic."""

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: NDArray[np.intp]) -> "WorldState":
        """The road users `rows` (integer indices) as a separate world."""
        ids = tuple(map(self.ids.__getitem__, rows.tolist()))
        return WorldState(self.time, ids, *[values[rows] for values in _arrays(self)])

    def join(self, other: "WorldState") -> "WorldState":
        """The road users of both worlds, those of `self` first, at the time of `self`."""
        both = zip(_arrays(self), _arrays(other), strict=True)
        return WorldState(self.time, self.ids + other.ids, *[np.concatenate(pair) for pair in both])


_arrays = attrgetter(*(field.name for field in fields(WorldState) if field.name not in ("time", "ids")))


def empty_world(time: float = 0.0) -> WorldState:
    """A world without road users."""
    none = np.zeros(0)
    return WorldState(
        time=time,
        ids=(),
        type=np.zeros(0, np.int8),
        x=none,
        y=none,
        heading=none,
        speed=none,
        acceleration=none,
        yaw_rate=none,
        length=none,
        width=none,
        learned=np.zeros(0, np.bool_),
    )
