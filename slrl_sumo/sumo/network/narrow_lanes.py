"""Lines along streets so narrow that the lanes of both directions are less than a car's width apart.

netconvert shares the width of a street in OpenStreetMap among its lanes: on 28 % of the edges of Kraków the lanes of
both directions are 1.3 to 2.3 m apart, and SUMO's vehicles pass through each other.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.network.lanes import Lane

APART = 2.6
"""Distance (m) between the lines of both directions at which cars pass each other: a car's width and 0.8 m. With
0.4 m, 25 of 400 road users collided in Kraków, with 0.8 m 8."""
TAPER = 5.0
"""Length (m) at both ends of a lane over which its line moves aside, since the lanes of junctions stay."""


def moved_apart(lanes: Iterable[Lane], edge_ends: Mapping[str, tuple[str, str]]) -> list[Lane]:
    """The lanes whose line has to be moved away from that of the opposite lane, moved, at most to their outer border.

    Only lanes that are the only carriageway of their edge. `edge_ends`: the junctions at the begin and the end of each
    edge. Ids, widths and lengths stay.
    """
    narrow: dict[str, Lane | None] = {}
    for lane in lanes:
        if not lane.internal and lane.surface == Surface.ROAD:
            narrow[lane.edge] = lane if lane.edge not in narrow and lane.width < APART else None
    between: dict[tuple[str, str], list[Lane]] = {}
    for edge, only in narrow.items():
        if only is not None and len(only.shape) > 1:
            between.setdefault(edge_ends[edge], []).append(only)
    moved = []
    for (start, end), along in between.items():
        for lane in along:
            opposite = _beside(lane, between.get((end, start), []))
            gap = 0.0 if opposite is None else APART - 0.5 * (lane.width + opposite.width)
            if opposite is not None and gap > 0.0:
                aside = min(0.5 * gap, 0.5 * lane.width)
                moved.append(replace(lane, shape=_moved(lane.shape, aside * _side_without(lane, opposite))))
    return moved


def _beside(lane: Lane, candidates: Sequence[Lane]) -> Lane | None:
    """The candidate that ends beside the begin of a lane, within twice APART: two streets may join two junctions."""

    def away(other: Lane) -> float:
        return float(np.hypot(*(other.shape[-1] - lane.shape[0])))

    nearest = min(candidates, key=away, default=None)
    return None if nearest is None or away(nearest) > 2.0 * APART else nearest


def _side_without(lane: Lane, opposite: Lane) -> float:
    """1 if the opposite lane is to the right of a lane, else -1."""
    begin, end = lane.shape[:2]
    (dx, dy), (ox, oy) = end - begin, opposite.shape[-1] - begin
    return 1.0 if dx * oy - dy * ox < 0.0 else -1.0


def _moved(shape: Floats, left: float) -> Floats:
    """A line moved to the left by `left` m, except for its ends."""
    steps = np.diff(shape, axis=0)
    along: Floats = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    taper = min(TAPER, 0.5 * along[-1])
    if taper < 0.5:
        return shape
    places = np.unique(np.concatenate([along, [taper, along[-1] - taper]]))
    x, y = (np.interp(places, along, one) for one in shape.T)
    steps = np.diff(np.column_stack([x, y]), axis=0)
    unit = steps / np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
    # The direction at a point is the mean of those of the segments before and after it.
    dx, dy = (np.concatenate([unit[:1], unit]) + np.concatenate([unit, unit[-1:]])).T
    size = np.maximum(np.hypot(dx, dy), 1e-9)
    aside = left * np.clip(np.minimum(places, along[-1] - places) / taper, 0.0, 1.0)
    moved: Floats = np.column_stack([x - aside * dy / size, y + aside * dx / size])
    # On the inner side of sharp corners, short segments would lead backwards.
    onwards = (np.diff(moved, axis=0) * unit).sum(axis=1) > 0.5 * np.hypot(*steps.T)
    onwards[-1] = True
    return moved[np.concatenate([[True], onwards]).astype(np.bool_)]
