"""Control of background road users: held vehicles and persons, and vehicles that pass others inside a junction."""

from collections.abc import Iterable

from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.refusals import Refusals

MAX_DECELERATION_BIT = 4
"""Bit of a speed mode: brake no harder than `decel` (https://sumo.dlr.de/docs/TraCI/Change_Vehicle_State.html)."""
DISREGARDS_INSIDE_BIT = 32
"""Bit of a speed mode: disregard the right of way of vehicles inside the junction."""


class SpeedControl:
    """Sets speeds and speed modes of vehicles, and returns the vehicles to SUMO with their former modes.

    `refusals`: vehicles for which SUMO has refused a call.
    """

    def __init__(self, api: SumoApi) -> None:
        self.refusals = Refusals()
        self._api = api
        self._own: dict[str, int] = {}
        """Former speed modes of vehicles that are held or pass others."""
        self._set: dict[str, int] = {}
        """Present speed modes that differ from the former ones."""
        self._hard: dict[str, bool] = {}
        """For each held vehicle, whether it may brake harder than `decel`."""
        self._passing: set[str] = set()

    @property
    def held(self) -> frozenset[str]:
        """Ids of the vehicles with a set speed."""
        return frozenset(self._hard)

    @property
    def passing(self) -> frozenset[str]:
        """Ids of the vehicles that pass other vehicles inside a junction."""
        return frozenset(self._passing)

    def hold(self, vehicle: str, speed: float, hard: bool) -> None:
        """Let a vehicle drive at `speed` (m/s) or slower from the next step on; `hard`: brake up to
        `emergencyDecel`."""
        with self.refusals.of(vehicle):
            self._hard[vehicle] = hard
            self._renew(vehicle)
            self._api.vehicle.setSpeed(vehicle, speed)

    def release(self, vehicles: Iterable[str]) -> None:
        """Return the speeds of the held vehicles among `vehicles` to SUMO."""
        releasing = [v for v in vehicles if v in self._hard]
        present = frozenset(self._api.vehicle.getIDList()) if releasing else frozenset()
        for vehicle in releasing:
            del self._hard[vehicle]
            if vehicle not in present:
                self.forget((vehicle,))
                continue
            with self.refusals.of(vehicle):
                self._api.vehicle.setSpeed(vehicle, -1.0)
                self._renew(vehicle)

    def let_pass(self, vehicles: Iterable[str]) -> None:
        """Let exactly these vehicles, all present, disregard the vehicles inside their junction."""
        wanted = set(vehicles)
        changed, self._passing = self._passing ^ wanted, wanted
        present = frozenset(self._api.vehicle.getIDList()) if changed - wanted else frozenset(wanted)
        for vehicle in changed:
            if vehicle not in present:
                self.forget((vehicle,))
                continue
            with self.refusals.of(vehicle):
                self._renew(vehicle)

    def forget(self, vehicles: Iterable[str]) -> None:
        """Drop vehicles without changing them in SUMO."""
        for vehicle in vehicles:
            for known in (self._own, self._set, self._hard):
                known.pop(vehicle, None)
            self._passing.discard(vehicle)

    def _renew(self, vehicle: str) -> None:
        """Set the speed mode of a vehicle according to its present state."""
        if vehicle not in self._own:
            self._own[vehicle] = self._api.vehicle.getSpeedMode(vehicle)
        own = mode = self._own[vehicle]
        if self._hard.get(vehicle):
            mode &= ~MAX_DECELERATION_BIT
        if vehicle in self._passing:
            mode |= DISREGARDS_INSIDE_BIT
        if mode != self._set.get(vehicle, own):
            self._api.vehicle.setSpeedMode(vehicle, mode)
        self._set[vehicle] = mode
        if vehicle not in self._hard and vehicle not in self._passing:
            self.forget((vehicle,))


HELD_SPEED_FACTOR = 0.001
"""Speed factor of held persons. With 0, SUMO 1.28 moves a person that stands on a walking area over the whole next edge
in one step, up to 115 m."""


class WalkControl:
    """Stops persons, and lets them walk on at their own speed; `refusals`: persons for which SUMO has refused a call.

    It uses the speed factor of persons, which, unlike the speed of a walk, can be read and restored. The factor has no
    effect on a walk with a `speed` in the scenario.
    """

    def __init__(self, api: SumoApi, refusals: Refusals) -> None:
        self._api, self._refusals = api, refusals
        self._factor: dict[str, float] = {}
        """Former speed factors of the held persons."""

    @property
    def held(self) -> frozenset[str]:
        """Ids of the held persons."""
        return frozenset(self._factor)

    def hold(self, persons: Iterable[str]) -> None:
        """Stop these persons from the next step on."""
        for person in sorted(set(persons) - self._factor.keys()):
            with self._refusals.of(person):
                self._factor[person] = self._api.person.getSpeedFactor(person)
                self._api.person.setSpeedFactor(person, HELD_SPEED_FACTOR)

    def release(self, persons: Iterable[str]) -> None:
        """Let the held persons among `persons` walk on."""
        releasing = self._factor.keys() & set(persons)
        present = frozenset(self._api.person.getIDList()) if releasing else frozenset()
        for person in sorted(releasing):
            factor = self._factor.pop(person)
            if person in present:
                with self._refusals.of(person):
                    self._api.person.setSpeedFactor(person, factor)
