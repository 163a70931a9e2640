"""Speeds and speed modes of vehicles that SUMO drives, and that they are given back as they were."""

from collections.abc import Iterator

import libsumo
import pytest

from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.speed_control import DISREGARDS_INSIDE_BIT, MAX_DECELERATION_BIT, SpeedControl

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
