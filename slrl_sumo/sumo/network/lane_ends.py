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
        (x0, y0), (x1, y1) = lane.points[-2:]
        size = math.hypot(x1 - x0, y1 - y0)
        past = min(_past(lane, lanes[target]) if _is_simple(via, links) else 0.0 for target, via in following)
        if PAST < past < size:
            end = x1 - past * (x1 - x0) / size, y1 - past * (y1 - y0) / size
            cut.append(replace(lane, shape=np.array([*lane.points[:-1], end])))
            cut += [replace(lanes[via], shape=np.array([end, lanes[target].points[0]])) for target, via in following]
    return cut


def _is_simple(via: str, links: LinksOf) -> bool:
    """Whether an internal lane leads to its target without a waiting position."""
    return via != "" and not any(inner for _, inner in links(via))


def _past(lane: Lane, following: Lane) -> float:
    """Distance (m) along a lane from the begin of the `following` one to the lane's end; 0 for a U-turn."""
    (x0, y0), (x1, y1) = lane.points[-2:]
    begin, then = following.points[:2]
    size, ahead = math.hypot(x1 - x0, y1 - y0), math.dist(begin, then)
    if not size or not ahead:
        return 0.0
    dx, dy = (x1 - x0) / size, (y1 - y0) / size
    if dx * (then[0] - begin[0]) + dy * (then[1] - begin[1]) < U_TURN * ahead:
        return 0.0
    return (x1 - begin[0]) * dx + (y1 - begin[1]) * dy
