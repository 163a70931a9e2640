"""Reservations where one junction follows another."""

from pathlib import Path

import libsumo
import numpy as np
import pytest

from slrl_sumo.routing.junctions.conflict_areas import ConflictAreas
from slrl_sumo.routing.junctions.lines_inside import next_line
from slrl_sumo.routing.junctions.occupants import Size
from slrl_sumo.routing.junctions.reservations import JunctionReservations
from slrl_sumo.routing.junctions.right_of_way import RightOfWay
from slrl_sumo.routing.lane_graph import LaneGraph
from slrl_sumo.routing.lane_path import JunctionEntry, LanePath, junction_of
from slrl_sumo.routing.polyline import Polyline
from slrl_sumo.routing.routes import end_with_room
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from tests.builders import make_scenario, make_track, make_world

SIZE = Size(5.0, 1.8)


def test_a_vehicle_in_a_junction_holds_its_way_through_the_next_one() -> None:
    with SumoSession(find_scenario("district"), seed=1) as session:
        graph = LaneGraph(libsumo, session.network)
        path = _through_two_junctions(graph)
        here, onward = path.entries
        middle = 0.5 * (here.stop_line + here.exit)
        # The streets of this net are long: too fast for the other one to pass before, too slow to pass first.
        inside = make_track(path, middle, (onward.stop_line - middle) / 4.0)
        inside.history.entry, inside.history.entered = here.via, 0.5
        foe_path = _crossings(graph, onward.via)[0]
        line = foe_path.entries[0]
        foe = make_track(foe_path, line.stop_line - 2.0, 2.0)
        tracks = {"inside": inside, "foe": foe}
        reservations = JunctionReservations(libsumo, graph, tracks.get, RightOfWay(libsumo, graph))
        reservations.renew(make_world(time=1.0))
        assert reservations.request_entry("foe", foe, line, priority=False, size=SIZE)
        reservations.renew(make_world(time=2.0))
        # Too fast to stop: it will come, and the other one has to know.
        assert reservations.request_entry("inside", inside, onward, priority=True, size=SIZE, too_late=True)
        assert not reservations.request_entry("foe", foe, line, priority=False, size=SIZE)


def test_a_vehicle_with_its_rear_in_one_junction_and_its_front_in_the_next_holds_both(tmp_path: Path) -> None:
    nodes = "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, x, y in NODES)
    edges = "".join(f'<edge id="{a}{b}" from="{a}" to="{b}"/>' for a, b in ("wa", "ab", "be", "na", "as", "mb", "bt"))
    config = make_scenario(tmp_path, nodes, edges, "")
    with SumoSession(find_scenario(str(config)), seed=1) as session:
        graph = LaneGraph(libsumo, session.network)
        path = graph.path("wa_0", ("ab", "be"), "passenger", [])
        first, second = path.entries
        assert second.stop_line - first.exit < 5.0 < 12.0
        car = make_track(path, second.stop_line + 1.0, 0.0, ("ab", "be"))
        car.history.entry, car.history.entered = second.via, 0.5
        tracks = {"car": car}
        for name, begin, end in (("one", "na", "as"), ("two", "mb", "bt")):
            across = graph.path(f"{begin}_0", (end,), "passenger", [])
            tracks[name] = make_track(across, across.entries[0].stop_line - 1.0, 0.0, (end,))
        reservations = JunctionReservations(libsumo, graph, tracks.get, RightOfWay(libsumo, graph))
        reservations.renew(make_world(time=1.0))
        reservations.occupy("car", car, Size(12.0, 1.8))
        for name in ("one", "two"):
            line = tracks[name].path.entries[0]
            assert not reservations.request_entry(name, tracks[name], line, priority=True, size=SIZE)


NODES = (
    ("w", -100, 0),
    ("a", 0, 0),
    ("b", 15, 0),
    ("e", 115, 0),
    ("n", 0, 99),
    ("s", 0, -99),
    ("m", 15, 98),
    ("t", 15, -99),
)


@pytest.mark.parametrize(("gap", "end"), [(3.0, 40.0), (20.0, 20.0)])
def test_between_two_junctions_there_may_be_no_room_to_stand(gap: float, end: float) -> None:
    # A junction with a waiting position inside, and another one `gap` m behind it.
    inner = JunctionEntry(15.0, ":c_0_0", ":c_1_0", "b_0", 20.0)
    second = JunctionEntry(20.0 + gap, "b_0", ":d_0_0", "e_0", 40.0)
    assert end_with_room(20.0, ((inner, 20.0), (second, 40.0)), 5.0) == end
    assert end_with_room(20.0, ((second, 40.0),), 5.0) == end
    assert end_with_room(40.0, (), 5.0) == 40.0
    # A bicycle has room where a car has none.
    assert end_with_room(20.0, ((inner, 20.0), (second, 40.0)), 1.6) == 20.0


@pytest.mark.parametrize(("red", "line", "until"), [(True, 1, 8.2), (False, None, 9.0)])
def test_vehicles_stop_before_the_red_signal_of_a_junction_that_follows_at_once(
    red: bool, line: int | None, until: float
) -> None:
    """Where others cross only the last metre of the junction, they need not wait for it."""
    first = JunctionEntry(10.0, "a_0", ":c_0_0", "b_0", 20.0)
    second = JunctionEntry(20.2, "b_0", ":d_0_0", "e_0", 40.0)
    along = np.array([0.0, 100.0])
    path = LanePath((":c_0_0", "b_0"), (20.0, 100.0), (first, second), Polyline(along, np.zeros(2), along))
    track = make_track(path, 11.0, 3.0)
    track.history.entry = first.via
    found, distance = next_line(track, lambda _: red)
    assert (found, distance) == (None if line is None else path.entries[line], pytest.approx(until))


def _through_two_junctions(graph: LaneGraph) -> LanePath:
    """A way for cars through two junctions, the second of which at least one other way crosses."""
    for lane in graph.lanes.values():
        for target, _ in () if lane.internal else graph.links(lane.id):
            for last, _ in graph.links(target):
                path = graph.path(lane.id, (graph.lanes[target].edge, graph.lanes[last].edge), "passenger", [])
                junctions = [junction_of(entry.via) for entry in path.entries]
                if len(junctions) == 2 == len(set(junctions)) and _crossings(graph, path.entries[1].via):
                    return path
    raise AssertionError("no way leads through two junctions")


def _crossings(graph: LaneGraph, via: str) -> list[LanePath]:
    """The ways for cars over lanes that cross the internal lane `via`."""
    found, areas = [], ConflictAreas(graph)
    for foe in libsumo.lane.getInternalFoes(via):
        area = areas.between(via, foe, 2.0 * SIZE.turning)
        if area is None or area.together:
            continue
        origin = graph.origin(foe)
        if foe.startswith(":") and not origin.startswith(":") and graph.lanes[origin].admits("passenger"):
            target = next((target for target, by in graph.links(origin) if by == foe), None)
            if target is not None and graph.lanes[target].admits("passenger"):
                found.append(graph.path(origin, (graph.lanes[target].edge,), "passenger", []))
    return [path for path in found if len(path.entries) == 1]
