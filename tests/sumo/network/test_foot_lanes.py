"""The edge, crossing or walking area under a person, against what SUMO says of its own persons."""

from dataclasses import replace

import libsumo
import numpy as np
import pytest

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.sumo.network.foot_lanes import FOOT_LANE_MARGIN, FootLanes
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def foot_lane(name: str, points: list[tuple[float, float]], length: float = 10.0) -> Lane:
    return Lane(
        id=name,
        edge=name.rpartition("_")[0],
        shape=np.array(points, np.float64),
        width=2.0,
        length=length,
        max_speed=2.0,
        allowed=frozenset({"pedestrian"}),
        internal=name.startswith(":"),
        surface=Surface.SIDEWALK,
    )


SIDEWALK = foot_lane("walk_0", [(0, 0), (10, 0)], length=20.0)
CROSSING = foot_lane(":j_c0_0", [(14, 2), (14, 12)])
AREA = foot_lane(":j_w0_0", [(10, -1), (15, -1), (15, 2), (10, 2)])


def at(lanes: list[Lane], *places: tuple[float, float]) -> list[tuple[str, float]]:
    foot_lanes = FootLanes(lanes)
    found, along = foot_lanes.at(*np.array(places, np.float64).T)
    return [
        (foot_lanes.lanes[lane].id if lane >= 0 else "", round(m, 6))
        for lane, m in zip(found.tolist(), along.tolist(), strict=True)
    ]


def test_a_place_is_on_the_lane_that_holds_it_in_sumos_measure() -> None:
    # The sidewalk counts 20 m where it is drawn 10 m long.
    found = at([SIDEWALK, CROSSING, AREA], (2.5, 0.9), (12.0, 0.0), (14.5, 5.0))
    assert [lane for lane, _ in found] == ["walk_0", ":j_w0_0", ":j_c0_0"]
    assert found[0][1] == 5.0
    assert found[2][1] == 3.0


def test_beside_a_lane_it_is_the_nearest_one_and_farther_away_none() -> None:
    near, far = 1.0 + 0.9 * FOOT_LANE_MARGIN, 1.0 + 1.1 * FOOT_LANE_MARGIN
    assert at([SIDEWALK], (5.0, near), (5.0, far), (-0.9, 0.5), (-1.1, 0.5)) == [
        ("walk_0", 10.0),
        ("", 0.0),
        ("walk_0", 0.0),
        ("", 0.0),
    ]


def test_beyond_the_end_of_a_crossing_a_person_waits_on_the_walking_area() -> None:
    """SUMO's crossings begin beyond the kerb at round corners: 0.3 m from the crossing and 0.7 m from the outline."""
    crossing = replace(CROSSING, shape=np.array([(14.0, 3.0), (14.0, 12.0)]))
    assert at([crossing, AREA], (14.0, 2.7), (14.0, 3.3)) == [(":j_w0_0", 0.0), (":j_c0_0", pytest.approx(0.333333))]


def test_a_corner_that_netconvert_repeats_is_one() -> None:
    """A side without a length was at distance 0 from every place near its outline."""
    outline = foot_lane(":j_w0_0", [(0, 0), (0, 0), (10, 0), (0, 10)])
    assert at([outline], (8.0, 8.0), (2.0, 2.0)) == [("", 0.0), (":j_w0_0", 0.0)]


def test_lanes_for_vehicles_and_networks_without_any_for_persons_hold_none() -> None:
    street = replace(SIDEWALK, allowed=frozenset({"passenger"}))
    inside = replace(SIDEWALK, id=":j_0_0", internal=True)
    assert at([street, inside], (5.0, 0.0)) == [("", 0.0)]


def test_no_place_is_nowhere() -> None:
    lane, along = FootLanes([SIDEWALK]).at(np.zeros(0), np.zeros(0))
    assert (len(lane), len(along)) == (0, 0)


@pytest.mark.parametrize("scenario", ["intersection", "signalised"])
def test_sumos_own_persons_are_where_sumo_has_them(scenario: str) -> None:
    """Edges and positions of SUMO's FCD, of persons in both directions. Persons that stand exactly between a crossing
    and a walking area are on either."""
    rows: list[tuple[float, float, str, float]] = []
    with SumoSession(find_scenario(scenario), seed=1, step_length=0.4) as session:
        foot_lanes, person = FootLanes(session.network.lanes), libsumo.person
        for _ in range(400):
            session.step()
            rows += [
                (*person.getPosition(i), person.getRoadID(i), person.getLanePosition(i)) for i in person.getIDList()
            ]
    x, y, own, own_along = (np.array(column) for column in zip(*rows, strict=True))
    lane, along = foot_lanes.at(x, y)
    assert (lane >= 0).all()
    edge = np.array([foot_lanes.lanes[row].edge for row in lane])
    area = foot_lanes.area[lane]
    crossing = np.array([name.startswith(":") for name in edge]) & ~area
    assert area.sum() > 50
    assert crossing.sum() > 50
    # Measured: 0.992 and 0.987.
    assert (edge == own).mean() > 0.98
    ribbon = (edge == own) & ~area
    assert np.abs(along - own_along)[ribbon].max() < 0.01
