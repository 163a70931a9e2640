"""The ground of a Lanelet2 map (https://github.com/fzi-forschungszentrum-informatik/Lanelet2): OSM's XML with lanelets.

Such maps come with recordings: INTERACTION, TAF-BW, newer editions of levelXdata.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.ground.projection import MAX_LATITUDE, parse_origin, project
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Area, Surface, SurfaceShapes
from slrl_sumo.input_files import open_xml
from slrl_sumo.scene.geometry import Floats

SUFFIXES = (".osm", ".osm_xy")
"""Of files with such maps; in INTERACTION's .osm_xy nodes have positions in m."""

WALKWAYS = dict.fromkeys(("walkway", "shared_walkway", "stairs", "traffic_island", "pedestrian_lane"), Surface.SIDEWALK)
SURFACES = {**WALKWAYS, "crosswalk": Surface.CROSSING, "bicycle_lane": Surface.CYCLEWAY, "rail": Surface.NONE}
"""By subtype; others are road. `pedestrian_lane` is Autoware's."""
UNUSED_AREAS = ("vegetation", "building", "keepout")
"""Subtypes of areas that are no ground for road users."""
PAINT_ORDER = (Surface.SIDEWALK, Surface.CYCLEWAY, Surface.ROAD, Surface.CROSSING)
"""As in a SUMO network."""

INTERACTION = "utm:0,0"
"""Origin of INTERACTION's maps, which lie within a few hundred metres of 0, 0 degrees."""
LOCAL_DEGREES = 0.5
"""Greatest distance (degrees) of the middle of such a map from 0, 0."""


@dataclass(frozen=True)
class _Relation:
    """A lanelet or an area."""

    tags: dict[str, str]
    ways: dict[str, list[str]]
    """Ids of the ways in each role."""


@dataclass(frozen=True)
class _Map:
    rows: dict[str, int] = field(default_factory=dict)
    """Row of each node, by id."""
    degrees: list[tuple[float, float]] = field(default_factory=list)
    """Latitude and longitude of the nodes; NaN where there is none."""
    metres: list[tuple[float, float]] = field(default_factory=list)
    """x and y of the nodes; NaN where there is none."""
    ways: dict[str, list[str]] = field(default_factory=dict)
    """Ids of the nodes of each way."""
    relations: list[_Relation] = field(default_factory=list)


def ground_of_lanelets(file: Path, origin: str | None) -> RoadMap:
    """The surfaces of a Lanelet2 map: lanelets by their subtype, and areas such as parking space and traffic islands.

    `origin`: where (0, 0) m of the recording lies (`projection.parse_origin`). Without it, positions in m count where
    each node has them (`x` and `y` in INTERACTION's .osm_xy, tags `local_x` and `local_y` in Autoware's maps), and else
    INTERACTION's origin. Raises InputError where the file is no such map, or lies elsewhere.
    """
    found = _read(file)
    positions = _positions(file, found, origin)
    areas = [area for relation in found.relations if (area := _area(found, positions, relation)) is not None]
    if not any(area.surface == Surface.ROAD for area in areas):
        raise InputError(
            f"--net {file}: there is no lanelet of a road in it; give a Lanelet2 map, or the network that netconvert "
            "makes of a plain OpenStreetMap file"
        )
    return RoadMap(SurfaceShapes(tuple(sorted(areas, key=lambda area: PAINT_ORDER.index(area.surface)))))


def _read(file: Path) -> _Map:
    """The nodes, ways, lanelets and areas of the file. Raises InputError."""
    found = _Map()
    try:
        with open_xml(file) as stream:
            for _, element in etree.iterparse(stream, tag=("node", "way", "relation"), resolve_entities=False):
                if element.get("action") != "delete":  # JOSM marks what its user deleted
                    _add(found, element)
                element.clear()
    except etree.XMLSyntaxError as error:
        raise InputError(f"--net {file}, line {error.lineno}: it is no well-formed XML ({error.msg})") from None
    except OSError as error:
        raise InputError(f"--net {file}: cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        raise InputError(f"--net {file}, line {element.sourceline}: {error}") from None
    return found


def _add(found: _Map, element: etree._Element) -> None:
    """Add an element of the file to what was found. Raises ValueError where a position is no number."""
    get, identity = element.attrib.get, element.get("id", "")
    tags = {tag.get("k", ""): tag.get("v", "") for tag in element.iterchildren("tag")}
    if element.tag == "node":
        found.rows[identity] = len(found.degrees)
        found.degrees.append((float(get("lat", "nan")), float(get("lon", "nan"))))
        found.metres.append((float(get("x", tags.get("local_x", "nan"))), float(get("y", tags.get("local_y", "nan")))))
    elif element.tag == "way":
        found.ways[identity] = [node.get("ref", "") for node in element.iterchildren("nd")]
    elif tags.get("type") in ("lanelet", "multipolygon"):
        ways: dict[str, list[str]] = {}
        for member in element.iterchildren("member"):
            ways.setdefault(member.get("role", ""), []).append(member.get("ref", ""))
        found.relations.append(_Relation(tags, ways))


def _positions(file: Path, found: _Map, origin: str | None) -> Floats:
    """Positions of the nodes in m, (nodes, 2). Raises InputError."""
    metres = np.array(found.metres, np.float64).reshape(-1, 2)
    if origin is None and np.isfinite(metres).all():
        return metres
    latitude, longitude = np.array(found.degrees, np.float64).reshape(-1, 2).T
    if not (np.abs(latitude) <= MAX_LATITUDE).all() or not (np.abs(longitude) <= 180).all():  # also where it is NaN
        raise InputError(f"--net {file}: a node has no position, or an impossible one")
    middle = float(np.median(latitude)), float(np.median(longitude))
    if origin is None and max(map(abs, middle)) > LOCAL_DEGREES:
        raise InputError(
            f"--net {file}: it lies at {middle[0]:.4f}, {middle[1]:.4f} degrees; give the place of (0, 0) m of the "
            "recording, e.g. --origin mercator:49.0053,8.4374 (originLat and originLon of TAF-BW) or "
            "--origin utm:EASTING,NORTHING (xUtmOrigin and yUtmOrigin of levelXdata)"
        )
    return np.stack(project(latitude, longitude, parse_origin(origin or INTERACTION)), axis=1)


def _area(found: _Map, positions: Floats, relation: _Relation) -> Area | None:
    """The ground of a lanelet or an area; None where it is none, or parts of its outline are missing."""
    subtype = relation.tags.get("subtype", "")
    surface = SURFACES.get(subtype, Surface.ROAD)
    lanelet = relation.tags["type"] == "lanelet"
    if surface == Surface.NONE or (not lanelet and subtype in UNUSED_AREAS):
        return None
    roles = ("left", "right") if lanelet else ("outer", "inner")
    lines = [_lines(found, relation.ways.get(role, [])) for role in roles]
    parts = [[positions[line] for line in some] for some in lines]
    if lanelet:
        if [len(some) for some in parts] != [1, 1]:
            return None
        return Area(surface, _between(parts[0][0], parts[1][0]))
    if not parts[0]:
        return None
    rings = parts[0] + parts[1]
    # The rings are one outline with seams to its first point, which the even-odd rule leaves out: inner ones are holes.
    return Area(surface, np.concatenate([np.vstack((ring, ring[:1], rings[0][:1])) for ring in rings]))


def _lines(found: _Map, ways: list[str]) -> list[list[int]]:
    """Rows of the nodes along the lines that ways make when they are joined at common ends, in any direction."""
    open_ends = [[found.rows[node] for node in found.ways.get(way, ()) if node in found.rows] for way in ways]
    rest = [line for line in open_ends if len(line) > 1]
    lines: list[list[int]] = []
    while rest:
        line = rest.pop(0)
        while line[0] != line[-1]:
            following = next((i for i, other in enumerate(rest) if {line[0], line[-1]} & {other[0], other[-1]}), None)
            if following is None:
                break
            line = _joined(line, rest.pop(following))
        lines.append(line)
    return lines


def _joined(line: list[int], other: list[int]) -> list[int]:
    """Two lines with a common end."""
    if line[0] in (other[0], other[-1]) and line[-1] not in (other[0], other[-1]):
        line = line[::-1]
    return line + (other if other[0] == line[-1] else other[::-1])[1:]


def _between(left: Floats, right: Floats) -> Floats:
    """The outline of what lies between two bounds, whatever their directions: its two short ends do not cross."""
    same = np.hypot(*(left[0] - right[0])) + np.hypot(*(left[-1] - right[-1]))
    opposite = np.hypot(*(left[0] - right[-1])) + np.hypot(*(left[-1] - right[0]))
    return np.concatenate([left, right[::-1] if same <= opposite else right])
