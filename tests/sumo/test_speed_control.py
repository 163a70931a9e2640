"""Speeds and speed modes of vehicles that SUMO drives, and that they are given back as they were."""

import math
from collections.abc import Iterator

import libsumo
import pytest

from slrl_sumo.sumo.network import is_walking_area
from slrl_sumo.sumo.refusals import Refusals
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.speed_control import (
    DISREGARDS_INSIDE_BIT,
    MAX_DECELERATION_BIT,
    SpeedControl,
    WalkControl,
)

OWN = 23


@pytest.fixture
def car() -> Iterator[str]:
    with SumoSession(find_scenario("intersection"), seed=1) as session:
        while not libsumo.vehicle.getIDList():
            session.step()
        name = str(libsumo.vehicle.getIDList()[0])
        libsumo.vehicle.setSpeedMode(name, OWN)
        yield name


def mode(car: str) -> int:
    return int(libsumo.vehicle.getSpeedMode(car))


def test_a_vehicle_has_its_own_mode_when_it_is_neither_held_nor_passes_others(car: str) -> None:
    control = SpeedControl(libsumo)
    control.hold(car, 2.0, hard=True)
    assert mode(car) == OWN & ~MAX_DECELERATION_BIT
    control.let_pass([car])
    assert mode(car) == OWN & ~MAX_DECELERATION_BIT | DISREGARDS_INSIDE_BIT
    control.hold(car, 3.0, hard=False)
    assert mode(car) == OWN | DISREGARDS_INSIDE_BIT
    control.release([car])
    assert (control.held, control.passing) == (frozenset(), {car})
    assert mode(car) == OWN | DISREGARDS_INSIDE_BIT
    control.let_pass([])
    assert (control.passing, mode(car)) == (frozenset(), OWN)
    # A mode that is set meanwhile is the next one to be given back.
    libsumo.vehicle.setSpeedMode(car, 31)
    control.let_pass([car])
    control.let_pass([])
    assert mode(car) == 31


def test_vehicles_that_have_gone_are_forgotten(car: str) -> None:
    control = SpeedControl(libsumo)
    control.hold(car, 2.0, hard=True)
    control.let_pass([car])
    libsumo.vehicle.remove(car)
    control.release([car])
    control.let_pass([])
    assert not control.held
    assert not control.passing
    assert not control.refusals.take()


def test_persons_held_on_walking_areas_stay_there() -> None:
    """With a speed factor of 0, SUMO moved six of these over a whole edge in one step."""
    with SumoSession(find_scenario("intersection"), seed=1, step_length=0.2) as session:
        control, held, farthest = WalkControl(libsumo, Refusals()), 0, 0.0
        while session.time < 290.0:
            control.hold(p for p in libsumo.person.getIDList() if is_walking_area(libsumo.person.getLaneID(p)))
            held += len(control.held)
            for interval in range(15):
                if interval == 5:
                    control.release(control.held)
                before = {person: libsumo.person.getPosition(person) for person in libsumo.person.getIDList()}
                session.step()
                now = {person: libsumo.person.getPosition(person) for person in libsumo.person.getIDList()}
                moved = [math.dist(before[person], now[person]) for person in before.keys() & now.keys()]
                farthest = max([farthest, *moved])
        assert held > 20
        assert farthest < 3.0
