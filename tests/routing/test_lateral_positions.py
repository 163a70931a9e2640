"""Bicycles that pass persons on paths that they share: where their paths are shifted to, and when."""

from pathlib import Path

import libsumo
import numpy as np
import pytest
from builders import make_track, make_world, straight_routes, with_history

from slrl_sumo.perception.leaders import leaders
from slrl_sumo.routing.lane_path import LanePath
from slrl_sumo.routing.lateral_positions import SIDEWAYS, SharedPath, lateral_room, pass_persons
from slrl_sumo.routing.polyline import Polyline, line_through
from slrl_sumo.routing.routes import Routes
from slrl_sumo.routing.vehicle_track import VehicleTrack
from slrl_sumo.scene.route import HERE, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType
from slrl_sumo.studies.flow.situations import SITUATIONS
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

ROOM = lateral_room(3.0, 0.65)
"""m, on a path of 3 m."""
SPEED = 5.0
"""m/s of the bicycle."""


def _line() -> Polyline:
    line, _ = line_through([(0.0, 0.0), (100.0, 0.0)])
    return line


def _bicycle(lateral_position: float = 0.0) -> VehicleTrack:
    track = make_track(LanePath(("path",), (100.0,), (), _line()), 1.0, SPEED)
    track.lateral_position = lateral_position
    return with_history(track, elapsed=DECISION_INTERVAL)


def _behind(*persons: tuple[float, float, float, float]) -> WorldState:
    """A bicycle in the origin that rides eastwards, and persons: x, y, heading, speed."""
    kind = [RoadUserType.BICYCLE] + [RoadUserType.PEDESTRIAN] * len(persons)
    return make_world(*np.array([(0.0, 0.0, 0.0, SPEED), *persons]).T, type=kind)


def _passed(world: WorldState, track: VehicleTrack, room: float = ROOM) -> RouteAhead:
    """The route of the bicycle after `pass_persons`."""
    route = straight_routes((0.0, 0.0, 0.0), desired_speed=SPEED)
    pass_persons(route, world, [SharedPath(0, track, room)])
    return route


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_bicycle_passes_a_person_on_the_free_side(side: float) -> None:
    world, track = _behind((12.0, 0.4 * side, 0.0, 1.3)), _bicycle()
    route = _passed(world, track)
    assert route.y[0, HERE] == 0.0
    assert 0.5 < -side * route.y[0, HERE + 12] <= ROOM
    assert np.isinf(leaders(route, world, np.zeros(1)).gap[0])
    assert -side * track.lateral_position == pytest.approx(SIDEWAYS * DECISION_INTERVAL)


def test_a_bicycle_follows_a_person_where_there_is_no_room() -> None:
    world, track = _behind((12.0, 0.0, 0.0, 1.3)), _bicycle()
    route = _passed(world, track, room=lateral_room(2.0, 0.65))
    assert not route.y.any()
    assert leaders(route, world, np.zeros(1)).gap[0] < 12.0
    assert track.lateral_position == 0.0


def test_a_bicycle_keeps_away_from_oncoming_persons() -> None:
    """Between a person that it would pass on the left and an oncoming one on the left, there is no room."""
    slow, oncoming = (12.0, -0.4, 0.0, 1.3), (16.0, 0.9, np.pi, 1.3)
    assert _passed(_behind(slow), _bicycle()).y[0, HERE + 12] > 0.5
    assert abs(_passed(_behind(slow, oncoming), _bicycle()).y[0]).max() < 0.1


def test_a_bicycle_gives_way_to_a_person_that_crosses() -> None:
    assert not _passed(_behind((12.0, -0.4, 0.5 * np.pi, 1.3)), _bicycle()).y.any()


def test_a_bicycle_beside_a_person_does_not_turn_towards_it() -> None:
    """Nearer than it should be, but it can only get away."""
    world, track = _behind((0.2, -0.6, 0.0, 1.3)), _bicycle(0.2)
    assert _passed(world, track).y[0, HERE:].min() >= 0.2 - 1e-9


def test_a_bicycle_does_not_cross_the_way_of_a_person_just_ahead() -> None:
    """Beyond the person the path is free, but the bicycle would reach it too late."""
    world, track = _behind((2.5, 0.45, 0.0, 1.3), (9.0, -0.5, 0.0, 1.3)), _bicycle(-0.5)
    assert _passed(world, track).y[0].max() < 0.0


def test_a_bicycle_returns_to_the_middle() -> None:
    track = _bicycle(0.8)
    route = _passed(_behind((-5.0, -0.4, 0.0, 1.3)), track)
    assert route.y[0, HERE] == pytest.approx(0.8)
    assert route.y[0, HERE + 12] == pytest.approx(0.0)
    assert track.lateral_position == pytest.approx(0.8 - SIDEWAYS * DECISION_INTERVAL)


@pytest.mark.parametrize(("kind", "lane"), [("rider", 0), ("car", 1)])
def test_bicycles_pass_persons_on_paths_without_cars(tmp_path: Path, kind: str, lane: int) -> None:
    """On a lane for cars, persons that walk along it are followed."""
    scenario = find_scenario(str(SITUATIONS["shared-path"].build(tmp_path)))
    with SumoSession(scenario, step_length=DECISION_INTERVAL) as session:
        libsumo.route.add("street", ["wm", "me"])
        libsumo.vehicle.add("bicycle", "street", kind, departLane=str(lane), departPos="50")
        session.step()
        session.step()
        x, y = np.array(libsumo.vehicle.getPosition("bicycle")) - (0.8, 0.0)
        kinds = [RoadUserType.BICYCLE, RoadUserType.PEDESTRIAN]
        world = make_world(
            [x, x + 8.0], [y, y - 0.5], speed=[SPEED, 1.3], type=kinds, ids=["bicycle", "person"], time=session.time
        )
        route = Routes(libsumo, session.network).ahead(world, 1)
        assert np.isinf(leaders(route, world, np.zeros(1)).gap[0]) == (lane == 0)
