"""Positions of signals on the replay page: bars across lanes at stop lines, and at both ends of crossings."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from slrl_sumo.formats.signal_states import Shown
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.network import Network, is_crossing
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.network.links import SignalLink

BEHIND = 0.5
"""Distance (m) of a bar from the end of its lane; SUMO's vehicles stop about 1 m before the end."""


def signal_bars(network: Network, links: Sequence[SignalLink], shown: Shown) -> list[dict[str, Any]]:
    """The traffic lights of `shown` that are in the network, as the page reads them: id, times (ms, each less the one
    before), states, and bars [index of the letter, x, y, x, y of its ends in cm]."""
    lanes = {lane.id: lane for lane in network.lanes}
    bars: dict[str, list[list[int]]] = {}
    for signal, link, ends in _bars(lanes, links):
        bars.setdefault(signal, []).append([link, *np.rint(100 * ends).astype(np.int64).ravel().tolist()])
    return [
        {"id": signal, "times": np.diff(times, prepend=0).tolist(), "states": states, "bars": bars[signal]}
        for signal, (times, states) in shown.items()
        if signal in bars
    ]


def _bars(lanes: dict[str, Lane], links: Sequence[SignalLink]) -> Iterator[tuple[str, int, Floats]]:
    """Traffic light, index of its letter, and both ends (2, 2) of each bar."""
    of_lane: dict[tuple[str, str], set[int]] = {}
    for link in links:
        if is_crossing(link.target) and link.target in lanes:
            crossing = lanes[link.target]
            for shape in (crossing.shape, crossing.shape[::-1]):
                yield link.signal, link.link_index, _across(shape, crossing.width, 0.0, np.array([0.0, 1.0]))
        elif link.start in lanes:
            of_lane.setdefault((link.signal, link.start), set()).add(link.link_index)
    for (signal, start), indices in of_lane.items():
        # netconvert numbers the links of a lane from right to left.
        edges = np.linspace(0.0, 1.0, len(indices) + 1)
        lane = lanes[start]
        for number, index in enumerate(sorted(indices)):
            yield signal, index, _across(lane.shape, lane.width, BEHIND, edges[number : number + 2])


def _across(shape: Floats, width: float, behind: float, shares: Floats) -> Floats:
    """Points (2, 2) across the end of a lane, `behind` m before it; `shares`: of its width, from the right."""
    along = shape[-1] - shape[-2]
    along = along / max(float(np.hypot(*along)), 1e-9)
    left = np.array([-along[1], along[0]])
    return np.asarray(shape[-1] - behind * along + np.outer(width * (shares - 0.5), left))
