"""Lines along streets on which the lanes of both directions are less than a car's width apart.

netconvert shares the width of a street in OpenStreetMap among its lanes: on 28 % of the edges of Kraków the lanes of
both directions are 1.3 to 2.3 m apart, and the inner lanes of a main street in The Hague 1.8 m. SUMO's vehicles pass
through each other there.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.nearest import PointIndex
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.network.links import LinksOf, internal_lanes

APART = 2.6
"""Distance (m) between the lines of both directions at which cars pass each other: a car's width and 0.8 m. With
0.4 m, 25 of 400 road users collided in Kraków, with 0.8 m 8."""
TAPER = 5.0
"""Length (m) over which a line moves aside."""
SHORTEST = 1.0
"""Length (m) below which a line stays: it cannot move aside and back."""
SPACING = 2.0
"""Greatest distance (m) between the points at which lanes are compared."""
STRIP = 100.0
"""Height (m) of the strips of a network that are searched one after the other: 10 km x 10 km with 26,000 lanes took 9 s
in one, and takes 2 s so."""
NEIGHBOURS = 8
"""Number of nearest points among which the nearest point of an opposite lane is searched."""
OPPOSITE = -0.8
"""Cosine of the angle between two directions below which they are opposite."""


def moved_apart(lanes: Iterable[Lane], links: LinksOf) -> list[Lane]:
    """The carriageway lanes whose line has to be moved away from a lane of the opposite direction, moved, and the
    internal lanes between them.

    Both lanes move, each at most to its border. Ids, widths and lengths stay. `links`: target and internal lane of each
    link of a lane.
    """
    known = {lane.id: lane for lane in lanes if lane.surface == Surface.ROAD and len(lane.shape) > 1}
    near = [lane for lane in known.values() if not lane.internal]
    if not near:
        return []
    points, begins = _sampled([lane.shape for lane in near])
    gaps, sides = _gaps(points, np.repeat(np.arange(len(near)), np.diff(begins)))
    # At an end without an internal lane the line that follows stays.
    ways = [(lane.id, target, via) for lane in near for target, via in links(lane.id) if via in known]
    joined = {end for start, target, _ in ways for end in ((start, 1), (target, 0))}
    moved, ends = [], dict[tuple[str, int], float]()
    for k in np.flatnonzero(np.maximum.reduceat(gaps, begins[:-1])).tolist():
        lane, part = near[k], slice(begins[k], begins[k + 1])
        line, aside = points[part], np.minimum(0.5 * gaps[part], 0.5 * lane.width)
        if line[-1, 2] >= SHORTEST:
            # One side for the whole lane: lines that a network draws on top of each other have no side of their own.
            away = 1.0 if (aside * sides[part]).sum() < 0.0 else -1.0
            left = away * _tapered(line[:, 2], aside, (lane.id, 0) in joined, (lane.id, 1) in joined)
            ends[lane.id, 0], ends[lane.id, 1] = left.item(0), left.item(-1)
            moved.append(replace(lane, shape=_moved(line, left)))
    for start, target, via in ways:
        first, last = ends.get((start, 1), 0.0), ends.get((target, 0), 0.0)
        if first or last:
            moved += _between([known[lane] for lane in internal_lanes(via, links) if lane in known], first, last)
    return moved


def _between(chain: Sequence[Lane], first: float, last: float) -> list[Lane]:
    """The internal lanes of a way through a junction, moved to the left by `first` to `last` (m)."""
    points, begins = _sampled([lane.shape for lane in chain])
    moved, before, total = [], 0.0, max(float(points[begins[1:] - 1, 2].sum()), 1e-9)
    for lane, begin, end in zip(chain, begins[:-1], begins[1:], strict=True):
        line = points[begin:end]
        left = first + (last - first) * (before + line[:, 2]) / total
        before += line[-1, 2]
        moved.append(replace(lane, shape=_moved(line, left)))
    return moved


def _sampled(shapes: Sequence[Floats]) -> tuple[Floats, NDArray[np.int64]]:
    """Points of lines (k, 2), their own and such that none is farther than SPACING from the next, (points, 5): x, y, m
    along the line, and the direction, a unit vector, at a corner the mean of both.

    Also returns the first row of each line, and the number of rows.
    """
    corners, counts = np.concatenate(shapes), np.array([len(shape) for shape in shapes])
    last = np.cumsum(counts) - 1
    steps = np.diff(corners, axis=0, append=corners[-1:])
    steps[last] = 0.0
    size = np.hypot(*steps.T)
    unit = steps / np.maximum(size, 1e-9)[:, None]
    before = np.concatenate([unit[-1:], unit[:-1]])  # that before the first corner of a line is 0
    at_corner = unit + before
    at_corner /= np.maximum(np.hypot(*at_corner.T), 1e-9)[:, None]
    along = np.cumsum(size) - size
    along -= np.repeat(along[last - counts + 1], counts)
    pieces = np.maximum(np.ceil(size / SPACING), 1).astype(np.int64)
    corner = np.repeat(np.arange(len(corners)), pieces)
    piece = np.arange(len(corner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = piece / pieces[corner]
    direction = np.where(piece[:, None] > 0, unit[corner], at_corner[corner])
    points = np.column_stack(
        [corners[corner] + share[:, None] * steps[corner], along[corner] + share * size[corner], direction]
    )
    return points, np.concatenate([[0], np.cumsum(pieces)[last]])


def _gaps(points: Floats, lane: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """How much (m) each of p points lacks to APART from the nearest opposite lane, 0 where it lacks nothing, and how
    far (m) to the left that lane is there, (p,) each. `points`: see `_sampled`; `lane`: the lane of each."""
    gaps, sides = np.zeros(len(points)), np.zeros(len(points))
    reach = float(np.hypot(APART, SPACING))
    order = np.argsort(points[:, 1], kind="stable")
    y = points[order, 1]
    # Strip after strip, since a search goes through all points of about the same x.
    for south in np.arange(y[0], y[-1] + STRIP, STRIP).tolist():
        rows = order[slice(*np.searchsorted(y, (south, south + STRIP)))]
        near = order[slice(*np.searchsorted(y, (south - reach, south + STRIP + reach)))]
        if not len(rows):
            continue
        there, count = points[near], min(NEIGHBOURS, len(near))
        index = PointIndex(there[:, 0], there[:, 1])
        found, distance = index.nearest(points[rows, 0], points[rows, 1], count, within=reach)
        dx, dy = (there[found, :2] - points[rows, None, :2]).transpose(2, 0, 1)
        c, s = points[rows, None, 3:].transpose(2, 0, 1)
        opposite = (distance < np.inf) & (lane[near][found] != lane[rows, None])
        opposite &= there[found, 3] * c + there[found, 4] * s < OPPOSITE
        left = np.take_along_axis(c * dy - s * dx, np.argmax(opposite, axis=1)[:, None], axis=1)[:, 0]
        beside = opposite.any(axis=1)
        gaps[rows] = np.where(beside, np.maximum(APART - np.abs(left), 0.0), 0.0)
        sides[rows] = np.where(beside, left, 0.0)
    return gaps, sides


def _tapered(along: Floats, aside: Floats, begins_aside: bool, ends_aside: bool) -> Floats:
    """At least `aside` (m), as far as the line can move aside by half of APART within TAPER, and 0 at the begin and at
    the end unless the line `begins_aside` or `ends_aside`."""
    slope = 0.5 * APART / TAPER
    ahead = np.maximum.accumulate(aside + slope * along) - slope * along
    behind = np.maximum.accumulate((aside - slope * along)[::-1])[::-1] + slope * along
    aside = np.maximum(ahead, behind)
    taper = min(TAPER, 0.5 * along[-1])
    for stays, distance in ((not begins_aside, along), (not ends_aside, along[-1] - along)):
        if stays:
            aside = aside * np.clip(distance / taper, 0.0, 1.0)
    return np.asarray(aside)


def _moved(points: Floats, left: Floats) -> Floats:
    """The points (k, 2) of a line moved to the left by `left` m each; `points`: see `_sampled`."""
    here, (dx, dy) = points[:, :2], points[:, 3:].T
    moved: Floats = here + left[:, None] * np.column_stack([-dy, dx])
    # On the inner side of sharp corners, short segments would lead backwards.
    steps = np.diff(here, axis=0)
    onwards = (np.diff(moved, axis=0) * steps).sum(axis=1) > 0.5 * (steps * steps).sum(axis=1)
    onwards[-1] = True
    return moved[np.concatenate([[True], onwards]).astype(np.bool_)]
