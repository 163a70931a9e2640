"""The part of a network in which road users are taken over."""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.errors import InputError
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.lanes import LanePoints
from slrl_sumo.sumo.network import Network

JUNCTION_RADIUS = 60.0
"""m, where the user gives none."""
FORMS = "junction:ID,radius=80 or edges:ID,ID or box:x0,y0,x1,y1"
_SPACING = 1.0


@dataclass(frozen=True)
class Region:
    """A part of the plane: a disc, a box, the surface of some edges, or (all None) everywhere. m, world frame."""

    text: str
    """As the user wrote it."""
    disc: tuple[float, float, float] | None = None
    """x, y of the centre and radius."""
    box: tuple[float, float, float, float] | None = None
    """x0, y0, x1, y1 with x0 < x1 and y0 < y1."""
    edges: tuple[tuple[cKDTree, float], ...] | None = None
    """For each lane width: points along the lanes of that width, and half of it in m."""

    def inside(self, x: Floats, y: Floats, margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether positions (m, (n,)) are inside the region or at most `margin` m outside of it, (n,).

        Enter with margin 0 and leave with more, so that nobody is taken and given back in turn at the rim.
        """
        if self.disc is not None:
            centre_x, centre_y, radius = self.disc
            return np.asarray(np.hypot(x - centre_x, y - centre_y) <= radius + margin)
        if self.box is not None:
            x0, y0, x1, y1 = self.box
            return (x >= x0 - margin) & (x <= x1 + margin) & (y >= y0 - margin) & (y <= y1 + margin)
        if self.edges is not None:
            places = np.column_stack([x, y])
            on = np.zeros(len(x), np.bool_)
            for points, half_width in self.edges:
                distance, _ = points.query(places)
                # The nearest point is up to half a spacing along the lane from the nearest place on it.
                on |= np.asarray(distance) <= np.hypot(half_width + margin, 0.5 * _SPACING)
            return on
        return np.ones(len(x), np.bool_)


def parse_region(text: str | None, network: Network) -> Region:
    """The region that `text` describes (see `FORMS`; None: everywhere) in a loaded network.

    Raises InputError where the text is malformed, or names a junction or edge
    that the network does not have, with those that are named most like it.
    """
    if text is None:
        return Region("everywhere")
    kind, _, value = text.partition(":")
    if kind == "junction" and value:
        return _disc(text, value, network)
    if kind == "edges" and value:
        return _surface(text, value, network)
    if kind == "box":
        return _box(text, value)
    raise InputError(f"--region {text}: not understood; write {FORMS}")


def _disc(text: str, value: str, network: Network) -> Region:
    name, comma, radius_text = value.partition(",radius=")
    radius = _number(radius_text, text) if comma else JUNCTION_RADIUS
    if radius <= 0.0:
        raise InputError(f"--region {text}: the radius must be above 0; write for example radius=80")
    if name not in network.junction_positions:
        near = _nearest(name, network.junction_positions)
        raise InputError(f"--region {text}: the network has no junction '{name}'; {near}")
    x, y = network.junction_positions[name]
    return Region(text, disc=(x, y, radius))


def _box(text: str, value: str) -> Region:
    corners = [_number(part, text) for part in value.split(",")]
    if len(corners) != 4:
        raise InputError(f"--region {text}: a box has four numbers, in m: box:x0,y0,x1,y1")
    x0, y0, x1, y1 = corners
    if x0 == x1 or y0 == y1:
        raise InputError(f"--region {text}: the box is empty; its corners must differ in x and in y")
    return Region(text, box=(min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)))


def _surface(text: str, value: str, network: Network) -> Region:
    names = [name.strip() for name in value.split(",")]
    known = {lane.edge for lane in network.lanes}
    for name in names:
        if name not in known:
            roads = sorted(edge for edge in known if not edge.startswith(":"))
            raise InputError(f"--region {text}: the network has no edge '{name}'; {_nearest(name, roads)}")
    surfaces = []
    for width in sorted({lane.width for lane in network.lanes if lane.edge in names}):
        lanes = [lane for lane in network.lanes if lane.edge in names and lane.width == width]
        points = LanePoints(lanes, spacing=_SPACING)
        surfaces.append((cKDTree(np.column_stack([points.x, points.y])), 0.5 * width))
    return Region(text, edges=tuple(surfaces))


def _number(text: str, whole: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"--region {whole}: '{text}' is no number; write {FORMS}")
    return value


def _nearest(name: str, known: Iterable[str]) -> str:
    """Words that help to find the right id."""
    choices = sorted(known)
    near = difflib.get_close_matches(name, choices, n=3, cutoff=0.4)
    return f"is it {' or '.join(near)}?" if near else f"there are {', '.join(choices[:5])}{' …' * (len(choices) > 5)}"
