"""The scene on which decisions are based."""

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
    """The state of all road users at one time, the ground under them, and the routes of the learned road users.

    It contains everything on which a decision depends: no later part of a decision reads from SUMO.
    """

    world: WorldState
    rows: NDArray[np.intp]
    """Rows in `world` of the deciding road users, (n,)."""
    road_map: RoadMap
    route: RouteAhead | None = None
    """Routes of the first len(route) road users of `world`, which include `rows`; None if no routes are known."""
    group: NDArray[np.int64] | None = None
    """Group of each road user of `world`; road users of different groups do not perceive each other. None: one group.
    Simulations of recordings start from many frames at once, each of which is a group."""

    past: Floats | None = None
    """Motion in the last 2 s of the first len(past) road users of `world`, which include `rows`, (n, PAST, 2) (see
    slrl_sumo.perception.past_motion); None if the models do not read it."""

    places: tuple[Floats, Floats] | None = None
    """Actual positions (m, (m,) each) of the road users of `world`, if `world` has persons moved to the kerb for
    vehicles (see slrl_sumo.routing.walking.waiting_persons); pedestrians avoid persons at their actual positions."""

    def __len__(self) -> int:
        return len(self.rows)

    def groups(self) -> Iterator[tuple["Scene", NDArray[np.intp]]]:
        """Each group as a separate scene, with the indices (k,) of its deciding road users in `rows`."""
        if self.group is None:
            yield self, np.arange(len(self))
            return
        mine = self.group[self.rows]
        for group in np.unique(mine).tolist():
            members, places = np.flatnonzero(self.group == group), np.flatnonzero(mine == group)
            rows = np.searchsorted(members, self.rows[places])
            yield replace(self, world=self.world.take(members), rows=rows, group=None, past=None), places
