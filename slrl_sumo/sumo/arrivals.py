"""Where vehicles of the scenario end on the last edge of their routes."""

from functools import cached_property

from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.scenario.loaded_files import ADDITIONAL, CONFIGURATION, ROUTES, arrival_positions


class Arrivals:
    """The `arrivalPos` of vehicles, which libsumo does not tell; read from SUMO's files when it is first asked for."""

    def __init__(self, api: SumoApi) -> None:
        self._api = api

    def of(self, vehicle: str) -> float | None:
        """m along the last lane, below 0 from its end; None where a vehicle has none of its own, or a random one."""
        positions = self._positions
        # Vehicles of a flow have a number behind its id.
        return positions.get(vehicle, positions.get(vehicle.rpartition(".")[0])) if positions else None

    @cached_property
    def _positions(self) -> dict[str, float]:
        return arrival_positions(
            *(self._api.simulation.getOption(name) for name in (ADDITIONAL, ROUTES, CONFIGURATION))
        )
