"""Vehicles that SUMO drives, but not faster than set from outside."""

from collections.abc import Iterable

from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.refusals import Refusals

MAX_DECELERATION_BIT = 4
"""Of a speed mode: brake no harder than `decel` (https://sumo.dlr.de/docs/TraCI/Change_Vehicle_State.html)."""


class SpeedControl:
    """Sets speeds of vehicles and gives them back to SUMO with the speed modes that they had before.

    `refusals`: vehicles for which SUMO has refused a call.
    """

    def __init__(self, api: SumoApi) -> None:
        self.refusals = Refusals()
        self._api = api
        self._speed_modes: dict[str, int] = {}
        self._hard: set[str] = set()

    @property
    def held(self) -> frozenset[str]:
        """Ids of the vehicles with a set speed."""
        return frozenset(self._speed_modes)

    def hold(self, vehicle: str, speed: float, hard: bool) -> None:
        """Drive at `speed` (m/s) or slower from the next step on; `hard`: brake for that up to `emergencyDecel`."""
        with self.refusals.of(vehicle):
            if vehicle not in self._speed_modes:
                self._speed_modes[vehicle] = self._api.vehicle.getSpeedMode(vehicle)
            mode = self._speed_modes[vehicle]
            if hard and vehicle not in self._hard:
                self._api.vehicle.setSpeedMode(vehicle, mode & ~MAX_DECELERATION_BIT)
                self._hard.add(vehicle)
            elif not hard and vehicle in self._hard:
                self._api.vehicle.setSpeedMode(vehicle, mode)
                self._hard.discard(vehicle)
            self._api.vehicle.setSpeed(vehicle, speed)

    def release(self, vehicles: Iterable[str]) -> None:
        """Let SUMO choose the speed of those of `vehicles` that are held."""
        releasing = [v for v in vehicles if v in self._speed_modes]
        present = frozenset(self._api.vehicle.getIDList()) if releasing else frozenset()
        for vehicle in releasing:
            if vehicle in present:
                with self.refusals.of(vehicle):
                    self._api.vehicle.setSpeed(vehicle, -1.0)
                    if vehicle in self._hard:
                        self._api.vehicle.setSpeedMode(vehicle, self._speed_modes[vehicle])
        self.forget(releasing)

    def forget(self, vehicles: Iterable[str]) -> None:
        """Drop vehicles without changing them in SUMO."""
        for vehicle in vehicles:
            self._speed_modes.pop(vehicle, None)
            self._hard.discard(vehicle)
