"""Which road users of a contact are at fault: those that moved into it.

Else road users would pay for what they cannot help: of 133 contacts of learned pedestrians in networks as the training
draws them, 57 were of SUMO's pedestrians that walked into one that stood.
"""

from collections.abc import Set

import numpy as np

from slrl_sumo.scene.contacts import contact_pairs
from slrl_sumo.scene.state import WorldState


def at_fault(pairs: Set[tuple[str, str]], before: WorldState, after: WorldState) -> set[str]:
    """Ids of the road users of `pairs` that are at fault for being in contact `after` a decision: the movement of one
    since `before` leads to the other's place of then, or the two would be apart had it stayed at its own.

    Road users that were not there before are not at fault.
    """
    found = set()
    for pair in pairs:
        for mine, other in (pair, pair[::-1]):
            if mine not in before.ids:
                continue
            needed = not _in_contact(_alone(before, mine), _alone(after, other))
            if needed or (other in before.ids and _in_contact(_alone(after, mine), _alone(before, other))):
                found.add(mine)
    return found


def _alone(world: WorldState, name: str) -> WorldState:
    return world.take(np.array([world.ids.index(name)]))


def _in_contact(a: WorldState, b: WorldState) -> bool:
    return any(len(pairs) for pairs in contact_pairs(a.join(b)))
