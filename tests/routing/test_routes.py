"""What lies ahead on routes, against what SUMO says and does: paths, signals, priority, ends."""

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import libsumo
import numpy as np
import pytest
from builders import make_crossroads, make_scenario, make_world

from slrl_sumo.routing.lane_changes import SETTLES
from slrl_sumo.routing.lane_path import STOP_LINE
from slrl_sumo.routing.routes import NEAR_END, Routes
from slrl_sumo.routing.speed_limits import LOOKS_WITH
from slrl_sumo.routing.walking.walk_path import FARTHEST_BACK, WAITING_DISTANCE
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import HERE, SPACING, RouteAhead, on_path
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.studies.flow.situations import SITUATIONS
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

LANE_END = 3.0
"""m before the end of a lane that does not lead on at which vehicles wait."""


@contextmanager
def opened(name: str | Path) -> Iterator[SumoSession]:
    with SumoSession(find_scenario(str(name)), step_length=DECISION_INTERVAL) as session:
        yield session


@pytest.fixture
def intersection() -> Iterator[SumoSession]:
    with opened("intersection") as session:
        yield session


@pytest.fixture
def signalised() -> Iterator[SumoSession]:
    with opened("signalised") as session:
        yield session


def _clear(*keep: str) -> None:
    for domain in (libsumo.vehicle, libsumo.person):
        for road_user in domain.getIDList():
            if road_user not in keep:
                domain.remove(road_user)


def _seen(session: SumoSession, *ids: str) -> WorldState:
    """These road users first, and then all others."""
    snapshot = session.reader.read()
    order = [snapshot.ids.index(i) for i in ids]
    order += [i for i in range(len(snapshot.ids)) if i not in order]
    columns = {
        name: getattr(snapshot, name)[order] for name in ("type", "x", "y", "heading", "speed", "length", "width")
    }
    return make_world(**columns, ids=[snapshot.ids[i] for i in order], time=session.time)


def _car(
    session: SumoSession,
    name: str,
    edges: tuple[str, ...],
    lane: int,
    left: float,
    speed: float,
    *,
    kind: str = "passenger1",
) -> None:
    """A car with its front `left` m before the end of a lane, at a speed (m/s) that it keeps."""
    libsumo.route.add(f"route of {name}", list(edges))
    place = libsumo.lane.getLength(f"{edges[0]}_{lane}") - left - speed * DECISION_INTERVAL
    libsumo.vehicle.add(
        name, f"route of {name}", typeID=kind, departLane=str(lane), departPos=f"{place:.3f}", departSpeed="0"
    )
    libsumo.vehicle.setSpeedMode(name, 0)
    libsumo.vehicle.setLaneChangeMode(name, 0)
    libsumo.vehicle.setSpeed(name, 0.0)
    for _ in range(20):
        session.step()
        _clear(*[i for i in libsumo.vehicle.getIDList() if i.startswith("car")])
        if libsumo.vehicle.getLaneID(name):
            break
    libsumo.vehicle.setPreviousSpeed(name, speed)
    libsumo.vehicle.setSpeed(name, speed)


def _signals(state: str) -> None:
    light = libsumo.trafficlight.getIDList()[0]
    libsumo.trafficlight.setRedYellowGreenState(light, state * len(libsumo.trafficlight.getRedYellowGreenState(light)))


def _off_lanes(session: SumoSession, edges: tuple[str, ...], x: Floats, y: Floats) -> float:
    """m from the middles of these edges' lanes, and those inside junctions, to the farthest one of some points."""
    pieces = [
        np.concatenate([lane.shape[:-1], lane.shape[1:]], axis=1)
        for lane in session.network.lanes
        if lane.edge in edges or (lane.internal and "passenger" in lane.allowed)
    ]
    x0, y0, x1, y1 = np.concatenate(pieces).T
    dx, dy = x1 - x0, y1 - y0
    share = ((x[:, None] - x0) * dx + (y[:, None] - y0) * dy) / np.maximum(dx**2 + dy**2, 1e-9)
    share = np.clip(share, 0.0, 1.0)
    return float(np.hypot(x[:, None] - x0 - share * dx, y[:, None] - y0 - share * dy).min(axis=1).max())


def _apart(route: RouteAhead) -> Floats:
    """m from each point of a path to the next."""
    gaps: Floats = np.hypot(np.diff(route.x[0]), np.diff(route.y[0]))
    return gaps


def _one(route: RouteAhead) -> dict[str, float]:
    return {
        name: float(getattr(route, name)[0])
        for name in ("desired_speed", "stop", "line", "keep_clear_exit", "signal", "remaining_distance")
    }


def test_points_are_as_far_apart_as_they_say_before_the_begin_of_a_lane_too(intersection: SumoSession) -> None:
    _car(intersection, "car", ("in0", "out2"), 2, 84.0, 2.0)
    world = _seen(intersection, "car")
    assert libsumo.vehicle.getLanePosition("car") < 6.0
    route = Routes(libsumo, intersection.network).ahead(world, 1)
    assert _apart(route) == pytest.approx(SPACING)
    along, aside, heading = on_path(route, world.x[:, None], world.y[:, None])
    assert (along[0, 0], aside[0, 0]) == (pytest.approx(0.0, abs=0.05), pytest.approx(0.0, abs=0.05))
    assert heading[0, 0] == pytest.approx(world.heading[0], abs=0.01)


def test_the_path_is_where_sumo_drives_later_and_the_way_left_gets_shorter(intersection: SumoSession) -> None:
    _car(intersection, "car", ("in0", "out3"), 2, 40.0, 8.0)
    routes = Routes(libsumo, intersection.network)
    early: RouteAhead | None = None
    left, beside, near = [], [], []
    for _ in range(60):
        intersection.step()
        _clear("car")
        if "car" not in libsumo.vehicle.getIDList():
            break
        world = _seen(intersection, "car")
        route = routes.ahead(world, 1)
        assert route.known.tolist() == [True]
        # Chords of a curve are shorter than 1 m, but no point is twice there.
        assert (_apart(route) > 0.8).all()
        assert (_apart(route) < SPACING + 1e-6).all()
        # Off the end of the network paths go straight on.
        shown = slice(HERE, HERE + 1 + int(min(_one(route)["remaining_distance"], 40.0)))
        assert _off_lanes(intersection, ("in0", "out3"), route.x[0, shown], route.y[0, shown]) < 0.3
        on_lane = libsumo.vehicle.getLanePosition("car")
        if libsumo.vehicle.getRoadID("car") == "in0":
            ahead = libsumo.lane.getLength("in0_2") - on_lane
            assert _one(route)["line"] == pytest.approx(ahead, abs=0.3)
            via = libsumo.lane.getLinks("in0_2")
            inside = next(link[4] for link in via if link[0].startswith("out3"))
            assert _one(route)["keep_clear_exit"] - _one(route)["line"] >= libsumo.lane.getLength(inside) - 0.3
            if early is None and ahead < 12.0:
                early = route
        if libsumo.vehicle.getRoadID("car") == "out3":
            assert _one(route)["line"] == math.inf
            left.append((_one(route)["remaining_distance"], libsumo.lane.getLength("out3_2") - on_lane))
            near.append((bool(routes.near_end(("car",))[0]), left[-1][0]))
        if early is not None:
            x, y = libsumo.vehicle.getPosition("car")
            along, aside, _ = on_path(early, np.array([[x]]), np.array([[y]]))
            if along[0, 0] < 39.0:
                beside.append((float(along[0, 0]), float(aside[0, 0])))
    # The front, which SUMO leads along lanes, has gone all the 40 m along the path of then.
    assert max(along for along, _ in beside) > 35.0
    assert max(abs(aside) for _, aside in beside) < 0.3
    assert len(left) > 10
    assert [a for a, _ in left] == pytest.approx([b for _, b in left], abs=0.3)
    assert [says for says, _ in near] == [way < NEAR_END for _, way in near]
    assert near[0][0] is False
    assert near[-1][0] is True
    routes.forget(("car",))
    assert routes.near_end(("car",)).tolist() == [False]


def test_a_fast_vehicle_is_near_its_end_two_decisions_before(intersection: SumoSession) -> None:
    _car(intersection, "car", ("in0", "out2"), 2, 40.0, 2.0)
    routes, world = Routes(libsumo, intersection.network), _seen(intersection, "car")
    for speed, near in ((0.5, False), (300.0, True)):
        routes.ahead(replace(world, speed=np.full(len(world), speed)), 1)
        assert routes.near_end(("car",)).tolist() == [near]


def test_red_stops_green_does_not_and_yellow_stops_vehicles_that_still_can(signalised: SumoSession) -> None:
    _car(signalised, "car", ("in0", "out2"), 2, 12.0, 6.0)
    shown: dict[str, dict[str, float]] = {}
    closed: dict[str, bool] = {}
    signalised.step()
    for state in "rGy":
        _signals(state)
        route = Routes(libsumo, signalised.network).ahead(_seen(signalised, "car"), 1)
        shown[state], closed[state] = _one(route), bool(route.stop_at_signal[0])
    line = libsumo.lane.getLength("in0_2") - libsumo.vehicle.getLanePosition("car")
    assert 11.0 < line < 13.0
    for state, number in (("r", 3.0), ("G", 1.0), ("y", 2.0)):
        assert shown[state]["signal"] == number
        assert shown[state]["line"] == pytest.approx(line, abs=0.1)
    # From 6 m/s it needs 5 m: there is room at yellow.
    assert [shown[state]["stop"] for state in "rGy"] == pytest.approx(
        [line - STOP_LINE, math.inf, line - STOP_LINE], abs=0.1
    )
    assert closed == {"r": True, "G": False, "y": True}
    # From 12 m/s it needs 19 m: at yellow it goes on, red is red.
    fast = replace(_seen(signalised, "car"), speed=np.array([12.0]))
    for state, number, stop in (("y", 2.0, math.inf), ("r", 3.0, line - STOP_LINE)):
        _signals(state)
        route = Routes(libsumo, signalised.network).ahead(fast, 1)
        assert _one(route)["signal"] == number
        assert _one(route)["stop"] == pytest.approx(stop, abs=0.1)
        assert bool(route.stop_at_signal[0]) == (state == "r")


def test_a_vehicle_that_stops_at_yellow_stops_until_green(signalised: SumoSession) -> None:
    """Vehicles that braked later than planned went on at yellow, into red: 5 of 6,046 in two towns."""
    _car(signalised, "car", ("in0", "out2"), 2, 12.0, 6.0)
    signalised.step()
    routes, slow = Routes(libsumo, signalised.network), _seen(signalised, "car")
    fast = replace(slow, speed=np.array([12.0]))
    line = libsumo.lane.getLength("in0_2") - libsumo.vehicle.getLanePosition("car")
    said = []
    for state, world in (("y", fast), ("y", slow), ("y", fast), ("r", fast), ("G", fast), ("y", fast)):
        _signals(state)
        said.append(_one(routes.ahead(world, 1))["stop"])
    stop = line - STOP_LINE
    assert said == pytest.approx([math.inf, stop, stop, stop, math.inf, math.inf], abs=0.1)


def test_a_vehicle_held_for_long_enters_a_junction_in_which_it_may_have_to_stand(signalised: SumoSession) -> None:
    _car(signalised, "car", ("in0", "out2"), 2, 3.0, 6.0)
    signalised.step()
    routes, world = Routes(libsumo, signalised.network), _seen(signalised, "car")
    stands = replace(world, speed=np.zeros(1))
    kept = {}
    # 160 s of red before the first green do not count; the second green is 200 s later, the third one 301 s.
    for k, state in enumerate("r" * 400 + "G" + "r" * 499 + "G" + "r" * 251 + "GG"):
        _signals(state)
        route = routes.ahead(replace(stands, time=world.time + k * DECISION_INTERVAL), 1)
        kept[k] = math.isfinite(route.keep_clear_line[0])
    assert [k for k, keeps in kept.items() if not keeps] == [1152, 1153]
    # Once it moves, it goes on.
    moves = replace(world, time=world.time + 1154 * DECISION_INTERVAL, speed=np.ones(1))
    assert math.isinf(routes.ahead(moves, 1).keep_clear_line[0])


@pytest.mark.parametrize("crossing", [True, False])
def test_minor_traffic_looks_and_stops_only_for_traffic_that_comes(intersection: SumoSession, crossing: bool) -> None:
    _car(intersection, "car", ("in0", "out2"), 2, 14.0, 5.0)
    if crossing:
        _car(intersection, "car that crosses", ("in1", "out3"), 2, 25.0, 8.0)
    routes = Routes(libsumo, intersection.network)
    said = []
    for _ in range(4):
        intersection.step()
        _clear("car", "car that crosses")
        world = _seen(intersection, "car", *(["car that crosses"] if crossing else []))
        route = routes.ahead(world, 1 + crossing)
        assert route.signal.tolist() == [0] * (1 + crossing)
        assert not route.stop_at_signal.any()
        said.append(_one(route))
        if crossing:
            # Who has priority goes as fast as is allowed.
            assert route.stop[1] == math.inf
            assert route.desired_speed[1] > 11.0
    far, near = said[0], said[-1]
    # Far away it comes slowly, to see; v = sqrt(2 * 0.8 of its deceleration * m to the line in 0.8 s). From 4.5 m on it
    # sees.
    assert far["line"] > 9.6
    decel = libsumo.vehicle.getDecel("car")
    assert far["stop"] == math.inf
    assert far["desired_speed"] == pytest.approx(
        math.sqrt(2.0 * LOOKS_WITH * decel * (far["line"] - 0.8 * 5.0)), rel=0.05
    )
    assert 2.0 < near["line"] < 9.0
    assert crossing or near["desired_speed"] > far["desired_speed"]
    assert near["stop"] == (pytest.approx(near["line"] - STOP_LINE) if crossing else math.inf)


def test_where_all_stop_a_vehicle_goes_on_after_its_stand(tmp_path: Path) -> None:
    with opened(SITUATIONS["all-way-stop"].build(tmp_path)) as session:
        _car(session, "car", ("in_n", "out_s"), 0, 6.0, 4.0, kind="DEFAULT_VEHTYPE")
        session.step()
        routes, comes = Routes(libsumo, session.network), _seen(session, "car")
        assert _one(routes.ahead(comes, 1))["stop"] < 6.0
        # Slow is not enough: it has to stand once, and may start then.
        near = replace(comes, y=comes.y - 4.0, speed=np.array([1.0]), time=comes.time + 0.4)
        assert _one(routes.ahead(near, 1))["stop"] < 2.0
        stands = replace(near, speed=np.array([0.0]), time=near.time + 0.4)
        assert _one(routes.ahead(stands, 1))["stop"] == math.inf
        assert _one(routes.ahead(replace(near, time=stands.time + 0.4), 1))["stop"] == math.inf


def test_traffic_on_the_main_road_does_not_look(intersection: SumoSession) -> None:
    _car(intersection, "car", ("in1", "out3"), 2, 14.0, 8.0)
    _car(intersection, "car that waits", ("in0", "out2"), 2, 2.0, 0.0)
    intersection.step()
    route = _one(Routes(libsumo, intersection.network).ahead(_seen(intersection, "car", "car that waits"), 1))
    assert route["stop"] == math.inf
    limit = libsumo.lane.getMaxSpeed("in1_2") * libsumo.vehicle.getSpeedFactor("car")
    assert route["desired_speed"] == pytest.approx(limit)


@pytest.mark.parametrize("blocked", [True, False])
def test_a_lane_that_does_not_lead_on_is_left_or_waited_in(signalised: SumoSession, blocked: bool) -> None:
    # Only lane 3 leads to the left.
    _signals("G")
    _car(signalised, "car", ("in0", "out3"), 2, 20.0, 4.0)
    if blocked:
        _car(signalised, "car beside", ("in0", "out3"), 3, 20.0, 4.0)
    signalised.step()
    world = _seen(signalised, "car", *(["car beside"] if blocked else []))
    world = replace(world, speed=np.full(len(world), 4.0))
    route = Routes(libsumo, signalised.network).ahead(world, 1)
    left = libsumo.lane.getLength("in0_2") - libsumo.vehicle.getLanePosition("car")
    _, aside, _ = on_path(route, world.x[:1, None], world.y[:1, None])
    if blocked:
        assert _one(route)["stop"] == pytest.approx(left - LANE_END, abs=0.3)
        assert abs(aside[0, 0]) < 0.1
        assert _one(route)["line"] == math.inf
    else:
        assert _one(route)["stop"] == math.inf
        width = libsumo.lane.getWidth("in0_3")
        assert aside[0, 0] == pytest.approx(-width, abs=0.2)
        assert _off_lanes(signalised, ("in0", "out3"), route.x[0, HERE:], route.y[0, HERE:]) < 0.3


@pytest.mark.parametrize("enters", [True, False])
def test_a_vehicle_does_not_change_to_a_lane_into_which_another_one_just_enters(tmp_path: Path, enters: bool) -> None:
    """It could not stop any more before the way of the other one, which waited for no vehicle of the inner lane."""
    with opened(SITUATIONS["two-lane-roundabout"].build(tmp_path)) as session:
        _car(session, "car that enters", ("in0", "ring1", "out1"), 0, 1.0 if enters else 40.0, 0.0, kind="car")
        _car(session, "car", ("ring0", "ring1", "out1"), 1, 3.0, 0.0, kind="car")
        world = _seen(session, "car that enters", "car")
        world = replace(world, speed=np.where(np.arange(len(world)) < 2, [5.0, 8.0], 0.0))
        route = Routes(libsumo, session.network).ahead(world, 2)
        aside = on_path(route, world.x[:2, None], world.y[:2, None])[1][1, 0]
        assert aside == pytest.approx(0.0 if enters else libsumo.lane.getWidth("ring0_0"), abs=0.2)


def test_a_vehicle_that_has_just_been_inserted_stays_on_its_lane(tmp_path: Path) -> None:
    """SUMO inserts others beside it on the lane that it would change to."""
    nodes = "".join(f'<node id="{name}" x="{x}" y="0"/>' for name, x in (("a", 0), ("b", 290), ("c", 490)))
    edges = '<edge id="ab" from="a" to="b" numLanes="2"/><edge id="bc" from="b" to="c" numLanes="1"/>'
    car = '<trip id="car" from="ab" to="bc" depart="0" departLane="0" departSpeed="10"/>'
    (tmp_path / "left.con.xml").write_text(
        '<connections><connection from="ab" to="bc" fromLane="1" toLane="0"/></connections>'
    )
    scenario = make_scenario(tmp_path, nodes, edges, car, "--connection-files", "left.con.xml")
    with SumoSession(find_scenario(str(scenario))) as session:
        session.step()
        world, routes = _seen(session, "car"), Routes(libsumo, session.network)
        asides = []
        for later in (0.0, SETTLES - 0.1, SETTLES + 0.1):
            now = replace(world, time=world.time + later)
            asides.append(on_path(routes.ahead(now, 1), now.x[:, None], now.y[:, None])[1].item())
        assert asides == pytest.approx([0.0, 0.0, -libsumo.lane.getWidth("ab_0")], abs=0.2)


@pytest.mark.parametrize(("length", "to", "overtakes"), [(800, "bc", True), (290, "bc", False), (290, "ab", True)])
def test_a_vehicle_overtakes_on_a_lane_that_does_not_lead_on_only_far_from_its_end_or_on_the_last_edge(
    tmp_path: Path, length: int, to: str, overtakes: bool
) -> None:
    nodes = "".join(f'<node id="{name}" x="{x}" y="0"/>' for name, x in (("a", 0), ("b", length), ("c", length + 90)))
    edges = '<edge id="ab" from="a" to="b" numLanes="2"/><edge id="bc" from="b" to="c" numLanes="1"/>'
    demand = (
        '<vType id="bike" vClass="bicycle"/>'
        f'<trip id="ahead" type="bike" from="ab" to="{to}" depart="0" departLane="0" departPos="60" departSpeed="5"/>'
        f'<trip id="car" from="ab" to="{to}" depart="0" departLane="0" departPos="10" departSpeed="5"/>'
    )
    (tmp_path / "right.con.xml").write_text(
        '<connections><connection from="ab" to="bc" fromLane="0" toLane="0"/></connections>'
    )
    scenario = make_scenario(tmp_path, nodes, edges, demand, "--connection-files", "right.con.xml")
    with SumoSession(find_scenario(str(scenario))) as session:
        session.step()
        world, routes = _seen(session, "car"), Routes(libsumo, session.network)
        routes.ahead(world, 1)
        later = replace(world, time=world.time + SETTLES + 0.1)
        aside = on_path(routes.ahead(later, 1), later.x[:1, None], later.y[:1, None])[1].item()
        assert (abs(aside) > 1.0) is overtakes


def test_a_vehicle_that_waits_where_no_lane_leads_on_remains_learned(signalised: SumoSession) -> None:
    """SUMO would wait there as well, and its vehicles are let into the next lane by no learned one."""
    _signals("G")
    _car(signalised, "car", ("in0", "out3"), 2, 20.0, 4.0)
    signalised.step()
    world = _seen(signalised, "car")
    world = replace(world, speed=np.zeros(len(world)))
    routes = Routes(libsumo, signalised.network)
    for _ in range(150):
        route = routes.ahead(world, 1)
    assert route.known[0]
    assert not routes.off_route(("car",)).any()


@pytest.mark.parametrize(("beside", "astray"), [(2.0, False), (4.5, True)])
def test_a_vehicle_far_beside_its_path_on_no_lane_is_off_its_route(tmp_path: Path, beside: float, astray: bool) -> None:
    """SUMO puts it on its route again; by itself it may stand there to the end."""
    nodes, edges = '<node id="a" x="0" y="0"/><node id="b" x="300" y="0"/>', '<edge id="ab" from="a" to="b"/>'
    car = '<trip id="car" from="ab" to="ab" depart="0" departPos="50"/>'
    with SumoSession(find_scenario(str(make_scenario(tmp_path, nodes, edges, car)))) as session:
        session.step()
        routes = Routes(libsumo, session.network)
        routes.ahead(_seen(session, "car"), 1)
        x, y = libsumo.vehicle.getPosition("car")
        libsumo.vehicle.moveToXY("car", "", -1, x, y - beside, 90.0, 2)
        session.step()
        routes.ahead(_seen(session, "car"), 1)
        assert routes.off_route(("car",)).tolist() == [astray]


@pytest.mark.parametrize(
    ("place", "heading", "astray"),
    [((0.0, -1.6), 0.0, False), ((-3.0, -0.6), 0.3, False), ((1.6, 0.0), 0.5 * math.pi, True)],
    ids=["on its way", "on the way to the left", "on another way"],
)
def test_a_vehicle_on_no_lane_inside_a_junction_goes_on_along_its_route(
    tmp_path: Path, place: tuple[float, float], heading: float, astray: bool
) -> None:
    """SUMO has it on the edge after the junction already: a path from there ended inside the junction, and the vehicle
    stood there for ever. Where no way of its route is near, SUMO puts it on its route again."""
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="{y}"/>'
        for name, x, y in [("a", -100, 0), ("j", 0, 0), ("b", 100, 0), ("c", 200, 0), ("s", 0, -100), ("n", 0, 100)]
    )
    edges = "".join(f'<edge id="{a}{b}" from="{a}" to="{b}"/>' for a, b in ["aj", "jb", "bc", "sj", "jn"])
    car = '<route id="r" edges="aj jb bc"/><vehicle id="car" route="r" depart="0" departEdge="1" departPos="20"/>'
    with opened(make_scenario(tmp_path, nodes, edges, car)) as session:
        session.step()
        (x, y), (dx, dy) = libsumo.junction.getPosition("j"), place
        libsumo.vehicle.moveToXY("car", "", -1, x + 30.0, y - 9.0, 90.0, 2)
        session.step()
        assert libsumo.vehicle.getLaneID("car") == ""
        assert libsumo.vehicle.getRouteIndex("car") == 1
        seen = _seen(session, "car")
        at = {"x": x + dx - 2.5 * math.cos(heading), "y": y + dy - 2.5 * math.sin(heading), "heading": heading}
        world = replace(seen, **{name: np.array([value]) for name, value in at.items()})
        routes = Routes(libsumo, session.network)
        route = routes.ahead(world, 1)
        assert routes.off_route(("car",)).tolist() == [astray]
        assert math.isinf(route.stop.item()) is not astray


@contextmanager
def _street(folder: Path, left: float) -> Iterator[SumoSession]:
    """A straight street towards the east, and "car" that departs `left` m before its end."""
    nodes, edges = '<node id="a" x="0" y="0"/><node id="b" x="300" y="0"/>', '<edge id="ab" from="a" to="b"/>'
    car = f'<trip id="car" from="ab" to="ab" depart="0" departPos="{-left}"/>'
    with opened(make_scenario(folder, nodes, edges, car)) as session:
        session.step()
        yield session


@pytest.mark.parametrize(("heading", "near"), [(0.1, True), (-0.1, True), (0.4, False), (-2.0, False)])
def test_a_vehicle_across_its_last_lane_is_not_yet_near_its_end(tmp_path: Path, heading: float, near: bool) -> None:
    """SUMO would leave it in the way of others, such as after a turnaround."""
    with _street(tmp_path, left=12.0) as session:
        routes, world = Routes(libsumo, session.network), _seen(session, "car")
        routes.ahead(replace(world, heading=np.array([heading])), 1)
        assert routes.near_end(("car",)).tolist() == [near]


@pytest.mark.parametrize(("speed", "off"), [(15.0, True), (4.0, False), (0.0, False)])
def test_a_vehicle_that_would_pass_its_destination_after_a_junction_is_handed_back_inside(
    tmp_path: Path, speed: float, off: bool
) -> None:
    """Past a last edge of 2.4 m, SUMO put it on the opposite edge, on which its route had led before, before another
    car (Vaduz)."""
    places = (("a", 0, 0), ("j", 200, 0), ("b", 209.6, 0), ("n", 200, 100), ("s", 200, -100))
    nodes = "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, x, y in places)
    edges = "".join(f'<edge id="{a}{b}" from="{a}" to="{b}"/>' for a, b in ("aj", "jb", "jn", "sj"))
    car = '<route id="r" edges="aj jb"/><vehicle id="car" route="r" depart="0" departPos="190"/>'
    with opened(make_scenario(tmp_path, nodes, edges, car)) as session:
        session.step()
        assert libsumo.lane.getLength("jb_0") < 0.4 * 15.0
        seen, (x, y) = _seen(session, "car"), libsumo.lane.getShape("jb_0")[0]
        # Its front is 1 m before the end of the junction.
        world = replace(seen, x=np.array([x - 3.5]), y=np.array([y]), speed=np.array([speed]))
        routes = Routes(libsumo, session.network)
        routes.ahead(seen, 1)
        routes.ahead(world, 1)
        assert routes.off_route(("car",)).tolist() == [off]


@pytest.mark.parametrize(("heading", "time", "off"), [(0.9, 12.0, True), (0.9, 8.0, False), (0.3, 12.0, False)])
def test_a_vehicle_that_stands_across_its_path_is_off_its_route(
    tmp_path: Path, heading: float, time: float, off: bool
) -> None:
    with _street(tmp_path, left=100.0) as session:
        routes, world = Routes(libsumo, session.network), _seen(session, "car")
        for now in np.arange(0.0, time, DECISION_INTERVAL):
            routes.ahead(replace(world, time=world.time + now, heading=np.array([heading]), speed=np.zeros(1)), 1)
        assert routes.off_route(("car",)).tolist() == [off]


@pytest.mark.parametrize(
    ("left", "aside", "time", "off"),
    [(0.5, 1.5, 12.0, True), (1.7, 1.5, 12.0, True), (0.5, 1.5, 8.0, False), (0.5, 0.3, 12.0, False)],
)
def test_a_vehicle_that_stands_beside_its_lane_at_its_end_is_off_its_route(
    signalised: SumoSession, left: float, aside: float, time: float, off: bool
) -> None:
    """It cannot move aside any more: on the ring around the Arc de Triomphe, cars stood there for ever, and in Rennes
    1.7 m before the place where they wait."""
    _signals("G")
    _car(signalised, "car", ("in0", "out3"), 2, LANE_END + left, 4.0)
    signalised.step()
    world, routes = _seen(signalised, "car"), Routes(libsumo, signalised.network)
    heading, x, y = world.heading[0], world.x.copy(), world.y.copy()
    x[0], y[0] = x[0] - aside * math.sin(heading), y[0] + aside * math.cos(heading)
    world = replace(world, x=x, y=y, speed=np.zeros(len(world)))
    for now in np.arange(0.0, time, DECISION_INTERVAL):
        routes.ahead(replace(world, time=world.time + now), 1)
    assert routes.off_route(("car",)).tolist() == [off]


def test_a_vehicle_beside_its_path_is_still_on_it(intersection: SumoSession, monkeypatch: pytest.MonkeyPatch) -> None:
    _car(intersection, "car", ("in0", "out3"), 2, 40.0, 8.0)
    straight, aslant = (Routes(libsumo, intersection.network) for _ in range(2))
    ask, asked = libsumo.vehicle.getVehicleClass, list[str]()

    def count(vehicle: str) -> str:
        asked.append(vehicle)
        return str(ask(vehicle))

    monkeypatch.setattr(libsumo.vehicle, "getVehicleClass", count)
    gaps, ways = [], []
    for step in range(22):
        intersection.step()
        _clear("car")
        world = _seen(intersection, "car")
        right = straight.ahead(world, 1)
        # Up to 3 m to the left, and back.
        shift = 3.0 * math.sin(0.3 * step)
        heading = float(world.heading[0])
        away = replace(world, x=world.x - shift * math.sin(heading), y=world.y + shift * math.cos(heading))
        route = aslant.ahead(away, 1)
        assert route.known[0]
        _, aside, _ = on_path(right, route.x[:, HERE:], route.y[:, HERE:])
        gaps.append(float(np.abs(aside[0, :-6]).max()))
        ways.append((_one(route)["line"], _one(right)["line"]))
        _, own, _ = on_path(route, away.x[:, None], away.y[:, None])
        if libsumo.vehicle.getRoadID("car") == "in0":
            assert own[0, 0] == pytest.approx(shift, abs=0.3)
    # Each has found out about the car once.
    assert len(asked) == 2
    assert max(gaps) < 0.3
    far = [(a, b) for a, b in ways if b > 5.0 and math.isfinite(b)]
    assert len(far) > 5
    assert all(abs(a - b) < 0.5 for a, b in far)


def test_a_walk_over_a_crossing_with_a_signal(signalised: SumoSession) -> None:
    libsumo.person.add("walker", "in0", 70.0, typeID="pedestrian1")
    libsumo.person.appendWalkingStage("walker", ["in0", "out2"], 25.0)
    routes = Routes(libsumo, signalised.network)
    red: list[dict[str, float]] = []
    left, near = [], []
    for _ in range(400):
        signalised.step()
        _clear("walker")
        if "walker" not in libsumo.person.getIDList():
            break
        world = _seen(signalised, "walker")
        _signals("r")
        # Asked twice about the same moment: nothing moves in between.
        stopped, closed = routes.ahead(world, 1), routes.ahead(world, 1).stop_at_signal
        _signals("G")
        route = routes.ahead(world, 1)
        assert route.known[0]
        if math.isfinite(_one(route)["line"]):
            assert (_one(route)["signal"], _one(route)["stop"]) == (1.0, math.inf)
            assert (_one(stopped)["signal"], bool(closed[0]), bool(route.stop_at_signal[0])) == (3.0, True, False)
            red.append(_one(stopped))
        left.append(_one(route)["remaining_distance"])
        near.append(bool(routes.near_end(("walker",))[0]))
    assert len(red) > 10
    # On the walking area, until it has passed the kerb at green: then no signal is ahead of it any more.
    before = [r["line"] - r["stop"] for r in red]
    assert before == sorted(before, reverse=True)
    assert WAITING_DISTANCE - 1e-6 <= before[-1] <= before[0] <= FARTHEST_BACK
    # It comes nearer, to the kerb itself.
    assert np.diff([r["line"] for r in red]).max() < 1e-6
    assert red[-1]["line"] < 1.0
    assert left[0] > 40.0
    assert np.diff(left).max() < 0.2
    assert near == [way < NEAR_END for way in left]
    assert near[-1]


def test_without_a_route_each_run_takes_the_same_way_until_the_end(intersection: SumoSession) -> None:
    _car(intersection, "car", ("in0", "out2"), 2, 20.0, 5.0)
    intersection.step()
    _clear("car")
    lanes = {lane.id: lane for lane in intersection.network.lanes}
    start = _seen(intersection, "car")
    placement = intersection.spawned
    world = replace(start, ids=("learned_car.0",))
    placement.add(world.ids, world.type, world.x, world.y)
    placement.move(world.ids, world.type, world.x, world.y, world.heading, world.speed, world.length)
    libsumo.vehicle.remove("car")
    intersection.step()
    first, second = (Routes(libsumo, intersection.network) for _ in range(2))
    route = first.ahead(world, 1)
    np.testing.assert_array_equal(route.x, second.ahead(world, 1).x)
    outs = ("out0", "out1", "out2", "out3")
    assert _off_lanes(intersection, ("in0", *outs), route.x[0, HERE:], route.y[0, HERE:]) < 0.3
    assert _one(route)["remaining_distance"] == math.inf
    # The edge that it goes out on, and there to the end of the network and beyond.
    end = np.array([[route.x[0, -1], route.y[0, -1]]])
    out = min(
        (lane for lane in lanes.values() if lane.edge in outs and "passenger" in lane.allowed),
        key=lambda lane: float(np.hypot(*(lane.shape - end).T).min()),
    )
    (x0, y0), (x1, y1) = out.shape[-2:].tolist()
    heading = math.atan2(y1 - y0, x1 - x0)
    for beyond in (-30.0, -20.0, -10.0, -5.0, -1.0, 2.0, 5.0, 8.0):
        x, y = x1 + beyond * math.cos(heading), y1 + beyond * math.sin(heading)
        world = replace(world, x=np.array([x]), y=np.array([y]), heading=np.array([heading]), speed=np.array([8.0]))
        route = first.ahead(world, 1)
        assert route.known[0]
        assert (_one(route)["stop"], _one(route)["remaining_distance"], _one(route)["line"]) == (
            math.inf,
            math.inf,
            math.inf,
        )
        assert _one(route)["desired_speed"] > 5.0
        assert _apart(route)[HERE:] == pytest.approx(SPACING)
        x_ahead, y_ahead = x + 30.0 * math.cos(heading), y + 30.0 * math.sin(heading)
        _, aside, direction = on_path(route, np.array([[x, x_ahead]]), np.array([[y, y_ahead]]))
        assert aside[0] == pytest.approx(0.0, abs=0.05)
        assert direction[0] == pytest.approx(heading, abs=0.01)
    assert first.near_end(world.ids).tolist() == [False]


def test_links_without_a_signal_are_read_once_and_no_lane_is_asked_for_vehicles(
    intersection: SumoSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: dict[str, Counter[str]] = {name: Counter() for name in ("getLinks", "getLastStepVehicleIDs")}

    def counted(name: str) -> None:
        original = getattr(libsumo.lane, name)

        def call(lane: str) -> object:
            asked[name][lane] += 1
            return original(lane)

        monkeypatch.setattr(libsumo.lane, name, call)

    for _ in range(100):
        intersection.step()
    routes = Routes(intersection.api, intersection.network)
    for name in asked:
        counted(name)
    vehicles = libsumo.vehicle.getIDList()[::2]
    closest = math.inf
    for _ in range(20):
        intersection.step()
        there = [name for name in vehicles if name in libsumo.vehicle.getIDList()]
        ahead = routes.ahead(_seen(intersection, *there), len(there))
        closest = min(closest, float(ahead.line.min()))
    assert closest < 10.0
    # By the graph of lanes and by the right of way.
    assert max(asked["getLinks"].values()) <= 2
    assert not asked["getLastStepVehicleIDs"]


@pytest.mark.parametrize(("arrival", "left"), [("40", 40.0), ("-20", -20.0), ("random", 0.0), (None, 0.0)])
def test_a_trip_ends_at_its_arrival_position(arrival: str | None, left: float, tmp_path: Path) -> None:
    """40 m from the begin of the last lane, or 20 m before its end; a random one is not known."""
    position = "" if arrival is None else f'arrivalPos="{arrival}"'
    make_crossroads(tmp_path, f'<flow id="f" begin="0" end="1" number="1" from="wc" to="ce" {position}/>')
    with opened(tmp_path) as session:
        while "f.0" not in libsumo.vehicle.getIDList():
            session.step()
        ahead = Routes(libsumo, session.network).ahead(_seen(session, "f.0"), 1)
        length = libsumo.lane.getLength("ce_0")
        way = libsumo.vehicle.getDrivingDistance("f.0", "ce", length)
        assert ahead.remaining_distance[0] == pytest.approx(way + left - (length if left > 0.0 else 0.0), abs=0.5)
