"""Waiting positions of SUMO's persons, moved to the kerb, where real pedestrians wait to cross a street.

SUMO leads persons across a walking area to their stripe of the crossing. At round corners, the stripe ends beyond the
kerb: in a network of netgenerate, persons wait up to 1.6 m out on the carriageway, in the way of right-turning
vehicles. SUMO's vehicles ignore these persons and drive through them. A learned vehicle would wait for them, while they
wait for the vehicle. Learned pedestrians avoid these persons at their actual positions.
"""

from dataclasses import replace

import numpy as np

from slrl_sumo.routing.walking.walking_area import back_from
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network, is_walking_area
from slrl_sumo.sumo.refusals import Refusals
from slrl_sumo.sumo.road_users import person_edge

STANDING = 0.1
"""Speed (m/s) below which a person waits."""

_Place = tuple[float, float]


class WaitingPersons:
    """Persons that wait on the walking areas of a network."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        # SUMO names the edge of a person.
        self._areas = {lane.edge: lane.shape for lane in network.lanes if is_walking_area(lane.id)}
        self._known: dict[str, tuple[_Place, _Place | None]] = {}
        """Positions of persons that waited at the last call, and their places at the kerb."""

    def at_kerb(self, world: WorldState, n: int) -> WorldState:
        """`world` with SUMO's waiting persons moved onto their walking area; `world` itself if no person is moved.

        This concerns persons after the first `n` road users that wait beside their walking area, or at its edge.
        """
        waiting = n + np.flatnonzero((world.type[n:] == PEDESTRIAN) & (world.speed[n:] < STANDING))
        known, self._known = self._known, {}
        moved: dict[int, _Place] = {}
        for row in waiting.tolist():
            name, here = world.ids[row], (world.x.item(row), world.y.item(row))
            there, place = known.get(name, (None, None))
            if there != here:
                place = self._place(name, *here)
            self._known[name] = here, place
            if place is not None:
                moved[row] = place
        if not moved:
            return world
        x, y, rows = world.x.copy(), world.y.copy(), list(moved)
        x[rows], y[rows] = np.array(list(moved.values())).T
        return replace(world, x=x, y=y)

    def _place(self, person: str, x: float, y: float) -> _Place | None:
        area = None
        # SUMO refuses the call if a script has removed the person since the last step.
        with Refusals().of(person):
            area = self._areas.get(person_edge(self._api, person))
        return None if area is None else back_from(area, x, y)
