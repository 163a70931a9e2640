"""Which road users of a contact are at fault: those that moved into it.

Else road users would pay for what they cannot help: of 133 contacts of learned pedestrians in networks as the training
draws them, 57 were of SUMO's pedestrians that walked into one that stood.
"""

from collections.abc import Set

import numpy as np

from slrl_sumo.scene.contacts import COLLISION_DISTANCE
from slrl_sumo.scene.geometry import Floats, boxes_overlap
from slrl_sumo.scene.state import WorldState


def at_fault(pairs: Set[tuple[str, str]], before: WorldState, after: WorldState) -> set[str]:
    """Ids of the road users of `pairs` that are at fault for being in contact `after` a decision: the movement of one
    since `before` leads to the other's place of then, or the two would be apart had it stayed at its own.

    Road users that were not there before are not at fault.
    """
    then, now = ({name: row for row, name in enumerate(world.ids)} for world in (before, after))
    found = set()
    for pair in pairs:
        for mine, other in (pair, pair[::-1]):
            if mine not in then:
                continue
            needed = not _in_contact(_box(before, then[mine]), _box(after, now[other]))
            if needed or (other in then and _in_contact(_box(after, now[mine]), _box(before, then[other]))):
                found.add(mine)
    return found


def _box(world: WorldState, row: int) -> Floats:
    columns = (world.x, world.y, world.heading, world.length, world.width)
    return np.array([[column[row] for column in columns]])


def _in_contact(a: Floats, b: Floats) -> bool:
    """As contacts are counted: boxes that overlap, or centres closer than 0.5 m."""
    apart = np.hypot(*(a - b)[0, :2])
    return bool(apart < COLLISION_DISTANCE or boxes_overlap(a, b)[0])
