"""Limits and permissions of lanes that change during a run, by variable speed signs, closings and scripts."""

from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network.lanes import ALL_CLASSES


def allowed_classes(api: SumoApi, lane: str) -> frozenset[str]:
    """The vehicle classes that may use a lane now; ALL_CLASSES if none is excluded."""
    allowed, disallowed = api.lane.getAllowed(lane), api.lane.getDisallowed(lane)
    # An empty list means "all" or "none", depending on the other list.
    return frozenset(allowed) if allowed or disallowed else ALL_CLASSES


class LaneState:
    """Limits of lanes, read once per SUMO step, and changes of permissions. Call `renew` after each step."""

    def __init__(self, api: SumoApi) -> None:
        self._api = api
        self._limits: dict[str, float] = {}
        self._disallowed: dict[str, tuple[str, ...]] = {}

    def renew(self) -> None:
        """Drop the limits of the last step."""
        self._limits.clear()

    def limit(self, lane: str) -> float:
        """Speed limit of a lane, m/s."""
        limit = self._limits.get(lane)
        if limit is None:
            limit = self._limits[lane] = self._api.lane.getMaxSpeed(lane)
        return limit

    def newly_allowed(self, lane: str) -> frozenset[str] | None:
        """The classes that may use a lane now; None if they have not changed since the last call for this lane."""
        disallowed = tuple(self._api.lane.getDisallowed(lane))
        if self._disallowed.get(lane) == disallowed:
            return None
        self._disallowed[lane] = disallowed
        return allowed_classes(self._api, lane)
