"""The road network that SUMO has loaded: lanes, their permissions, and the surfaces that they form."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.ground.surfaces import Area, Ribbon, Surface, SurfaceShapes
from slrl_sumo.scene.levels import Levels
from slrl_sumo.scene.types import MAX_POSITION
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network.grade_separations import GradeSeparation, grade_separations, levels_of
from slrl_sumo.sumo.network.lane_state import allowed_classes
from slrl_sumo.sumo.network.lanes import MOTOR_CLASSES, Lane, LanePoints
from slrl_sumo.sumo.scenario.loaded_files import ADDITIONAL, CONFIGURATION, vaporized_edges

LANE_WIDTH = 3.2
"""SUMO's default width (m), which replaces invalid widths."""
WIDEST = 200.0
"""Greatest valid width, m."""
STRIPE = 0.65
"""Width (m) of SUMO's stripes for persons. At the end of a street, netconvert's walking areas are lines without width
between the ends of its sidewalks; SUMO's persons walk along them as on a sidewalk, up to 1 m beside."""

_WALKING_AREA = re.compile(r"^:.+_w\d+_\d+$")
_CROSSING = re.compile(r"^:.+_c\d+_\d+$")


@dataclass(frozen=True)
class Network:
    """All lanes and junction outlines of a loaded SUMO network."""

    lanes: tuple[Lane, ...]
    junctions: tuple[Area, ...]
    exits: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    """Lane ends where the network ends: x, y (m), heading outwards (rad), half the lane's width (m), (e, 4)."""
    edge_ends: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """The junctions at the begin and the end of each edge, by its id."""
    junction_positions: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """x, y (m) of each junction by its id."""
    signal_junctions: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """The junctions that each traffic light controls, by its id."""
    without_width: tuple[str, ...] = ()
    """Lanes with a width in SUMO outside (0, WIDEST]: they have LANE_WIDTH here."""
    infinitely_wide: frozenset[str] = frozenset()
    """Lanes of infinite width."""
    removing: frozenset[str] = frozenset()
    """Edges with a calibrator or a vaporizer, which may remove vehicles."""

    @cached_property
    def classes_on_foot(self) -> frozenset[str]:
        """SUMO vehicle classes that may use a crossing or a walking area."""
        return frozenset[str]().union(*(lane.allowed for lane in self.lanes if _is_on_foot(lane.id)))

    @cached_property
    def walks(self) -> LanePoints:
        """Points every 2 m on the lanes outside junctions that admit pedestrians; made on first use, because a city has
        millions."""
        walkable = [lane for lane in self.lanes if not lane.internal and "pedestrian" in lane.allowed]
        return LanePoints(walkable, spacing=2.0)

    @cached_property
    def grade_separations(self) -> tuple[GradeSeparation, ...]:
        """Places where streets cross without a junction."""
        return grade_separations(self.lanes)

    @cached_property
    def levels(self) -> Levels:
        """The levels of the streets at `grade_separations`."""
        return levels_of(self.lanes, self.grade_separations)

    def surfaces(self) -> SurfaceShapes:
        """The surfaces in paint order: junctions, walking areas, sidewalks, cycle lanes, carriageway, crossings.

        Later shapes lie on earlier ones, so that a cycle lane inside a junction does not cut the carriageway.
        """
        return SurfaceShapes(tuple(shape for shape, _ in self.painted()), self.levels)

    def painted(self) -> Iterator[tuple[Area | Ribbon, Lane | None]]:
        """The shapes of `surfaces`, each with its lane; None for outlines of junctions."""
        for area in sorted(self.junctions, key=lambda a: a.surface == Surface.ROAD, reverse=True):
            yield area, None
        for surface in (Surface.SIDEWALK, Surface.CYCLEWAY, Surface.ROAD, Surface.CROSSING):
            for lane in self.lanes:
                if lane.surface != surface:
                    continue
                if not is_walking_area(lane.id):
                    yield Ribbon(surface, lane.shape, lane.width), lane
                elif _mean_width(lane.shape) < STRIPE:
                    yield Ribbon(surface, np.append(lane.shape, lane.shape[:1], axis=0), lane.width), lane
                else:
                    yield Area(surface, lane.shape), lane


def is_walking_area(lane_id: str) -> bool:
    """Whether a lane is a walking area, so that its shape is an outline."""
    return _WALKING_AREA.match(lane_id) is not None


def is_crossing(lane_id: str) -> bool:
    """Whether a lane is a crossing for pedestrians."""
    return _CROSSING.match(lane_id) is not None


def _mean_width(outline: NDArray[np.float64]) -> float:
    """Mean width (m) of a polygon (k, 2): its area over half of its perimeter; 0 for a line."""
    x, y = (outline - outline[:1]).T
    step_x, step_y = np.roll(x, -1) - x, np.roll(y, -1) - y
    area = 0.5 * abs(float(np.sum(x * step_y - y * step_x)))
    around = float(np.hypot(step_x, step_y).sum())
    return 2.0 * area / max(around, 1e-9)


def _is_on_foot(lane_id: str) -> bool:
    return is_walking_area(lane_id) or is_crossing(lane_id)


def read_network(api: SumoApi) -> Network:
    """Read the loaded network, in about 4 us per lane and call with libsumo.

    Raises InputError for a lane at an invalid position, and for a crossing or walking area that admits cars.
    """
    lanes, without_width, infinitely_wide = [], [], set()
    # To save memory, lanes share their sets of classes and the names of their edges.
    known: dict[frozenset[str], frozenset[str]] = {}
    edges: dict[str, str] = {}
    for lane_id in api.lane.getIDList():
        classes = allowed_classes(api, lane_id)
        edge, width = api.lane.getEdgeID(lane_id), api.lane.getWidth(lane_id)
        if not 0.0 < width <= WIDEST:
            without_width.append(lane_id)
            if width == inf:
                infinitely_wide.add(lane_id)
            width = LANE_WIDTH
        lanes.append(
            Lane(
                id=lane_id,
                edge=edges.setdefault(edge, edge),
                shape=np.array(api.lane.getShape(lane_id), np.float64).reshape(-1, 2),
                width=width,
                length=api.lane.getLength(lane_id),
                max_speed=api.lane.getMaxSpeed(lane_id),
                allowed=known.setdefault(classes, classes),
                internal=lane_id.startswith(":"),
                surface=_lane_surface(lane_id, classes),
            )
        )
    for lane in lanes:
        if not np.abs(lane.shape).max(initial=0.0) <= MAX_POSITION:  # also where it is NaN
            raise InputError(
                f"lane {lane.id} has a point without position, or farther than {MAX_POSITION:g} m from the origin; "
                "correct the network"
            )
        # SUMO 1.28 crashes some steps after it has mapped a moved vehicle to such a lane.
        if "passenger" in lane.allowed and _is_on_foot(lane.id):
            raise InputError(
                f'lane {lane.id} of a crossing or walking area admits cars; give it allow="pedestrian", as netconvert '
                "does"
            )
    junctions = _junctions(api, lanes)
    # A walking area between carriageways that admit pedestrians is part of the common surface, the middle of a shared
    # space. Beside carriageways with sidewalks, a walking area is for pedestrians only.
    shared = _shared_junctions(api, lanes)
    lanes = [
        replace(lane, surface=Surface.ROAD)
        if _WALKING_AREA.match(lane.id) and lane.id[1:].rpartition("_w")[0] in shared
        else lane
        for lane in lanes
    ]
    positions = {
        junction: api.junction.getPosition(junction)
        for junction in api.junction.getIDList()
        if not junction.startswith(":")
    }
    ends = {edge: (api.edge.getFromJunction(edge), api.edge.getToJunction(edge)) for edge in _edges(lanes)}
    return Network(
        tuple(lanes),
        tuple(junctions),
        _exits(lanes, ends),
        ends,
        positions,
        _signal_junctions(api, ends),
        tuple(without_width),
        frozenset(infinitely_wide),
        _removing(api),
    )


def _removing(api: SumoApi) -> frozenset[str]:
    """See Network.removing."""
    calibrated = (api.calibrator.getEdgeID(calibrator) for calibrator in api.calibrator.getIDList())
    return frozenset(calibrated) | vaporized_edges(
        *(api.simulation.getOption(name) for name in (ADDITIONAL, CONFIGURATION))
    )


def _exits(lanes: list[Lane], edge_ends: Mapping[str, tuple[str, str]]) -> NDArray[np.float64]:
    """Ends of lanes at junctions with a single neighbouring junction, or that no edge leaves: see Network.exits."""
    neighbours: dict[str, set[str]] = {}
    for start, end in edge_ends.values():
        neighbours.setdefault(start, set()).add(end)
        neighbours.setdefault(end, set()).add(start)
    left = {start for start, _ in edge_ends.values()}
    ends = []
    for lane in lanes:
        if lane.internal or len(lane.shape) < 2:
            continue
        for junction, line in zip(edge_ends[lane.edge], (lane.shape[::-1], lane.shape), strict=True):
            if len(neighbours[junction]) == 1 or junction not in left:
                out = line[-1] - line[-2]
                ends.append((*line[-1], np.arctan2(out[1], out[0]), 0.5 * lane.width))
    return np.array(ends, np.float64).reshape(-1, 4)


def _signal_junctions(api: SumoApi, edge_ends: Mapping[str, tuple[str, str]]) -> dict[str, tuple[str, ...]]:
    """See Network.signal_junctions: the ends of the edges whose links a traffic light controls."""
    junctions = {}
    for signal in api.trafficlight.getIDList():
        starts = {link[0] for links in api.trafficlight.getControlledLinks(signal) for link in links}
        # Crossings begin on lanes inside the junction.
        edges = {lane.rpartition("_")[0] for lane in starts if not lane.startswith(":")}
        junctions[signal] = tuple(sorted({edge_ends[edge][1] for edge in edges}))
    return junctions


def _edges(lanes: list[Lane]) -> set[str]:
    return {lane.edge for lane in lanes if not lane.internal}


def _lane_surface(lane_id: str, classes: frozenset[str]) -> Surface:
    if _CROSSING.match(lane_id):
        return Surface.CROSSING
    if classes & MOTOR_CLASSES:
        return Surface.ROAD
    if "pedestrian" in classes:
        return Surface.SIDEWALK
    return Surface.CYCLEWAY if "bicycle" in classes else Surface.NONE


def _shared_junctions(api: SumoApi, lanes: list[Lane]) -> frozenset[str]:
    """Junctions of carriageways that admit pedestrians, without sidewalks."""
    sidewalks = {lane.edge for lane in lanes if not lane.internal and lane.surface == Surface.SIDEWALK}
    mixed = {lane.edge for lane in lanes if lane.surface == Surface.ROAD and "pedestrian" in lane.allowed}
    shared = set()
    for junction in api.junction.getIDList():
        if not junction.startswith(":"):
            edges = {*api.junction.getIncomingEdges(junction), *api.junction.getOutgoingEdges(junction)}
            if edges & mixed and not edges & sidewalks:
                shared.add(junction)
    return frozenset(shared)


def _junctions(api: SumoApi, lanes: list[Lane]) -> list[Area]:
    """Junction outlines, with the strongest surface among the lanes that meet there.

    Without junctions that no edge leaves: the network ends before them. Where two carriageways end at one, netconvert
    draws it over 25 m.
    """
    rank = {Surface.ROAD: 3, Surface.CYCLEWAY: 2, Surface.SIDEWALK: 1}
    by_edge: dict[str, Surface] = {}
    for lane in lanes:
        if rank.get(lane.surface, 0) > rank.get(by_edge.get(lane.edge, Surface.NONE), 0):
            by_edge[lane.edge] = lane.surface
    areas = []
    for junction in api.junction.getIDList():
        # Internal junctions have no outline, and traci cannot read an empty outline.
        if junction.startswith(":"):
            continue
        outline = np.array(api.junction.getShape(junction), np.float64).reshape(-1, 2)
        incoming, outgoing = api.junction.getIncomingEdges(junction), api.junction.getOutgoingEdges(junction)
        edges = (*incoming, *outgoing)
        surface = max((by_edge.get(e, Surface.NONE) for e in edges), key=lambda s: rank.get(s, 0), default=Surface.NONE)
        if outgoing and len(outline) >= 3 and surface != Surface.NONE:
            areas.append(Area(surface, outline))
    return areas
