"""Demand: origins and destinations of road users, and differences in how they drive, ride and walk.

Flows with Poisson arrivals, so that another seed of SUMO gives other traffic from the same file. See
https://sumo.dlr.de/docs/Definition_of_Vehicles%2C_Vehicle_Types%2C_and_Routes.html and
https://sumo.dlr.de/docs/Specification/Persons.html.
"""

from collections.abc import Mapping
from itertools import pairwise
from random import Random

from lxml import etree

from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.reach import CLASSES, NetGraph, reachable, shortest_path
from slrl_sumo.netgen.specs import DemandSpec

TYPES_PER_CLASS = 8
"""Different drivers, riders and walkers in the routes file: models that learn from this traffic need variety."""
_MOST_FLOWS = 32
"""Greatest number per class: a large net has too many pairs of ends for one flow each."""

_Range = tuple[float, float]
# Drawn uniformly per type, around SUMO's defaults: https://sumo.dlr.de/docs/Vehicle_Type_Parameter_Defaults.html
_DRAWN: Mapping[str, Mapping[str, _Range]] = {
    "passenger": {
        "length": (3.8, 5.2),
        "width": (1.7, 1.9),
        "accel": (1.6, 3.2),
        "decel": (3.5, 5.0),
        "sigma": (0.1, 0.7),
        "tau": (0.8, 1.8),
        "minGap": (1.5, 3.0),
    },
    "bicycle": {
        "desiredMaxSpeed": (3.8, 6.8),
        "accel": (0.8, 1.5),
        "decel": (2.5, 3.5),
        "sigma": (0.2, 0.7),
        "tau": (0.8, 1.5),
        "minGap": (0.5, 1.0),
    },
    "pedestrian": {"desiredMaxSpeed": (0.95, 1.75)},
}
_SPEED_FACTOR: Mapping[str, _Range] = {"passenger": (0.8, 1.1), "bicycle": (1.0, 1.0), "pedestrian": (1.0, 1.0)}
"""Range of the types' mean factor on the speed limit (cars) or on the desired speed (the others)."""


def demand_xml(graph: NetGraph, demand: DemandSpec) -> bytes:
    """The contents of a .rou.xml for a net with `graph`; the same arguments give the same bytes.

    Every flow leads between two ends of the net that are connected for its class.
    Raises NetgenError if no two ends are connected for a class with demand.
    """
    root = etree.Element("routes")
    rates = {
        "passenger": demand.cars_per_hour,
        "bicycle": demand.bicycles_per_hour,
        "pedestrian": demand.pedestrians_per_hour,
    }
    random = Random(f"demand-{demand.seed}")
    wanted = [c for c in CLASSES if rates[c] > 0]
    for vehicle_class in wanted:
        _add_types(root, vehicle_class, random)
    for vehicle_class in wanted:
        _add_flows(root, graph, vehicle_class, rates[vehicle_class], demand.duration, random)
    return etree.tostring(root, pretty_print=True, xml_declaration=True, encoding="UTF-8")


def _add_types(root: etree._Element, vehicle_class: str, random: Random) -> None:
    group = etree.SubElement(root, "vTypeDistribution", {"id": vehicle_class})
    for k in range(TYPES_PER_CLASS):
        drawn = {name: f"{random.uniform(*ends):.2f}" for name, ends in _DRAWN[vehicle_class].items()}
        mean = random.uniform(*_SPEED_FACTOR[vehicle_class])
        drawn["speedFactor"] = f"normc({mean:.2f},0.08,{mean - 0.2:.2f},{mean + 0.2:.2f})"
        etree.SubElement(group, "vType", {"id": f"{vehicle_class}{k}", "vClass": vehicle_class, **drawn})


def _add_flows(
    root: etree._Element, graph: NetGraph, vehicle_class: str, per_hour: float, duration: float, random: Random
) -> None:
    pairs = trip_pairs(graph, vehicle_class)
    if not pairs:
        raise NetgenError(
            f"no two ends of the net are connected for the class {vehicle_class}: "
            f"set its number per hour to 0, or allow it more lanes or crossings"
        )
    if len(pairs) > _MOST_FLOWS:
        pairs = sorted(random.sample(pairs, _MOST_FLOWS))
    shares = [random.uniform(0.4, 1.6) for _ in pairs]
    for k, ((start, end), share) in enumerate(zip(pairs, shares, strict=True)):
        per_second = per_hour * share / sum(shares) / 3600.0
        flow = {
            "id": f"{vehicle_class}.{k}",
            "type": vehicle_class,
            "begin": "0",
            "end": f"{duration:g}",
            "period": f"exp({per_second:.6f})",
        }
        if vehicle_class == "pedestrian":
            person = etree.SubElement(root, "personFlow", {**flow, "departPos": _outer_end(graph, start)})
            way = _way(graph, shortest_path(graph, start, end, vehicle_class))
            etree.SubElement(person, "walk", {**way, "arrivalPos": _outer_end(graph, end)})
        else:
            entry = {"from": start, "to": end, "departLane": "best", "departSpeed": "max"}
            etree.SubElement(root, "flow", {**flow, **entry})


def trip_pairs(graph: NetGraph, vehicle_class: str) -> list[tuple[str, str]]:
    """Edges (from, to) that lead from one end of the net to another for `vehicle_class`, sorted.

    The ends are the dead ends; in a net with fewer than two of them every edge is one. Pedestrians start and arrive on
    either side of the street.
    """
    usable = {i: e for i, e in graph.edges.items() if vehicle_class in e.classes}
    walking = vehicle_class == "pedestrian"
    if len(graph.dead_ends) < 2:
        starts = ends = {i: i for i in usable}
    else:
        inward = {i: e.start for i, e in usable.items() if e.start in graph.dead_ends}
        outward = {i: e.end for i, e in usable.items() if e.end in graph.dead_ends}
        starts = inward | outward if walking else inward
        ends = inward | outward if walking else outward
    return sorted(
        (start, end)
        for start in starts
        for end in reachable(graph, start, vehicle_class) & ends.keys()
        if starts[start] != ends[end]
    )


def _way(graph: NetGraph, path: list[str]) -> dict[str, str]:
    """The attributes of a walk along edges.

    Of the first and the last edge alone SUMO makes a walk around the end of the net rather than over a crossing. Where
    a street is left at the end where it was entered, as without sidewalks, SUMO has to find the way all the same.
    """
    shared = [graph.edges[one].ends & graph.edges[other].ends for one, other in pairwise(path)]
    if all(len(joint) == 1 for joint in shared) and all(here != then for here, then in pairwise(shared)):
        return {"edges": " ".join(path)}
    return {"from": path[0], "to": path[-1]}


def _outer_end(graph: NetGraph, edge: str) -> str:
    """The position of a dead end on `edge`, or of the edge's start where it has none; m, as SUMO reads it."""
    return f"{graph.edges[edge].length:.2f}" if graph.edges[edge].end in graph.dead_ends else "0"
