"""Signals that vehicles cannot obey, because yellow is too short to stop or to pass."""

from collections.abc import Iterator, Sequence

from slrl_sumo.doctor.finding import Finding, counted
from slrl_sumo.routing.lane_path import STOP_LINE
from slrl_sumo.routing.speed_limits import STOPS_WITH
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.links import signal_links, signal_programs

USUAL_DECELERATION = 4.5
"""m/s² of SUMO's usual car."""


def signal_findings(api: SumoApi, network: Network) -> Iterator[Finding]:
    """Signals with a yellow phase too short for the speed limit before them, in an open simulation."""
    limits = {lane.id: lane.max_speed for lane in network.lanes}
    links = signal_links(api)
    shortest = {signal: _shortest_yellow(api, signal) for signal in {link.signal for link in links}}
    short: dict[str, tuple[float, float, float]] = {}
    for link in links:
        yellow = shortest[link.signal].get(link.link_index)
        speed = limits.get(link.start, 0.0)
        if yellow is None or link.start.startswith(":") or yellow >= needed_yellow(speed):
            continue
        missing = needed_yellow(speed) - yellow
        short[link.signal] = max(short.get(link.signal, (0.0, 0.0, 0.0)), (missing, yellow, speed))
    if short:
        signal, (_, yellow, speed) = max(short.items(), key=lambda item: item[1])
        yield Finding(
            "warning",
            "yellow",
            f"{counted(len(short), 'signal shows', 'signals show')} yellow for less time than vehicles need that are "
            f"too near to stop (worst: {signal}, {yellow:g} s where {speed:g} m/s are allowed): learned vehicles brake "
            "as people do and cross at red there, SUMO's brake as hard as they must",
            f"give it {needed_yellow(speed):.1f} s or more (usual: 3 s at 50 km/h, 4 s at 60, 5 s at 70), or lower the "
            "speed limit",
        )


def needed_yellow(speed: float) -> float:
    """s of yellow after which a vehicle at `speed` (m/s) that could not stop has passed the line."""
    if speed <= 0.0:
        return 0.0
    return (speed * speed / (2.0 * STOPS_WITH * USUAL_DECELERATION) + STOP_LINE) / speed + DECISION_INTERVAL


def _shortest_yellow(api: SumoApi, signal: str) -> dict[int, float]:
    """s of the shortest yellow between green and red of each link of a signal, over all its programs."""
    shortest: dict[int, float] = {}
    for phases in signal_programs(api, signal):
        for link in range(min((len(state) for state, _ in phases), default=0)):
            for seconds in _yellows([state[link] for state, _ in phases], [duration for _, duration in phases]):
                shortest[link] = min(shortest.get(link, seconds), seconds)
    return shortest


def _yellows(letters: Sequence[str], seconds: Sequence[float]) -> Iterator[float]:
    """s between each green and the red after it, of one link in a program that repeats."""
    n = len(letters)
    for k in range(n):
        if letters[k] not in "gG":
            continue
        at, total = (k + 1) % n, 0.0
        while at != k and letters[at] in "yY":
            total += seconds[at]
            at = (at + 1) % n
        if letters[at] in "ru":
            yield total
