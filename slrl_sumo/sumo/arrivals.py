"""Arrival positions of the scenario's vehicles on the last edge of their routes."""

from functools import cached_property

from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.scenario.loaded_files import ADDITIONAL, CONFIGURATION, ROUTES, arrival_positions


class Arrivals:
    """The `arrivalPos` of vehicles, read from SUMO's files on first use, because libsumo does not provide it."""

    def __init__(self, api: SumoApi) -> None:
        self._api = api

    def of(self, vehicle: str) -> float | None:
        """Position (m along the last lane, negative from its end); None for vehicles without one or with a random
        one."""
        positions = self._positions
        # Ids of vehicles of a flow end with a number.
        return positions.get(vehicle, positions.get(vehicle.rpartition(".")[0])) if positions else None

    @cached_property
    def _positions(self) -> dict[str, float]:
        return arrival_positions(
            *(self._api.simulation.getOption(name) for name in (ADDITIONAL, ROUTES, CONFIGURATION))
        )
