"""Which of two vehicles with routes goes first where their paths meet."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.forecast import PathFollowing
from slrl_sumo.perception.leaders import way_code
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats


class Precedence(NamedTuple):
    """An order of vehicles in which each waits only for earlier ones, so that they cannot all wait for each other."""

    entered: Floats
    """s: when each of n learned road users entered the junction that it is in; inf outside, and for those that do not
    follow their paths, (n,)."""
    follows: NDArray[np.bool_]
    """Which of them follow their paths, (n,)."""
    in_way: NDArray[np.int64]
    """See perception.leaders.Leaders."""
    users: int
    """Of the world."""


def precedence(context: RouteContext | None, following: PathFollowing, users: int) -> Precedence:
    """The precedence among the road users of `context`, the first ones of a world of so many `users`."""
    if context is None:
        return Precedence(np.zeros(0), following.follows, np.zeros(0, np.int64), users)
    return Precedence(context.route.junction_entry_time, following.follows, context.in_way, users)


@compiled
def goes_first(ego: int, other: int, order: Precedence) -> bool:
    """Whether road user `other` waits for `ego`.

    One that is in the other's way has to clear it, whatever the order; else the one that entered its junction first
    goes first. Outside of junctions, and for road users without a path, there is no order, and neither is expected
    to wait.
    """
    if max(ego, other) >= len(order.follows) or not (order.follows[ego] and order.follows[other]):
        return False
    ahead, behind = (
        _among(order.in_way, way_code(other, ego, order.users)),
        _among(order.in_way, way_code(ego, other, order.users)),
    )
    if ahead != behind:
        return ahead
    mine, theirs = order.entered[ego], order.entered[other]
    return bool(mine < theirs or (mine == theirs and mine < np.inf and ego < other))


@compiled
def _among(codes: NDArray[np.int64], code: int) -> bool:
    """Whether sorted `codes` contain `code`."""
    low, high = 0, len(codes)
    while low < high:
        middle = (low + high) // 2
        if codes[middle] < code:
            low = middle + 1
        else:
            high = middle
    return bool(low < len(codes) and codes[low] == code)
