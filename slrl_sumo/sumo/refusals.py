"""Calls that SUMO refuses for one road user: it loses its turn, and the run goes on.

All calls for single road users that learned models move, or that are held back for them, are made inside
`Refusals.of`. SUMO refuses them where a person rides or is in an <access> stage, and where a user's script or SUMO
itself has removed the road user.
"""

from types import TracebackType
from typing import Self


class Refusals:
    """Collects road users for which SUMO has refused a call.

        with refusals.of(road_user):
            api.vehicle.setSpeed(road_user, 3.0)

    A refusal ends the block, and is kept with SUMO's reason until `take`. Other errors, such as a closed simulation,
    come through.
    """

    def __init__(self) -> None:
        self._reasons: dict[str, str] = {}
        self._road_user = ""

    def of(self, road_user: str) -> Self:
        """For a with statement around the calls for one road user; such blocks are not nested."""
        self._road_user = road_user
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if error is None or not is_refusal(error):
            return False
        self.add(self._road_user, " ".join(str(error).split()))
        return True

    def add(self, road_user: str, reason: str) -> None:
        """Do not make calls for a road user, although SUMO would not refuse them."""
        self._reasons.setdefault(road_user, reason)

    def take(self) -> dict[str, str]:
        """SUMO's first reason for each road user since the last call."""
        reasons, self._reasons = self._reasons, {}
        return reasons


def is_refusal(error: BaseException) -> bool:
    """Whether SUMO has refused a call, and the simulation goes on."""
    return _is_a(error, "TraCIException")


def is_end(error: BaseException) -> bool:
    """Whether the simulation has ended: it was closed, or the connection to it is lost."""
    return _is_a(error, "FatalTraCIError")


def _is_a(error: BaseException, name: str) -> bool:
    # libsumo and traci have classes of these names each, and neither is imported for a simulation of the other. Where
    # both are imported, traci.exceptions names libsumo's class, but a TraCI connection raises traci's.
    return any(
        base.__name__ == name and base.__module__.partition(".")[0] in ("libsumo", "traci")
        for base in type(error).__mro__
    )
