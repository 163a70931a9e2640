"""Roundabouts of a town: a ring with one place for each street, and every street joined to it."""

from math import hypot

from slrl_sumo.netgen.plan import Edge, Node, Plan
from slrl_sumo.studies.flow.scenarios.towns import RADIUS, with_roundabouts


def test_a_roundabout_has_a_ring_through_all_its_streets() -> None:
    nodes = {name: Node(x, y, "priority") for name, x, y in [("m", 0, 0), ("e", 100, 0), ("n", 0, 100), ("w", -100, 0)]}
    edges = {f"{a}{b}": Edge(a, b, 13.89, ({},) * 2) for a, b in ("em", "me", "nm", "mn", "wm", "mw")}
    made = with_roundabouts(Plan(nodes, edges), seed=1)
    ring = [edge for name, edge in made.edges.items() if name.startswith("ring-")]
    # Counter-clockwise from one street to the next.
    assert {(edge.start, edge.end) for edge in ring} == {("m-e", "m-n"), ("m-n", "m-w"), ("m-w", "m-e")}
    assert made.edges["em"] == Edge("e", "m-e", 13.89, ({},) * 2)
    assert made.edges["mw"].start == "m-w"
    assert "m" not in made.nodes
    assert all(abs(hypot(made.nodes[edge.start].x, made.nodes[edge.start].y) - RADIUS) < 1e-9 for edge in ring)


def test_a_town_of_dead_ends_has_none() -> None:
    plan = Plan({"a": Node(0, 0, "priority"), "b": Node(9, 0, "priority")}, {"ab": Edge("a", "b", 13.89, ({},))})
    assert with_roundabouts(plan, seed=1) == plan
