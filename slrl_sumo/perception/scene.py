"""The scene that decisions are taken from."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.state import WorldState


@dataclass(frozen=True, eq=False)
class Scene:
    """One moment of all road users, the ground under them, and the routes of the learned ones.

    Everything that a decision depends on is in here: nothing behind it asks SUMO again.
    """

    world: WorldState
    rows: NDArray[np.intp]
    """Rows of `world` that decide, (n,)."""
    road_map: RoadMap
    route: RouteAhead | None = None
    """Routes of the first len(route) road users of `world`, `rows` among them; None where no routes are known."""
    group: NDArray[np.int64] | None = None
    """Group of each road user of `world`; road users of different groups do not perceive each other. None: one group.
    Recordings are simulated from many start frames at once, each a group of its own."""

    past: Floats | None = None
    """Motion of the first len(past) road users of `world`, `rows` among them, in the last 2 s, (n, PAST, 2) (see
    slrl_sumo.perception.past_motion); None where the models do not read it."""

    places: tuple[Floats, Floats] | None = None
    """Where the m road users of `world` are, m, (m,) each, if not all are where vehicles expect them: persons that wait
    at a kerb (see slrl_sumo.routing.waiting_persons). Pedestrians avoid them here."""

    def __len__(self) -> int:
        return len(self.rows)

    def groups(self) -> Iterator[tuple["Scene", NDArray[np.intp]]]:
        """Each group as a scene of its own, with the places (k,) that its deciding road users have among `rows`."""
        if self.group is None:
            yield self, np.arange(len(self))
            return
        mine = self.group[self.rows]
        for group in np.unique(mine).tolist():
            members, places = np.flatnonzero(self.group == group), np.flatnonzero(mine == group)
            rows = np.searchsorted(members, self.rows[places])
            yield replace(self, world=self.world.take(members), rows=rows, group=None, past=None), places
