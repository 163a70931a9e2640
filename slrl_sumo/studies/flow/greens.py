"""Times at which the signals of lanes turn green."""

from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network.links import signal_links, signal_states


class Greens:
    """Observes signals through `api`; call `update` after every SUMO step.

    `begins`: times (s) at which the light of a lane, by its id, turned green: SUMO's G for one of its links, with the
    right of way.
    """

    def __init__(self, api: SumoApi) -> None:
        self._api = api
        self._links: dict[str, list[tuple[str, int]]] = {}
        for link in signal_links(api):
            if not link.start.startswith(":"):
                self._links.setdefault(link.start, []).append((link.signal, link.link_index))
        self.begins: dict[str, list[float]] = {lane: [] for lane in self._links}
        self._green = self._shown()

    def update(self, now: float) -> None:
        """Look at all signals at `now`, s."""
        before, self._green = self._green, self._shown()
        for lane in self._green - before:
            self.begins[lane].append(now)

    def _shown(self) -> frozenset[str]:
        states = signal_states(self._api)
        return frozenset(
            lane for lane, links in self._links.items() if any(states[signal][k] == "G" for signal, k in links)
        )
