"""Precedence of vehicles with routes: which of two vehicles goes first where their paths meet."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.lookahead.forecast import PathFollowing
from slrl_sumo.perception.leaders import way_code
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats


class Precedence(NamedTuple):
    """An order in which each vehicle waits only for earlier vehicles, so that no circle of waiting vehicles forms."""

    entered: Floats
    """Time (s) at which each of n learned road users entered its junction; inf outside and if unknown, (n,)."""
    follows: NDArray[np.bool_]
    """Whether the road user follows its path, (n,)."""
    in_way: NDArray[np.int64]
    """See perception.leaders.Leaders."""
    users: int
    """Number of road users of the world."""


def precedence(context: RouteContext | None, following: PathFollowing, users: int) -> Precedence:
    """Precedence among the road users of `context`, the first road users of a world with `users` road users."""
    if context is None:
        return Precedence(np.zeros(0), following.follows, np.zeros(0, np.int64), users)
    return Precedence(context.route.junction_entry_time, following.follows, context.in_way, users)


@compiled
def goes_first(ego: int, other: int, order: Precedence) -> bool:
    """Whether road user `other` waits for `ego`.

    A road user that is in the way of the other one must clear it first, whatever the order; else the road user that
    entered its junction first goes first. Outside junctions, and for road users without a path, there is no order, and
    neither road user is expected to wait.
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
