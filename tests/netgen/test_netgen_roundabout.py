"""Roundabouts: a closed one-way ring with right of way, and a way through for all."""

import subprocess
from math import hypot
from pathlib import Path

import pytest
from lxml import etree

from slrl_sumo.netgen.binaries import binary
from slrl_sumo.netgen.families import generate
from slrl_sumo.netgen.network import build_net
from slrl_sumo.netgen.reach import CLASSES, reachable, read_graph
from slrl_sumo.netgen.specs import RoundaboutSpec

SPECS = [
    RoundaboutSpec(arms=3, radius=14.0, angle_spread=24.0, seed=3),
    RoundaboutSpec(arms=4, radius=18.0, angle_spread=10.0, cycle_lanes=False, seed=1),
    RoundaboutSpec(arms=5, radius=14.0, angle_spread=1.0, seed=2),
]


def points(shape: str) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in (p.split(",")[:2] for p in shape.split())]


@pytest.mark.parametrize("spec", SPECS, ids=repr)
def test_the_ring_is_closed_one_way_and_turns_counter_clockwise_round_the_island(spec: RoundaboutSpec) -> None:
    net = etree.fromstring(build_net(spec))
    streets = {e.get("id"): (e.get("from"), e.get("to")) for e in net.findall("edge") if e.get("from")}
    between = {i: ends for i, ends in streets.items() if all(end.startswith("ring") for end in ends)}
    assert between == {f"ring{k}": (f"ring{k}", f"ring{(k + 1) % spec.arms}") for k in range(spec.arms)}
    x0, y0 = (float(v) for v in net.find("location").get("netOffset").split(","))
    for edge in between:
        lanes = net.findall(f"edge[@id='{edge}']/lane")
        from_middle = [[hypot(x - x0, y - y0) for x, y in points(lane.get("shape"))] for lane in lanes]
        # The car lane lies at the island's edge, the others outside of it, each at one distance from the middle.
        assert from_middle[-1] == pytest.approx([spec.radius + 1.6] * len(from_middle[-1]), abs=0.35)
        assert [sum(d) / len(d) for d in from_middle] == sorted((sum(d) / len(d) for d in from_middle), reverse=True)
        (xa, ya), *_, (xb, yb) = points(lanes[-1].get("shape"))
        assert (xa - x0) * (yb - y0) - (ya - y0) * (xb - x0) > 0.0
        assert float(lanes[-1].get("speed")) < spec.speed_limit, "the ring is too tight for the arms' speed"


@pytest.mark.parametrize("spec", SPECS, ids=repr)
def test_entering_traffic_gives_way_to_the_ring(spec: RoundaboutSpec) -> None:
    net = etree.fromstring(build_net(spec))
    named = net.find("roundabout")
    assert set(named.get("edges").split()) == {f"ring{k}" for k in range(spec.arms)}
    links = [c for c in net.findall("connection") if c.get("to") in named.get("edges").split()]
    entering = [c for c in links if c.get("from").startswith("entry")]
    circulating = [c for c in links if c.get("from").startswith("ring")]
    vehicle_lanes = 1 + spec.cycle_lanes
    assert len(entering) == len(circulating) == spec.arms * vehicle_lanes
    assert {c.get("state") for c in entering} == {"m"}
    assert {c.get("state") for c in circulating} == {"M"}


@pytest.mark.parametrize("spec", SPECS, ids=repr)
def test_people_cross_every_arm_before_the_ring_and_drivers_let_them(spec: RoundaboutSpec) -> None:
    net = etree.fromstring(build_net(spec))
    crossings = net.findall("edge[@function='crossing']")
    assert {frozenset(c.get("crossingEdges").split()) for c in crossings} == {
        frozenset({f"in{k}", f"out{k}"}) for k in range(spec.arms)
    }
    for k in range(spec.arms):
        # Room for a car between the ring and the people on the crossing.
        assert 5.5 < float(net.find(f"edge[@id='exit{k}']/lane").get("length")) < 12.0
        onto = [c for c in net.findall("connection") if c.get("from") in (f"in{k}", f"exit{k}")]
        assert {c.get("state") for c in onto if not c.get("to").startswith(":")} == {"m"}


@pytest.mark.parametrize("vehicle_class", CLASSES)
@pytest.mark.parametrize("spec", SPECS, ids=repr)
def test_every_arm_reaches_every_other(spec: RoundaboutSpec, vehicle_class: str) -> None:
    graph = read_graph(build_net(spec))
    for k in range(spec.arms):
        others = {f"out{j}" for j in range(spec.arms)} - {f"out{k}"}
        assert others <= reachable(graph, f"in{k}", vehicle_class)


def test_without_crossings_the_arms_are_of_one_piece_and_people_get_round_the_corner_only() -> None:
    graph = read_graph(build_net(RoundaboutSpec(crossings=False)))
    assert not [edge for edge in graph.edges if edge.startswith(("entry", "exit"))]
    assert "out1" in reachable(graph, "in0", "pedestrian")
    assert not {"out2", "out3"} & reachable(graph, "in0", "pedestrian")
    assert {"out1", "out2", "out3"} <= reachable(graph, "in0", "bicycle")


def test_the_same_spec_gives_the_same_bytes_and_another_seed_or_radius_another_net() -> None:
    net = build_net(RoundaboutSpec(angle_spread=5.0, seed=1))
    assert net == build_net(RoundaboutSpec(angle_spread=5.0, seed=1))
    assert net != build_net(RoundaboutSpec(angle_spread=5.0, seed=2))
    assert net != build_net(RoundaboutSpec(angle_spread=5.0, seed=1, radius=20.0))
    assert b"generated on" not in net


@pytest.mark.parametrize("seed", [1, 4, 12])
def test_all_get_through_in_plain_sumo_without_warnings(seed: int, tmp_path: Path) -> None:
    config = generate("roundabout", seed, tmp_path / "made")
    statistics = tmp_path / "statistics.xml"
    # None enters after 600 s; a trip takes less than 250 s, on foot.
    command = [binary("sumo"), "-c", str(config), "--end", "900", "--statistic-output", str(statistics)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    said = etree.parse(statistics).getroot()
    vehicles, persons = said.find("vehicles"), said.find("persons")
    assert int(vehicles.get("inserted")) == int(vehicles.get("loaded")) > 50
    assert int(persons.get("loaded")) > 10
    assert (vehicles.get("running"), vehicles.get("waiting"), persons.get("running")) == ("0", "0", "0")
    assert (said.find("teleports").get("total"), said.find("safety").get("collisions")) == ("0", "0")
