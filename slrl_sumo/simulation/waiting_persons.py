"""Where SUMO's persons wait to cross a street: real ones wait at the kerb.

SUMO leads persons across a walking area to their stripe of the crossing, which ends beyond the kerb where the corner is
round: in a network of netgenerate they wait up to 1.6 m out on the carriageway, on the way of those that turn right.
SUMO's vehicles do not see them there, and drive through. A learned one would wait for them, and they for it.
"""

import math
from dataclasses import replace

import numpy as np

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.network import Network, is_walking_area
from slrl_sumo.sumo.reader import Snapshot

STANDING = 0.1
"""m/s: slower is waiting."""
BACK = 0.5
"""m that they wait behind the kerb."""


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
            and (place := _back_from(area, snapshot.x.item(row), snapshot.y.item(row))) is not None
        }
        if not places:
            return world
        x, y = world.x.copy(), world.y.copy()
        for row, name in enumerate(world.ids):
            if name in places:
                x[row], y[row] = places[name]
        return replace(world, x=x, y=y)


def _back_from(outline: Floats, x: float, y: float) -> tuple[float, float] | None:
    """The place BACK inside an outline (k, 2) that is nearest to one outside of it, or nearer to it (m); None for one
    that is as far inside."""
    inside, least, nearest = False, math.inf, (x, y)
    for (ax, ay), (bx, by) in zip(outline.tolist(), np.roll(outline, -1, axis=0).tolist(), strict=True):
        dx, dy = bx - ax, by - ay
        share = min(max(((x - ax) * dx + (y - ay) * dy) / max(dx * dx + dy * dy, 1e-9), 0.0), 1.0)
        px, py = ax + share * dx, ay + share * dy
        if (away := math.hypot(x - px, y - py)) < least:
            least, nearest = away, (px, py)
        # A ray to the right crosses the outline an odd number of times.
        if (ay > y) != (by > y) and x < ax + (y - ay) / dy * dx:
            inside = not inside
    if (inside and least >= BACK) or least < 1e-6:
        return None
    back = (BACK if inside else -BACK) / least
    return nearest[0] + back * (x - nearest[0]), nearest[1] + back * (y - nearest[1])
