"""Edges and positions of learned persons in a trace."""

import csv
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import make_scenario, make_world
from lxml import etree

from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.state import WorldState, empty_world
from slrl_sumo.scene.types import DEFAULT_LENGTH, RoadUserType
from slrl_sumo.simulation.trace_places import TracePlaces
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import Lane


def lane(name: str, points: list[tuple[float, float]]) -> Lane:
    allowed, shape = frozenset({"pedestrian"}), np.array(points, np.float64)
    return Lane(name, name.rpartition("_")[0], shape, 2.0, 10.0, 2.0, allowed, name.startswith(":"), Surface.SIDEWALK)


Cli = Callable[..., subprocess.CompletedProcess[str]]
NETWORK = Network((lane("street_0", [(0, 0), (10, 0)]), lane(":j_w0_0", [(10, -3), (20, -3), (20, 3), (10, 3)])), ())
CAR, PEDESTRIAN = RoadUserType.CAR, RoadUserType.PEDESTRIAN


class Flat:
    """What is asked of SUMO about a flat network."""

    @property
    def simulation(self) -> "Flat":
        return self

    def convert3D(self, edge: str, position: float, lane_index: int) -> tuple[float, float, float]:  # noqa: N802
        return position, 0.0, 0.0


API: Any = Flat()


def users(*x: float) -> WorldState:
    """A learned car, learned pedestrians, and one of SUMO's own, whose fronts are at `x`."""
    kinds = np.array([CAR] + [PEDESTRIAN] * (len(x) - 1), np.int8)
    learned = np.arange(len(x)) < len(x) - 1
    half = 0.5 * DEFAULT_LENGTH[kinds]
    return make_world(x - half, type=kinds, learned=learned, ids=[f"u{k}" for k in range(len(x))])


def places(n: int) -> Places:
    person = np.arange(n) > 0
    return Places(("t",) * n, ("sumos",) * n, np.full(n, 7.0), person)


def test_learned_persons_are_where_they_stand_and_all_others_where_sumo_has_them() -> None:
    found = TracePlaces(API, NETWORK).complete(places(5), users(4.0, 4.0, 15.0, 25.0, 4.0))
    assert found.lane == ("sumos", "street", ":j_w0", "", "sumos")
    np.testing.assert_allclose(found.lane_position, [7.0, 4.0, 0.0, 0.0, 7.0], atol=1e-9)
    assert found.heights is None


def test_on_a_walking_area_positions_are_the_way_walked_on_it() -> None:
    trace = TracePlaces(API, NETWORK)
    steps = (9.0, 12.0, 15.0, 13.0, 9.0, 12.0)
    along = [trace.complete(places(3), users(0.0, x, 0.0)).lane_position[1] for x in steps]
    np.testing.assert_allclose(along, [9.0, 0.0, 3.0, 5.0, 9.0, 0.0], atol=1e-9)


def test_a_network_without_lanes_for_persons_has_them_nowhere() -> None:
    found = TracePlaces(API, Network((), ())).complete(places(3), users(0.0, 5.0, 5.0))
    assert found.lane == ("sumos", "", "sumos")


def test_no_road_users_have_no_places() -> None:
    assert TracePlaces(API, NETWORK).complete(places(0), empty_world()).lane == ()


@pytest.fixture
def hill(tmp_path: Path) -> Path:
    """Streets up, and on down, a hill of 12 m, with sidewalks and crossings, and persons in both directions."""
    nodes = """<node id="w" x="0" y="0" z="0"/><node id="c" x="100" y="0" z="12" type="traffic_light"/>
        <node id="e" x="200" y="0" z="0"/><node id="s" x="100" y="-100" z="5"/><node id="n" x="100" y="100" z="5"/>"""
    edges = "".join(
        f'<edge id="{a}c" from="{a}" to="c" speed="10"/><edge id="c{a}" from="c" to="{a}" speed="10"/>' for a in "wens"
    )
    walks = ("wc", "ce"), ("ec", "cw"), ("sc", "cn"), ("wc", "cs")
    users = "".join(
        f'<person id="p{k}" depart="{k}" departPos="70"><walk edges="{" ".join(walks[k % 4])}"/></person>'
        f'<vehicle id="v{k}" depart="{k}" departPos="20"><route edges="{" ".join(walks[k % 4])}"/></vehicle>'
        for k in range(12)
    )
    return make_scenario(tmp_path, nodes, edges, users, "--sidewalks.guess", "--crossings.guess")


def test_heights_and_slopes_are_those_of_sumo_and_of_the_ground(cli: Cli, hill: Path, tmp_path: Path) -> None:
    """All road users of a run in which half are learned, against SUMO's own trace of the run."""
    own, ours = tmp_path / "own.xml", tmp_path / "ours.xml"
    done = cli(
        *("run", hill, "--takeover", "car=0.5,pedestrian=0.5", "--until", 60, "--fcd", ours, "--sumo-outputs"),
        *("--sumo-options", f"--fcd-output {own} --precision 6", "--step-length", 0.4, "--quiet"),
    )
    assert done.returncode == 0, done.stderr
    theirs = {(round(float(step.get("time")), 2), e.get("id")): e for step in etree.parse(own).getroot() for e in step}
    with open(tmp_path / "ours.learned.csv") as table:
        learned = {
            (round(float(row["timestep_time"]), 2), row["person_id"]) for row in csv.DictReader(table, delimiter=";")
        }
    walks = climbs = 0
    for step in etree.parse(ours).getroot():
        for e in step:
            key = round(float(step.get("time")), 2), e.get("id")
            z, slope = float(e.get("z", "nan")), float(e.get("slope", "nan"))
            if key not in learned:
                assert z == pytest.approx(float(theirs[key].get("z")), abs=0.01)
                on_area = (e.get("edge") or "").startswith(":c_w")
                assert slope == pytest.approx(0.0 if on_area else float(theirs[key].get("slope")), abs=0.01)
                climbs += abs(slope) > 3.0
            elif edge := e.get("edge"):
                walks += 1
                # The junction is flat on top of the hill (netconvert puts crossings 0.2 m higher), arms have 92.8 m.
                x, y = (abs(float(e.get(axis, "nan")) - 100.0) for axis in "xy")
                rise = (12.0 if x > y else 7.0) / 92.8
                assert z == pytest.approx(12.0 - rise * max(x - 7.2, y - 7.2, 0.0), abs=0.3)
                if not edge.startswith(":"):
                    steepness = np.degrees(np.arctan(rise))
                    assert slope == pytest.approx(steepness if edge.endswith("c") else -steepness, abs=0.02)
    assert climbs > 300
    assert walks > 300
