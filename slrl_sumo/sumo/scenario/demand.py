"""The demand in a scenario's route and additional files, read in one pass with bounded memory."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.formats.sumo_time import parse_time
from slrl_sumo.input_files import open_xml
from slrl_sumo.scene.types import SPAWNED_PREFIX
from slrl_sumo.sumo.scenario.configuration import Scenario
from slrl_sumo.sumo.scenario.input_check import unusable_inputs
from slrl_sumo.sumo.scenario.options import input_files
from slrl_sumo.sumo.vehicle_classes import DESIRED_SPEEDS, Shape, usual_shape, without_models

VEHICLES = frozenset({"vehicle", "trip", "flow"})
PERSONS = frozenset({"person", "personFlow"})
DETECTORS = frozenset(
    {
        *("inductionLoop", "e1Detector", "instantInductionLoop", "laneAreaDetector", "e2Detector"),
        *("entryExitDetector", "e3Detector", "edgeData", "laneData", "routeProbe", "vTypeProbe", "timedEvent"),
    }
)
"""Elements of additional files that write output files."""


DEFAULT_TYPE = "DEFAULT_VEHTYPE"
"""Type of vehicles without a given type."""

WANTED_SPEEDS = {**DESIRED_SPEEDS, "pedestrian": 5.0 / 3.6}
"""Mean desired speeds (m/s) of pedestrians and bicycles (desiredMaxSpeed), defaults of SUMO 1.28."""


@dataclass
class Demand:
    """Counts over all route and additional files. Times in s."""

    road_users: int = 0
    """Number of vehicles, trips, flows, persons and person flows; a flow counts once."""
    first: float | None = None
    """Earliest departure."""
    stopping: int = 0
    """Number of vehicles and flows with stops."""
    first_stopping: str = ""
    """Id of the first vehicle or flow with stops."""
    riding: int = 0
    """Number of persons and person flows with a ride."""
    walks_of_own_speed: int = 0
    """Number of persons and person flows with a walk that has a `speed` or `duration`."""
    wanted_speeds: dict[str, tuple[str, float]] = field(default_factory=dict)
    """For each type of pedestrians and bicycles, its class and mean desired speed (m/s)."""
    rerouting_types: set[str] = field(default_factory=set)
    rerouters: int = 0
    writers: int = 0
    """Number of detectors and similar elements that write files."""
    types: set[str] = field(default_factory=set)
    """Ids of vTypes and vTypeDistributions."""
    shapes: dict[str, list[Shape]] = field(default_factory=dict)
    """Class and size of each type; for a distribution those of its types."""
    vehicles_of_type: Counter[str] = field(default_factory=Counter)
    """Number of vehicles, trips and flows of each type or distribution."""
    types_used: dict[str, tuple[str, float]] = field(default_factory=dict)
    """First road user of each type, and its departure."""
    edges_used: dict[str, tuple[str, float]] = field(default_factory=dict)
    """First road user or route on each edge, and its departure."""
    own_ids: list[str] = field(default_factory=list)
    """Ids with the prefix of spawned road users."""
    own_routes: list[str] = field(default_factory=list)
    unsorted: dict[Path, tuple[int, str]] = field(default_factory=dict)
    """For each route file, the number of road users that depart before the preceding one, and the first of them. SUMO
    drops these road users."""
    unreadable: dict[Path, str] = field(default_factory=dict)
    """For each invalid XML file, the reason."""

    def without_models(self) -> dict[str, int]:
        """Numbers of vehicles, trips and flows that models of cars and bicycles do not suit, by reason.

        A distribution counts if any of its types is unsuitable. The most frequent reason comes first.
        """
        found: Counter[str] = Counter()
        for name, count in self.vehicles_of_type.items():
            found.update(
                dict.fromkeys({why for shape in self.shapes.get(name, ()) if (why := without_models(shape))}, count)
            )
        return dict(found.most_common())


def read_demand(scenario: Scenario) -> Demand:
    """Read all route and additional files, plain or gzipped, and the files that they include, if they exist."""
    demand = Demand()
    demand.unreadable.update(unusable_inputs(scenario))
    stopping_routes: set[str] = set()
    # Use SUMO's order: additional files define types and routes that route files use.
    for name in ("additional-files", "route-files"):
        for path in input_files(scenario, name):
            if path not in demand.unreadable:
                _read_file(path, demand, stopping_routes, name == "route-files")
    return demand


def _read_file(path: Path, demand: Demand, stopping_routes: set[str], in_order: bool) -> None:
    last = -1.0
    try:
        for element in elements(path):
            if element.tag == "include" and element.get("href"):
                _read_file(path.parent / element.get("href", ""), demand, stopping_routes, in_order)
            for item in element.iter():
                depart = _read_item(item, demand, stopping_routes, max(last, 0.0))
                if depart is None or not in_order:
                    continue
                if depart < last:
                    count, first = demand.unsorted.get(path, (0, item.get("id", "")))
                    demand.unsorted[path] = (count + 1, first)
                last = max(last, depart)
    except FileNotFoundError:
        return
    except (etree.XMLSyntaxError, OSError) as error:
        demand.unreadable[path] = reason(error)


def elements(path: Path) -> Iterator[etree._Element]:
    """The elements below the root of an XML file, plain or gzipped; each element is freed before the next one."""
    with open_xml(path) as stream:
        depth = 0
        for event, element in etree.iterparse(stream, events=("start", "end"), remove_comments=True, huge_tree=True):
            depth += 1 if event == "start" else -1
            if event == "end" and depth == 1:
                yield element
                element.clear()
                parent = element.getparent()
                while parent is not None and element.getprevious() is not None:
                    del parent[0]


def reason(error: etree.XMLSyntaxError | OSError) -> str:
    """The reason why a file could not be read."""
    return str((error.strerror if isinstance(error, OSError) else error.msg) or error)


def net_attributes(path: Path) -> dict[str, str]:
    """The attributes of the root of a network file."""
    with open_xml(path) as stream:
        for _, root in etree.iterparse(stream, events=("start",)):
            if root.tag != "net":
                raise InputError(f"{path}: this is a <{root.tag}> file, not a SUMO network; give a .net.xml")
            return {str(key): str(value) for key, value in root.attrib.items()}
    return {}


def _read_item(item: etree._Element, demand: Demand, stopping_routes: set[str], last: float) -> float | None:
    """Count an element; return its departure if it is a road user with a departure."""
    tag, name = str(item.tag), item.get("id", "")
    if tag in ("vType", "vTypeDistribution"):
        demand.types.add(name)
        demand.shapes.setdefault(name, []).extend(_shapes(item, demand))
        demand.wanted_speeds.update(_wanted_speeds(item))
        on = {key for p in item.iterfind("param") if (key := p.get("key")) and p.get("value", "").lower() == "true"}
        if "has.rerouting.device" in on:
            demand.rerouting_types.add(name)
    elif tag == "rerouter":
        demand.rerouters += 1
    elif tag in DETECTORS and (item.get("file") or item.get("dest")):
        demand.writers += 1
    elif tag == "route":
        parent = item.getparent()
        if parent is None or parent.tag not in VEHICLES:
            if item.find("stop") is not None:
                stopping_routes.add(name)
            if name.startswith(SPAWNED_PREFIX):
                demand.own_routes.append(name)
            _use_edges(item, demand, f"route {name}", last)
    elif tag == "calibrator":
        # A calibrator inserts traffic with flows without ids.
        demand.road_users, demand.first = demand.road_users + 1, 0.0
    elif tag in VEHICLES | PERSONS and name:
        # A flow without a begin starts with the simulation.
        depart = parse_time(item.get("begin", "0") if tag in ("flow", "personFlow") else item.get("depart"))
        demand.road_users += 1
        if depart is not None:
            demand.first = depart if demand.first is None else min(demand.first, depart)
        when = last if depart is None else depart
        label = f"{tag} {name}"
        for part in item.iter():
            _use_edges(part, demand, label, when)
        if type_id := item.get("type"):
            demand.types_used.setdefault(type_id, (label, when))
        if name.startswith(SPAWNED_PREFIX):
            demand.own_ids.append(name)
        if tag in PERSONS:
            demand.riding += item.find(".//ride") is not None or "public" in _modes(item)
            demand.walks_of_own_speed += any("speed" in w.attrib or "duration" in w.attrib for w in item.iter("walk"))
        else:
            demand.vehicles_of_type[item.get("type", DEFAULT_TYPE)] += 1
            if item.find(".//stop") is not None or item.get("route") in stopping_routes:
                demand.stopping += 1
                demand.first_stopping = demand.first_stopping or name
        return depart
    return None


def _shapes(item: etree._Element, demand: Demand) -> list[Shape]:
    """The shape of a vType; for a distribution the shapes of the types inside it and of the types that it names."""
    if item.tag == "vTypeDistribution":
        inside = [shape for vtype in item.iterfind("vType") for shape in _shapes(vtype, demand)]
        return inside + [shape for name in item.get("vTypes", "").split() for shape in demand.shapes.get(name, ())]
    usual = usual_shape(item.get("vClass", "passenger"))
    try:
        return [
            usual._replace(length=float(item.get("length", usual.length)), width=float(item.get("width", usual.width)))
        ]
    except ValueError:  # SUMO itself says what is wrong with it
        return [usual]


def _wanted_speeds(item: etree._Element) -> Iterator[tuple[str, tuple[str, float]]]:
    """Class and desired speed of a vType, or of the vTypes in a distribution, for classes in WANTED_SPEEDS, by id."""
    for vtype in item.iter("vType"):
        of = vtype.get("vClass", "passenger")
        if of not in WANTED_SPEEDS:
            continue
        # A factor may be a distribution, such as normc(1.0,0.1,0.2,2.0).
        factor = re.search(r"\d*\.?\d+", vtype.get("speedFactor", "1"))
        try:
            wanted = float(vtype.get("desiredMaxSpeed", WANTED_SPEEDS[of])) * float(factor[0] if factor else 1.0)
            yield vtype.get("id", ""), (of, min(wanted, float(vtype.get("maxSpeed", wanted))))
        except ValueError:  # SUMO itself says what is wrong with it
            continue


def _modes(person: etree._Element) -> set[str]:
    return {mode for trip in person.iterfind(".//personTrip") for mode in trip.get("modes", "").split()}


def _use_edges(item: etree._Element, demand: Demand, label: str, when: float) -> None:
    for key in ("edges", "from", "to", "via"):
        for edge in item.get(key, "").split():
            if edge not in demand.edges_used or when < demand.edges_used[edge][1]:
                demand.edges_used[edge] = (label, when)
