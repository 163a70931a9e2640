"""Ends of lanes that a network draws past the begin of the lane after them.

The internal lane between the two leads back there, and no vehicle can turn so sharply: at a corner of a street in
Bologna, whose lane ends 1.4 m past the next one, cars swung out into the oncoming lane, and passed one at a time.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.network.links import LinksOf

PAST = 0.3
"""Distance (m) past the begin of the next lane up to which a lane stays as it is."""
U_TURN = -0.6
"""Cosine of the angle between two lanes below which the way from one to the other is a U-turn, which leads back."""


def cut_back(lanes: Mapping[str, Lane], links: LinksOf) -> list[Lane]:
    """The carriageway lanes that end more than PAST m past all lanes that follow, cut there, and their internal lanes.

    `links`: target and internal lane of each link of a lane. An internal lane becomes a straight line to its target.
    Ids, widths and lengths stay.
    """
    cut = []
    for lane in lanes.values():
        if lane.internal or lane.surface != Surface.ROAD or len(lane.points) < 2:
            continue
        following = links(lane.id)
        if not following:
            continue
        before, (x, y) = lane.points[-2:]
        size = math.dist(before, (x, y))
        if not size:
            continue
        dx, dy = (x - before[0]) / size, (y - before[1]) / size
        past = min(_past(x, y, dx, dy, lanes[to]) if _is_simple(via, links) else 0.0 for to, via in following)
        if PAST < past < size:
            end = x - past * dx, y - past * dy
            cut.append(replace(lane, shape=np.array([*lane.points[:-1], end])))
            cut += [replace(lanes[via], shape=np.array([end, lanes[target].points[0]])) for target, via in following]
    return cut


def _is_simple(via: str, links: LinksOf) -> bool:
    """Whether an internal lane leads to its target without a waiting position."""
    return via != "" and not any(inner for _, inner in links(via))


def _past(x: float, y: float, dx: float, dy: float, following: Lane) -> float:
    """Distance (m) from the begin of the `following` lane to a lane's end (x, y), along the lane's direction (dx, dy)
    at its end, of length 1; 0 for a U-turn."""
    begin, then = following.points[:2]
    if dx * (then[0] - begin[0]) + dy * (then[1] - begin[1]) <= U_TURN * math.dist(begin, then):
        return 0.0
    return (x - begin[0]) * dx + (y - begin[1]) * dy
