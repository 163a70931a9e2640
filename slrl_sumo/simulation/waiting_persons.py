"""Where SUMO's persons wait to cross a street: real ones wait at the kerb.

SUMO leads persons across a walking area to their stripe of the crossing, which ends beyond the kerb where the corner is
round: in a network of netgenerate they wait up to 1.6 m out on the carriageway, on the way of those that turn right.
SUMO's vehicles do not see them there, and drive through. A learned one would wait for them, and they for it.
"""

from dataclasses import replace

import numpy as np

from slrl_sumo.routing.walking_area import back_from
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.network import Network, is_walking_area
from slrl_sumo.sumo.reader import Snapshot

STANDING = 0.1
"""m/s: slower is waiting."""


class WaitingPersons:
    """Persons that wait on the walking areas of a network."""

    def __init__(self, network: Network) -> None:
        # SUMO names the edge of a person.
        self._areas = {lane.edge: lane.shape for lane in network.lanes if is_walking_area(lane.id)}

    def at_kerb(self, world: WorldState, snapshot: Snapshot) -> WorldState:
        """`world` with the persons that SUMO has waiting beside their walking area, or at its edge, on it; `snapshot`:
        SUMO's road users now."""
        waiting = np.flatnonzero(snapshot.person & (snapshot.speed < STANDING)).tolist()
        places = {
            snapshot.ids[row]: place
            for row in waiting
            if (area := self._areas.get(snapshot.lane[row])) is not None
            and (place := back_from(area, snapshot.x.item(row), snapshot.y.item(row))) is not None
        }
        if not places:
            return world
        x, y = world.x.copy(), world.y.copy()
        for row, name in enumerate(world.ids):
            if name in places:
                x[row], y[row] = places[name]
        return replace(world, x=x, y=y)
