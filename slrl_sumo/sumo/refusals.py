"""Calls that SUMO refuses for a single road user: the calls for it are skipped, and the run continues.

All calls for single road users that learned models move, or that are held back for them, are made inside
`Refusals.of`, or, in loops over all of them, followed by `Refusals.catch`. SUMO refuses calls for a person that rides
or is in an <access> stage, and for road users that a user's script or SUMO has removed.
"""

from types import TracebackType
from typing import Self


class Refusals:
    """Collects road users for which SUMO has refused a call.

        with refusals.of(road_user):
            api.vehicle.setSpeed(road_user, 3.0)

    A refusal ends the block and is stored with SUMO's reason until `take`. Other errors, such as of a closed
    simulation, are raised.
    """

    def __init__(self) -> None:
        self._reasons: dict[str, str] = {}
        self._road_user = ""

    def of(self, road_user: str) -> Self:
        """Context manager for the calls for one road user; such blocks must not be nested."""
        self._road_user = road_user
        return self

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if error is None or not is_refusal(error):
            return False
        self._store(self._road_user, error)
        return True

    def catch(self, road_user: str, error: Exception) -> None:
        """Store the refusal `error` of a call for a road user; raise it again if it is another error.

        For `except` in a loop over all road users, which costs nothing where SUMO does not refuse, while `of` takes
        longer than a call of SUMO.
        """
        if not is_refusal(error):
            raise error
        self._store(road_user, error)

    def _store(self, road_user: str, error: BaseException) -> None:
        self.add(road_user, " ".join(str(error).split()))

    def add(self, road_user: str, reason: str) -> None:
        """Add a road user for which no calls are made, although SUMO would not refuse them."""
        self._reasons.setdefault(road_user, reason)

    def take(self) -> dict[str, str]:
        """SUMO's first reason for each road user since the last call."""
        reasons, self._reasons = self._reasons, {}
        return reasons


def is_refusal(error: BaseException) -> bool:
    """Whether an error is a call that SUMO refused, so that the simulation continues."""
    return _is_a(error, "TraCIException")


def is_end(error: BaseException) -> bool:
    """Whether an error means the end of the simulation: it was closed, or the connection is lost."""
    return _is_a(error, "FatalTraCIError")


def _is_a(error: BaseException, name: str) -> bool:
    # libsumo and traci have separate classes of these names, and a simulation of one does not import the other. If both
    # are imported, traci.exceptions refers to libsumo's class, but a TraCI connection raises traci's class.
    return any(
        base.__name__ == name and base.__module__.partition(".")[0] in ("libsumo", "traci")
        for base in type(error).__mro__
    )
