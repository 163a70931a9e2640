"""Motorways: ramps with lanes of their own, a lane that ends, and a way through for cars alone."""

import subprocess
from pathlib import Path

import pytest
from lxml import etree

from slrl_sumo.netgen.binaries import binary
from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.families import draw_spec, generate
from slrl_sumo.netgen.network import build_net
from slrl_sumo.netgen.reach import CLASSES, read_graph
from slrl_sumo.netgen.specs import MotorwaySpec


def test_ramps_have_lanes_for_speeding_up_and_slowing_down_and_a_lane_ends() -> None:
    net = etree.fromstring(build_net(MotorwaySpec(lanes=3, seed=4)))
    lanes = {edge.get("id"): edge.findall("lane") for edge in net.findall("edge") if edge.get("from")}
    count = {name: len(found) for name, found in lanes.items()}
    assert count.pop("between-AddedOnRampEdge") == count.pop("between-AddedOffRampEdge") == 4
    assert count == {"begin": 3, "between": 3, "end": 3, "narrow": 2, "on": 1, "off": 1}
    assert {lane.get("speed") for lane in lanes["narrow"]} == {"33.33"}
    assert {lane.get("speed") for lane in lanes["on"]} == {"22.22"}


def test_cars_get_from_both_begins_to_both_ends_and_no_others_are_let_in() -> None:
    graph = read_graph(build_net(MotorwaySpec(seed=5)))
    assert len(graph.dead_ends) == 4
    assert {name for edge in graph.edges.values() for name in edge.classes} == {CLASSES[0]}


def test_seeds_draw_all_speeds_and_more_and_less_traffic_than_the_narrow_stretch_can_take() -> None:
    drawn = [draw_spec("motorway", seed) for seed in range(100)]
    assert {spec.speed_limit for spec, _ in drawn if isinstance(spec, MotorwaySpec)} == {
        19.44,
        22.22,
        27.78,
        33.33,
        36.11,
    }
    per_lane = [d.cars_per_hour / (spec.lanes - 1) for spec, d in drawn if isinstance(spec, MotorwaySpec)]
    assert min(per_lane) < 1200 < 2000 < max(per_lane)
    assert {d.bicycles_per_hour + d.pedestrians_per_hour for _, d in drawn} == {0.0}


@pytest.mark.parametrize("seed", [1, 2])
def test_plain_sumo_drives_it_without_warnings(seed: int, tmp_path: Path) -> None:
    config = generate("motorway", seed, tmp_path / "made")
    command = [binary("sumo"), "-c", config, "--end", "60"]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    assert "Warning" not in done.stderr


def test_specs_that_are_no_motorways_are_refused() -> None:
    with pytest.raises(NetgenError, match="lanes is 1: give a whole number from 2 to 4"):
        MotorwaySpec(lanes=1)
    with pytest.raises(NetgenError, match="speed_limit"):
        MotorwaySpec(speed_limit=13.89)
