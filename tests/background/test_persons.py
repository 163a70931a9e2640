"""SUMO's persons stop before learned road users, and walk on as before afterwards."""

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
from builders import make_scenario, make_world

from slrl_sumo.background.persons import LONGEST_PERSON_WAIT
from slrl_sumo.background.yielding import Yielding
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.speed_control import HELD_SPEED_FACTOR

STEP = 0.4
PERSON = "walker"
USERS = """<vType id="p" vClass="pedestrian" speedDev="0.1"/>
    <person id="walker" type="p" depart="0" departPos="5"><walk edges="e" arrivalPos="95"/></person>"""


@pytest.fixture
def session(tmp_path: Path) -> Iterator[SumoSession]:
    nodes = '<node id="a" x="0" y="0"/><node id="b" x="100" y="0"/>'
    edges = '<edge id="e" from="a" to="b" sidewalkWidth="2"/>'
    with SumoSession(find_scenario(str(make_scenario(tmp_path, nodes, edges, USERS))), step_length=STEP) as session:
        for _ in range(5):
            session.step()
        yield session


def _walk(session: SumoSession, seconds: float, learned: WorldState | None = None) -> list[tuple[float, float]]:
    """Where the person is after each step; with `learned` before it, SUMO's road users yield to these."""
    yielding, places = Yielding(session.api, session.network, STEP), []
    for _ in range(round(seconds / STEP)):
        if learned is not None:
            yielding.apply(session.reader.read(), learned)
        session.step()
        places.append(session.api.person.getPosition(PERSON))
    return places


def _ahead(session: SumoSession, along: float, beside: float = 0.0, **columns: float) -> WorldState:
    """A learned road user so many m ahead of the person and to its left."""
    x, y = session.api.person.getPosition(PERSON)
    return make_world(x + along, y + beside, ids=("learned.0",), **columns)


def _nearest(places: list[tuple[float, float]], learned: WorldState) -> float:
    return min(math.dist(place, (learned.x.item(0), learned.y.item(0))) for place in places)


def _held(session: SumoSession) -> tuple[Yielding, WorldState]:
    """What holds the person, and the learned pedestrian before which it is held."""
    learned = _ahead(session, 1.0, type=RoadUserType.PEDESTRIAN)
    yielding = Yielding(session.api, session.network, STEP)
    for _ in range(3):
        yielding.apply(session.reader.read(), learned)
        session.step()
    assert yielding.held == {PERSON}
    return yielding, learned


def test_a_person_that_is_excluded_is_not_held(session: SumoSession) -> None:
    learned = _ahead(session, 1.0, type=RoadUserType.PEDESTRIAN)
    yielding = Yielding(session.api, session.network, STEP, [PERSON])
    for _ in range(3):
        yielding.apply(session.reader.read(), learned)
        session.step()
    assert yielding.held == frozenset()
    assert yielding.interventions == 0


def test_a_person_stops_before_one_that_stands_and_walks_on_after_a_while(session: SumoSession) -> None:
    factor = session.api.person.getSpeedFactor(PERSON)
    learned = _ahead(session, 4.0, type=RoadUserType.PEDESTRIAN)
    places = _walk(session, LONGEST_PERSON_WAIT + 20.0, learned)
    first, later = places[: round(LONGEST_PERSON_WAIT / STEP)], places[round(LONGEST_PERSON_WAIT / STEP) :]
    assert _nearest(first, learned) > 0.5
    # It waits near by.
    assert _nearest(first, learned) < 1.2
    assert math.dist(first[-1], first[-10]) < 0.5
    assert _nearest(later, learned) < 0.5
    assert later[-1][0] > learned.x[0] + 3.0
    assert session.api.person.getSpeedFactor(PERSON) == factor


def test_a_person_walks_through_it_otherwise(session: SumoSession) -> None:
    learned = _ahead(session, 4.0, type=RoadUserType.PEDESTRIAN)
    assert _nearest(_walk(session, LONGEST_PERSON_WAIT), learned) < 0.5


@pytest.mark.parametrize(
    ("kind", "along", "beside", "speed"),
    [
        (RoadUserType.PEDESTRIAN, 4.0, 0.8, 0.0),
        (RoadUserType.PEDESTRIAN, -0.4, 0.0, 0.0),
        (RoadUserType.CAR, 4.0, 2.0, 8.0),
        # It may wait for the person.
        (RoadUserType.CAR, 4.0, 0.0, 0.0),
    ],
    ids=["beside", "behind", "car beside", "car that stands"],
)
def test_others_do_not_hold_it(
    session: SumoSession, kind: RoadUserType, along: float, beside: float, speed: float
) -> None:
    learned = _ahead(session, along, beside, type=kind, speed=speed)
    yielding = Yielding(session.api, session.network, STEP)
    for _ in range(20):
        yielding.apply(session.reader.read(), learned)
        session.step()
    assert yielding.interventions == 0


def test_a_person_stops_before_a_car_that_moves(session: SumoSession) -> None:
    learned = _ahead(session, 4.5, type=RoadUserType.CAR, speed=2.0)
    places = _walk(session, 4.0, learned)
    assert places[-1][0] < learned.x[0] - 0.5 * learned.length[0] - 0.25
    assert math.dist(places[-1], places[-2]) < 0.001


def test_release_lets_it_walk_on(session: SumoSession) -> None:
    factor = session.api.person.getSpeedFactor(PERSON)
    yielding, learned = _held(session)
    assert session.api.person.getSpeedFactor(PERSON) == HELD_SPEED_FACTOR
    yielding.release((PERSON,))
    assert yielding.held == frozenset()
    assert session.api.person.getSpeedFactor(PERSON) == factor
    # As one of the learned road users it is not held.
    yielding.apply(session.reader.read(), learned.join(make_world(ids=(PERSON,), type=RoadUserType.PEDESTRIAN)))
    assert yielding.held == frozenset()


def test_a_held_person_that_has_gone_is_forgotten(session: SumoSession) -> None:
    yielding, learned = _held(session)
    session.api.person.remove(PERSON)
    session.step()
    yielding.apply(session.reader.read(), learned)
    assert yielding.held == frozenset()
    assert yielding.refusals.take() == {}
