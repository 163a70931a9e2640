"""Links: the connections of lanes through junctions, with priority and signals."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from slrl_sumo.formats.signal_states import SignalState
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network


class Link(NamedTuple):
    """The connection of a lane to a following lane, in its state of SUMO's last step."""

    target: str
    """The lane after the junction, or after an internal lane."""
    via: str
    """The internal lane before the target; '' without one."""
    has_priority: bool
    is_open: bool
    """SUMO would let a vehicle enter now."""
    state: str
    """SUMO's letter for the signal or the right of way (https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html)."""


LinksOf = Callable[[str], Sequence[tuple[str, str]]]
"""The links from a lane, by its id: pairs of target and via, as `LaneLinks` gives them."""


class SignalLink(NamedTuple):
    """A link that a traffic light controls."""

    signal: str
    """Id of the traffic light."""
    link_index: int
    """Index of its letter in the state of the traffic light."""
    start: str
    """The lane before the junction."""
    target: str
    """The lane after the junction."""
    via: str
    """The internal lane between them; '' without one."""


def read_links(api: SumoApi, lane: str) -> list[Link]:
    """The links from a lane."""
    return [Link(link[0], link[4], link[1], link[2], link[5]) for link in api.lane.getLinks(lane)]


def signal_links(api: SumoApi) -> list[SignalLink]:
    """All links that traffic lights control."""
    return [
        SignalLink(signal, index, start, target, via)
        for signal in api.trafficlight.getIDList()
        for index, links in enumerate(api.trafficlight.getControlledLinks(signal))
        for start, target, via in links
    ]


def signal_states(api: SumoApi) -> dict[str, str]:
    """The present state of each traffic light: one letter per link."""
    return {signal: api.trafficlight.getRedYellowGreenState(signal) for signal in api.trafficlight.getIDList()}


class SignalChanges:
    """States of traffic lights that have changed since the last call."""

    def __init__(self, api: SumoApi) -> None:
        self._api = api
        self._shown: dict[str, str] = {}

    def __call__(self) -> tuple[SignalState, ...]:
        """The new states; all states in the first call."""
        shown, lights = signal_states(self._api), self._api.trafficlight
        new = [(signal, state) for signal, state in shown.items() if self._shown.get(signal) != state]
        self._shown = shown
        return tuple(SignalState(id_, lights.getProgram(id_), lights.getPhase(id_), state) for id_, state in new)


def signal_programs(api: SumoApi, signal: str) -> list[list[tuple[str, float]]]:
    """The programs of a traffic light: the state and the duration (s) of each of their phases."""
    programs = api.trafficlight.getAllProgramLogics(signal)
    return [[(phase.state, phase.duration) for phase in program.phases] for program in programs]


class ShownLinks:
    """The links from lanes in the present states of traffic lights; `is_open` is not current.

    Call `renew` after each step. The links of a lane are read once for each state of its traffic lights, because
    nothing else changes them.
    """

    def __init__(self, api: SumoApi) -> None:
        self._api = api
        self._lights: dict[str, tuple[str, ...]] = {}
        for link in signal_links(api):
            self._lights[link.start] = tuple(dict.fromkeys((*self._lights.get(link.start, ()), link.signal)))
        self._shown: dict[str, str] = {}
        self._links: dict[tuple[str, ...], dict[tuple[str, str], Link]] = {}

    def renew(self) -> None:
        """Drop the states of the traffic lights."""
        self._shown.clear()

    def __call__(self, lane: str) -> Mapping[tuple[str, str], Link]:
        """The links from a lane by target and via."""
        key = (lane, *map(self._state, self._lights.get(lane, ())))
        links = self._links.get(key)
        if links is None:
            links = self._links[key] = {(link.target, link.via): link for link in read_links(self._api, lane)}
        return links

    def _state(self, light: str) -> str:
        if light not in self._shown:
            self._shown[light] = self._api.trafficlight.getRedYellowGreenState(light)
        return self._shown[light]


def foe_lanes(api: SumoApi, lane: str, target: str) -> tuple[str, ...]:
    """The lanes outside the junction from which vehicles have priority over the link from `lane` to `target`."""
    return tuple(foe for foe in dict.fromkeys(api.lane.getFoes(lane, target)) if not foe.startswith(":"))


def internal_foe_lanes(api: SumoApi, via: str) -> tuple[str, ...]:
    """The internal lanes that cross the internal lane `via`."""
    return tuple(api.lane.getInternalFoes(via))


def internal_lanes(via: str, links: LinksOf) -> list[str]:
    """The internal lanes of a way through a junction that begins with `via`; none for ''."""
    lanes: list[str] = []
    while via and via not in lanes:
        lanes.append(via)
        via = next((inner for _, inner in links(via)), "")
    return lanes


class LaneLinks:
    """The pairs of target and via of all links between known lanes, read once per lane: they never change."""

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._api = api
        self._known = frozenset(lane.id for lane in network.lanes)
        self._links: dict[str, list[tuple[str, str]]] = {}

    def __call__(self, lane: str) -> list[tuple[str, str]]:
        """Pairs of lane ids: the following lane, and the internal lane before it ('' without one).

        A lane that is not in the network, such as a bent one (`routing.junctions.bent_lane`), has none.
        """
        links = self._links.get(lane)
        if links is None:
            found = self._api.lane.getLinks(lane) if lane in self._known else ()
            links = self._links[lane] = [(link[0], link[4]) for link in found if link[0] in self._known]
        return links
