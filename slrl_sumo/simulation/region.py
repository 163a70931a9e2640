"""The part of a network in which road users are taken over."""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.nearest import PointIndex
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import LanePoints

JUNCTION_RADIUS = 60.0
"""Default radius, m."""
FORMS = "junction:ID,radius=80 or edges:ID,ID or box:x0,y0,x1,y1"
_SPACING = 1.0


@dataclass(frozen=True)
class JunctionRegion:
    """A disc around a junction, or around each junction of a traffic light: id, and radius in m."""

    junction: str
    radius: float = JUNCTION_RADIUS

    def __str__(self) -> str:
        return f"junction:{self.junction},radius={self.radius:g}"


@dataclass(frozen=True)
class EdgesRegion:
    """The surface of the lanes of the given edges."""

    edges: tuple[str, ...]

    def __str__(self) -> str:
        return f"edges:{','.join(self.edges)}"


@dataclass(frozen=True)
class BoxRegion:
    """A box with sides along x and y, between two corners in m."""

    x0: float
    y0: float
    x1: float
    y1: float

    def __str__(self) -> str:
        return f"box:{self.x0:g},{self.y0:g},{self.x1:g},{self.y1:g}"


RegionSpec = JunctionRegion | EdgesRegion | BoxRegion


@dataclass(frozen=True)
class Region:
    """A part of the plane: discs, a box, the surface of some edges, or (all None) everywhere. m, world frame."""

    text: str
    """The region as given by the user."""
    discs: tuple[tuple[float, float, float], ...] | None = None
    """x and y of the centre, and the radius, of each disc."""
    box: tuple[float, float, float, float] | None = None
    """x0, y0, x1, y1 with x0 < x1 and y0 < y1."""
    edges: tuple[tuple[PointIndex, float], ...] | None = None
    """For each lane width: points along the lanes of this width, and half the width in m."""

    def inside(self, x: Floats, y: Floats, margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether positions (m, (n,)) are inside the region or at most `margin` m outside it, (n,).

        Takeover uses margin 0 and hand-back a larger margin, so that road users at the border do not alternate.
        """
        if self.discs is not None:
            near = [
                np.hypot(x - centre_x, y - centre_y) <= radius + margin for centre_x, centre_y, radius in self.discs
            ]
            return np.asarray(np.any(near, axis=0))
        if self.box is not None:
            x0, y0, x1, y1 = self.box
            return (x >= x0 - margin) & (x <= x1 + margin) & (y >= y0 - margin) & (y <= y1 + margin)
        if self.edges is not None:
            on = np.zeros(len(x), np.bool_)
            for points, half_width in self.edges:
                distance = points.nearest(x, y)[1][:, 0]
                # The nearest point is up to half a spacing along the lane from the nearest place on it.
                on |= distance <= np.hypot(half_width + margin, 0.5 * _SPACING)
            return on
        return np.ones(len(x), np.bool_)


def parse_region(given: str | RegionSpec | None, network: Network) -> Region:
    """The region of a loaded network that `given` describes: a spec, or text in one of `FORMS`; None: everywhere.

    Raises InputError if the text is malformed, or if the network lacks the junction or edge; the message then lists the
    most similar ids.
    """
    if given is None:
        return Region("everywhere")
    spec = _parsed(given) if isinstance(given, str) else given
    if isinstance(spec, BoxRegion):
        x0, x1 = sorted((spec.x0, spec.x1))
        y0, y1 = sorted((spec.y0, spec.y1))
        if x0 == x1 or y0 == y1:
            raise _wrong(given, "the box is empty; its corners must differ in x and in y")
        return Region(str(given), box=(x0, y0, x1, y1))
    if isinstance(spec, EdgesRegion):
        return _surface(given, spec.edges, network)
    if not isinstance(spec, JunctionRegion):
        raise _wrong(given, f"not understood; write {FORMS}")
    if spec.radius <= 0.0:
        raise _wrong(given, "the radius must be above 0; write for example radius=80")
    if spec.junction in network.junction_positions:
        junctions: tuple[str, ...] = (spec.junction,)
    elif not (junctions := network.signal_junctions.get(spec.junction, ())):
        near = _nearest(spec.junction, {*network.junction_positions, *network.signal_junctions})
        raise _wrong(given, f"the network has no junction '{spec.junction}'; {near}")
    return Region(str(given), discs=tuple((*network.junction_positions[name], spec.radius) for name in junctions))


def _parsed(text: str) -> RegionSpec:
    kind, _, value = text.partition(":")
    if kind == "junction" and value:
        name, comma, radius = value.partition(",radius=")
        return JunctionRegion(name, _number(radius, text) if comma else JUNCTION_RADIUS)
    if kind == "edges" and value:
        return EdgesRegion(tuple(name.strip() for name in value.split(",")))
    if kind == "box":
        corners = [_number(part, text) for part in value.split(",")]
        if len(corners) != 4:
            raise _wrong(text, "a box has four numbers, in m: box:x0,y0,x1,y1")
        return BoxRegion(*corners)
    raise _wrong(text, f"not understood; write {FORMS}")


def _surface(given: str | RegionSpec, names: tuple[str, ...], network: Network) -> Region:
    known = {lane.edge for lane in network.lanes}
    for name in names:
        if name not in known:
            roads = sorted(edge for edge in known if not edge.startswith(":"))
            raise _wrong(given, f"the network has no edge '{name}'; {_nearest(name, roads)}")
    surfaces = []
    for width in sorted({lane.width for lane in network.lanes if lane.edge in names}):
        lanes = [lane for lane in network.lanes if lane.edge in names and lane.width == width]
        points = LanePoints(lanes, spacing=_SPACING)
        surfaces.append((PointIndex(points.x, points.y), 0.5 * width))
    return Region(str(given), edges=tuple(surfaces))


def _number(text: str, whole: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise _wrong(whole, f"'{text}' is no number; write {FORMS}")
    return value


def _wrong(given: str | RegionSpec, reason: str) -> InputError:
    return InputError(reason, argument="region", value=given)


def _nearest(name: str, known: Iterable[str]) -> str:
    """A hint on existing ids: the most similar ids, else the first ids."""
    choices = sorted(known)
    near = difflib.get_close_matches(name, choices, n=3, cutoff=0.4)
    return f"is it {' or '.join(near)}?" if near else f"there are {', '.join(choices[:5])}{' …' * (len(choices) > 5)}"
