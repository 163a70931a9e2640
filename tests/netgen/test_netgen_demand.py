"""Demand leads where the net leads, at the asked rates, by road users that differ."""

import tempfile
from pathlib import Path

import pytest
import sumolib
from lxml import etree

from slrl_sumo.netgen.demand import TYPES_PER_CLASS, demand_xml, trip_pairs
from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.network import build_net
from slrl_sumo.netgen.reach import CLASSES, NetEdge, NetGraph, reachable, read_graph, shortest_path
from slrl_sumo.netgen.specs import DemandSpec, IntersectionSpec, RandomSpec


def test_flows_add_up_to_the_asked_numbers_and_every_type_is_there() -> None:
    demand = DemandSpec(cars_per_hour=500.0, bicycles_per_hour=120.0, pedestrians_per_hour=240.0, seed=5)
    routes = etree.fromstring(demand_xml(read_graph(build_net(IntersectionSpec())), demand))
    asked = {"passenger": 500.0, "bicycle": 120.0, "pedestrian": 240.0}
    for name in CLASSES:
        flows = [f for f in routes if f.tag in ("flow", "personFlow") and f.get("type") == name]
        per_hour = sum(float(f.get("period").removeprefix("exp(").removesuffix(")")) for f in flows) * 3600.0
        assert per_hour == pytest.approx(asked[name], rel=1e-3)
        drawn = routes.findall(f"vTypeDistribution[@id='{name}']/vType")
        assert len({tuple(sorted(t.attrib.items())[1:]) for t in drawn}) == TYPES_PER_CLASS, "no two are alike"
        assert {t.get("vClass") for t in drawn} == {name}


def test_a_type_with_no_demand_is_left_out() -> None:
    demand = DemandSpec(cars_per_hour=100.0, bicycles_per_hour=0.0, pedestrians_per_hour=0.0)
    routes = demand_xml(read_graph(build_net(IntersectionSpec())), demand)
    assert b"passenger" in routes
    assert b"bicycle" not in routes
    assert b"pedestrian" not in routes


def test_people_only_go_where_they_can_walk_without_crossings() -> None:
    graph = read_graph(build_net(IntersectionSpec(crossings=False)))
    # A pavement leads round one corner, to the neighbouring arm: from the right-hand side of an arm to the next arm's.
    assert trip_pairs(graph, "pedestrian") == sorted(
        [(f"in{k}", f"out{(k + 1) % 4}") for k in range(4)] + [(f"out{(k + 1) % 4}", f"in{k}") for k in range(4)]
    )
    assert len(trip_pairs(graph, "passenger")) == 12


def test_walks_lead_over_crossings_and_not_around_the_ends_of_the_net() -> None:
    graph = read_graph(build_net(IntersectionSpec()))
    routes = etree.fromstring(demand_xml(graph, DemandSpec(pedestrians_per_hour=2000.0)))
    walks = [walk.get("edges").split() for walk in routes.iter("walk")]
    assert len(walks) > 20
    for first, *others in walks:
        assert len(others) == 1, "the streets of one intersection: into it, and out of it"
        shared = graph.edges[first].ends & graph.edges[others[0]].ends
        assert shared
        assert not shared & graph.dead_ends


def test_the_shortest_path_counts_metres_and_not_edges() -> None:
    # From a to d by one long street, or by two short ones and a crossing.
    streets = {"a": 10.0, "long": 90.0, "b": 20.0, "c": 20.0, "d": 10.0}
    edges = {i: NetEdge(f"{i}0", f"{i}1", metres, frozenset({"passenger"})) for i, metres in streets.items()}
    onward = {"a": ["long", "b"], "b": [":x"], ":x": ["c"], "c": ["d"], "long": ["d"]}
    follows = {("passenger", i): frozenset(ends) for i, ends in onward.items()}
    assert shortest_path(NetGraph(edges, frozenset(), follows, {":x": 5.0}), "a", "d", "passenger") == [*"abcd"]
    assert shortest_path(NetGraph(edges, frozenset(), follows, {":x": 60.0}), "a", "d", "passenger") == [
        "a",
        "long",
        "d",
    ]
    with pytest.raises(ValueError, match="no way leads from d to a"):
        shortest_path(NetGraph(edges, frozenset(), follows, {":x": 5.0}), "d", "a", "passenger")


def test_a_class_with_nowhere_to_go_is_named() -> None:
    # A street that is cut in the middle: each half is an end without a way to another.
    one = b"<edge id='a' from='x' to='y'><lane id='a_0' index='0' length='9'/></edge>"
    net = b"<net>" + one + b"<junction id='x' type='dead_end'/><junction id='y' type='priority'/></net>"
    with pytest.raises(NetgenError, match="class bicycle"):
        demand_xml(read_graph(net), DemandSpec(0.0, 10.0, 0.0))


@pytest.mark.filterwarnings("default::DeprecationWarning")
def test_reach_agrees_with_sumolib() -> None:
    net = build_net(RandomSpec(iterations=9, seed=5))
    graph = read_graph(net)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "made.net.xml"
        path.write_bytes(net)
        theirs = sumolib.net.readNet(str(path))
    for name in ("passenger", "bicycle"):
        for start in graph.edges:
            expected = {e.getID() for e in theirs.getReachable(theirs.getEdge(start), name)}
            assert reachable(graph, start, name) == expected


def test_the_seed_decides_the_trips() -> None:
    graph = read_graph(build_net(IntersectionSpec()))
    assert demand_xml(graph, DemandSpec(seed=1)) == demand_xml(graph, DemandSpec(seed=1))
    assert demand_xml(graph, DemandSpec(seed=1)) != demand_xml(graph, DemandSpec(seed=2))


def test_in_a_net_without_dead_ends_every_street_is_an_end() -> None:
    # A triangle of one-way streets.
    ring = {i: NetEdge(i, end, 50.0, frozenset({"passenger"})) for i, end in ("ab", "bc", "ca")}
    follows = {("passenger", i): frozenset({e.end}) for i, e in ring.items()}
    graph = NetGraph(ring, frozenset(), follows, {})
    assert trip_pairs(graph, "passenger") == [(a, b) for a in "abc" for b in "abc" if a != b]
    assert trip_pairs(graph, "bicycle") == []
