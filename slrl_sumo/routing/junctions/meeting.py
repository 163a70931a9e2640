"""Whether a vehicle meets an occupant of a junction in the conflict areas of both."""

import math
from collections.abc import Iterator

from slrl_sumo.routing.junctions.occupants import Occupant
from slrl_sumo.routing.junctions.right_of_way import time_to_cover

STANDING = 1.0
"""Speed (m/s) below which a vehicle in a conflict area is not expected to leave it in time."""
GAP = 0.5
"""Least time gap (s) between two road users in the same conflict area."""
SLOWEST = 0.1
"""Least speed (m/s) assumed of an approaching road user: a standing one is expected to start."""

SharedDistances = tuple[float, float, float, float]
"""A shared conflict area: m from the front of the ego vehicle to the begin of the area, m that it drives until its rear
has left the area, and the same two distances of the other road user."""


def meets(
    mine: Occupant, other: Occupant, areas: list[SharedDistances], until: float, *, priority: bool, pauses: bool
) -> Iterator[float]:
    """Distances (m) from the front of the ego vehicle to the shared `areas` in which it would meet the `other`
    occupant.

    `until`: m from its front to the end of its reservation. `pauses`: whether that end is a waiting position.
    """
    for enter, leave, their_enter, their_leave in areas:
        if enter > until:
            continue  # beyond the waiting position
        if their_enter > other.reserved_until:
            # The other vehicle waits before this area and needs it later. The ego vehicle must not stop in it. With
            # equal rights, a vehicle outside the junction does not go before a vehicle that waits inside, or that one
            # would wait for ever.
            first = not priority and not other.waits_at_red and other.entry_time < mine.entry_time == math.inf
            if first or (pauses and leave > until):
                yield enter
        elif (their_enter > 0.0 or (other.is_pedestrian and enter < 0.0)) and (
            is_idle(other, mine) or (priority and other.yields)
        ):
            continue  # the other road user goes second: it may be waiting for the ego vehicle, or yields to it
        elif not (
            _before(mine, leave, other, their_enter)
            or (_goes_on(other, their_leave) and _before(other, their_leave, mine, enter))
        ):
            yield enter


def stand_off(inside: Occupant, background: Occupant) -> bool:
    """Whether a learned vehicle inside a junction and a background vehicle are idle, waiting for each other.

    A SUMO vehicle stays 0.1 m behind its leader in the junction, so only the learned vehicle can resolve the deadlock.
    """
    return inside.idle and inside.entry_time < math.inf and background.idle and not background.is_pedestrian


def _goes_on(one: Occupant, leave: float) -> bool:
    """Whether a road user is expected to leave a conflict area, `leave` m ahead, without stopping or waiting in it."""
    pauses = not one.needs_turning_room and leave > one.reserved_until
    return not (one.may_be_stopped or pauses or one.speed < STANDING)


def is_idle(one: Occupant, other: Occupant) -> bool:
    """Whether vehicle `one` has stood for so long that vehicle `other` need not wait for it.

    Of two vehicles that wait for each other, exactly one goes: the vehicle whose exit is not blocked, else the vehicle
    that entered the junction first, else the vehicle that has stood for longer.
    """
    if one.exit_blocked != other.exit_blocked:
        return one.exit_blocked
    return one.idle and not (other.idle and (one.entry_time, -one.idle_time) < (other.entry_time, -other.idle_time))


def _before(one: Occupant, leave: float, other: Occupant, enter: float) -> bool:
    """Whether road user `one` leaves a conflict area before road user `other` enters it; distances in m."""
    if enter <= 0.0:
        return False
    comes = time_to_cover(enter, max(other.speed, SLOWEST), other.acceleration)
    return _time_to_leave(one, leave) + GAP < comes


def _time_to_leave(one: Occupant, leave: float) -> float:
    """Time (s) in which a road user covers `leave` m, inside the junction at no more than the pace of its way.

    Without that limit, cars that approached a U-turn at 6.9 m/s were expected to leave in 2.3 s, but needed 5 s.
    """
    pace = max(one.way.pace, STANDING)
    if one.speed > pace:
        before = min(max(one.ahead[0], 0.0), leave) if one.ahead else 0.0
        return before / (0.5 * (one.speed + pace)) + (leave - before) / pace
    faster = (pace * pace - one.speed * one.speed) / (2.0 * one.acceleration)
    if leave <= faster:
        return time_to_cover(leave, one.speed, one.acceleration)
    return (pace - one.speed) / one.acceleration + (leave - faster) / pace
