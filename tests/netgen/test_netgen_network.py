"""Nets hold what their specs promise."""

from math import atan2, degrees, hypot

import pytest
from lxml import etree

from slrl_sumo.netgen.network import build_net
from slrl_sumo.netgen.reach import CLASSES, reachable, read_graph
from slrl_sumo.netgen.specs import IntersectionSpec, RandomSpec, SharedSpaceSpec


def lanes_of(net: bytes, edge: str) -> list[dict[str, str]]:
    """Attributes of the lanes of `edge`, from the right."""
    return [dict(lane.attrib) for lane in etree.fromstring(net).find(f"edge[@id='{edge}']").iter("lane")]


def count(net: bytes, function: str) -> int:
    return len(etree.fromstring(net).findall(f"edge[@function='{function}']"))


def types(net: bytes) -> dict[str, str]:
    """Junction types by id, without internal ones."""
    return {j.get("id"): j.get("type") for j in etree.fromstring(net).iter("junction") if j.get("type") != "internal"}


@pytest.mark.parametrize("arms", [3, 4])
def test_every_arm_has_sidewalk_cycle_lane_and_car_lanes_and_a_crossing(arms: int) -> None:
    net = build_net(IntersectionSpec(arms=arms, lanes=2))
    for k in range(arms):
        for edge in (f"in{k}", f"out{k}"):
            sidewalk, cycle_lane, *car_lanes = lanes_of(net, edge)
            assert (sidewalk["allow"], cycle_lane["allow"]) == ("pedestrian", "bicycle")
            assert (float(sidewalk["width"]), float(cycle_lane["width"])) == (2.0, 1.5)
            assert len(car_lanes) == 2
            assert all(set(lane["disallow"].split()) == {"pedestrian", "bicycle"} for lane in car_lanes)
    assert count(net, "crossing") == arms
    assert sum(t == "dead_end" for t in types(net).values()) == arms


def test_surfaces_can_be_left_out() -> None:
    bare = build_net(IntersectionSpec(sidewalks=False, crossings=False, cycle_lanes=False))
    assert len(lanes_of(bare, "in0")) == 1
    assert not {"allow", "disallow"} & lanes_of(bare, "in0")[0].keys(), "all types may use the only lane"
    assert count(bare, "crossing") == 0
    path = build_net(IntersectionSpec(sidewalks=False, crossings=False))
    assert [lane.get("allow") for lane in lanes_of(path, "in0")] == ["pedestrian bicycle", None]
    assert count(build_net(IntersectionSpec(crossings=False)), "crossing") == 0


@pytest.mark.parametrize("control", ["priority", "right_before_left", "traffic_light"])
def test_the_junction_is_controlled_as_asked(control: str) -> None:
    net = build_net(IntersectionSpec(control=control))
    assert types(net)["centre"] == control
    assert len(etree.fromstring(net).findall("tlLogic")) == (control == "traffic_light")


def test_arms_are_as_long_and_as_fast_as_asked_and_turned_within_the_spread() -> None:
    net = etree.fromstring(build_net(IntersectionSpec(arm_length=70.0, angle_spread=20.0, speed_limit=8.33, seed=4)))
    at = {j.get("id"): (float(j.get("x")), float(j.get("y"))) for j in net.iter("junction")}
    turned = []
    for k, straight in enumerate((0.0, 90.0, 180.0, -90.0)):
        dx, dy = at[f"arm{k}"][0] - at["centre"][0], at[f"arm{k}"][1] - at["centre"][1]
        assert hypot(dx, dy) == pytest.approx(70.0, abs=0.05)
        turned.append((degrees(atan2(dy, dx)) - straight + 180.0) % 360.0 - 180.0)
    assert all(abs(t) <= 20.1 for t in turned)
    assert max(turned) - min(turned) > 5.0, "the arms are turned each by its own angle"
    assert {lane.get("speed") for lane in net.find("edge[@id='in0']")} == {"8.33"}


@pytest.mark.parametrize("arms", [2, 3, 4])
def test_a_shared_space_is_one_slow_surface_for_all_and_people_walk_across_the_middle(arms: int) -> None:
    net = build_net(SharedSpaceSpec(arms=arms, width=12.0, corner_radius=8.0))
    for k in range(arms):
        for edge in (f"in{k}", f"out{k}"):
            (lane,) = lanes_of(net, edge)
            assert set(lane["allow"].split()) == {"passenger", "bicycle", "pedestrian"}
            assert (float(lane["width"]), float(lane["speed"])) == (6.0, 5.56)
    assert count(net, "crossing") == 0, "no marked crossings: people go where they like"
    # One walking area covers the whole middle, not only the corners.
    root = etree.fromstring(net)
    middle = [e for e in root.findall("edge[@function='walkingarea']") if e.get("id").startswith(":centre")]
    assert len(middle) == 1
    junction = root.find("junction[@id='centre']").get("shape")
    assert area(middle[0].find("lane").get("shape")) == pytest.approx(area(junction), rel=0.02)


def area(shape: str) -> float:
    """m² inside the polygon that SUMO writes as "x,y x,y ..."."""
    points = [tuple(float(v) for v in p.split(",")) for p in shape.split()]
    ring = zip(points, points[1:] + points[:1], strict=True)
    return abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in ring)) / 2


def test_random_nets_grow_with_the_iterations_and_mix_lanes_and_signals() -> None:
    small, large = (build_net(RandomSpec(iterations=n, signal_share=0.4, seed=3)) for n in (8, 30))
    assert len(read_graph(large).edges) > 2 * len(read_graph(small).edges)
    signals = sum(t == "traffic_light" for t in types(large).values())
    assert 0 < signals < sum(t == "priority" for t in types(large).values())
    car_lanes = {len(lanes_of(large, edge)) - 2 for edge in read_graph(large).edges}
    assert car_lanes == {1, 2}
    assert count(large, "crossing") > 0


@pytest.mark.parametrize(
    "spec", [IntersectionSpec(seed=1), IntersectionSpec(arms=3, lanes=2, angle_spread=25.0), SharedSpaceSpec()]
)
@pytest.mark.parametrize("vehicle_class", CLASSES)
def test_all_arms_are_reached_from_all_others(spec: IntersectionSpec | SharedSpaceSpec, vehicle_class: str) -> None:
    graph = read_graph(build_net(spec))
    for k in range(spec.arms):
        others = {f"out{j}" for j in range(spec.arms)} - {f"out{k}"}
        assert others <= reachable(graph, f"in{k}", vehicle_class)


def test_the_same_spec_gives_the_same_bytes_and_another_seed_another_net() -> None:
    for kind, varied in ((IntersectionSpec, {"angle_spread": 10.0}), (SharedSpaceSpec, {"angle_spread": 5.0})):
        assert build_net(kind(**varied, seed=1)) == build_net(kind(**varied, seed=1))
        assert build_net(kind(**varied, seed=1)) != build_net(kind(**varied, seed=2))
    first = build_net(RandomSpec(seed=1))
    assert first == build_net(RandomSpec(seed=1))
    assert first != build_net(RandomSpec(seed=2))
    assert b"generated on" not in first
    assert b"/tmp" not in first
