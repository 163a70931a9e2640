"""Paths ahead of background vehicles: centre lines along the lanes of their routes."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.network.links import LaneLinks

SPACING = 0.5
"""Spacing (m) of the points of a path."""
PATH_REACH = 120.0
"""Length (m) of a path beyond its first lane: enough to brake from 33 m/s."""
MOST_PATH_POINTS = 2_000_000
"""Greatest number of points of all stored paths (32 MB); beyond it, all paths are dropped and made again on demand."""
MOST_PATH_LANES = 40
"""Greatest number of lanes of a path, for very short lanes."""


class Paths:
    """Paths through a loaded network, made on demand and stored as numbered rows of a common array of points.

    A path is the centre line of a lane from its begin, and of the following lanes along a vehicle's route.
    """

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._lanes = {lane.id: lane for lane in network.lanes}
        self._links = LaneLinks(api, network)
        self.clear()

    def clear(self) -> None:
        """Drop all paths; all row numbers become invalid."""
        self._rows: dict[tuple[str, ...], int] = {}
        self._points, self._inside = np.zeros((4096, 2)), np.zeros(4096, np.bool_)
        self._used = 0
        self._table = np.zeros((256, 3))
        """For each row: index of its first and last point, and m of the shape per m of SUMO's lane length."""

    @property
    def full(self) -> bool:
        """Whether `clear` should be called."""
        return self._used > MOST_PATH_POINTS

    def row(self, lane: str, edges: tuple[str, ...], vehicle_class: str) -> int:
        """The row of the path from the begin of `lane` along the route `edges` after it, for a SUMO vehicle class."""
        chain = self.chain(lane, edges, vehicle_class)
        row = self._rows.get(chain)
        if row is None:
            row = self._rows[chain] = self._add(chain)
        return row

    def chain(self, lane: str, edges: tuple[str, ...], vehicle_class: str) -> tuple[str, ...]:
        """Ids of the lanes from `lane` on, including internal lanes, at most `PATH_REACH` m after the first lane.

        The chain ends with the route, or on a lane that does not continue to the route's next edge.
        """
        chain, remaining, length = [lane], list(edges), 0.0
        while length < PATH_REACH and len(chain) < MOST_PATH_LANES:
            here = chain[-1]
            choices = [
                (target, inside)
                for target, inside in self._links(here)
                if (remaining and self._lanes[target].edge == remaining[0])
                or (not remaining and self._lanes[here].internal)
            ]
            choices = [c for c in choices if vehicle_class in self._lanes[c[0]].allowed] or choices
            if not choices:
                break
            # Among several lanes of the next edge, vehicles take a lane that continues along the route.
            best = next((c for c in choices if len(remaining) > 1 and self._continues(c[0], remaining[1])), choices[0])
            chain.append(best[1] or best[0])
            if not self._lanes[chain[-1]].internal and remaining:
                remaining.pop(0)
            length += self._lanes[chain[-1]].length
        return tuple(chain)

    def sample(
        self, rows: NDArray[np.intp], lane_position: Floats, count: int
    ) -> tuple[Floats, Floats, NDArray[np.bool_], Floats]:
        """Points every `SPACING` m on n paths, beginning at `lane_position` (m along SUMO's lane, (n,)).

        Returns x, y in m and whether the point is inside a junction, (n, count) each, and the remaining length of each
        path in m, (n,). Beyond the end of a path, its last point is repeated.
        """
        table = self._table[rows]
        start, last, scale = table[:, 0].astype(np.intp), table[:, 1].astype(np.intp), table[:, 2]
        # A lane's length in SUMO may differ from that of its shape (attribute "length" of the network file).
        along = np.maximum(lane_position * scale / SPACING, 0.0)
        first = np.floor(along).astype(np.intp)
        share = (along - first)[:, None, None]
        index = (start + first)[:, None] + np.arange(count + 1)
        index = np.minimum(index, last[:, None])
        points, room = self._points[index], np.maximum((last - start - along) * SPACING, 0.0)
        points = points[:, :-1] + share * np.diff(points, axis=1)
        return points[..., 0], points[..., 1], self._inside[index[:, :-1]], room

    def _continues(self, lane: str, edge: str) -> bool:
        return any(self._lanes[target].edge == edge for target, _ in self._links(lane))

    def _add(self, chain: tuple[str, ...]) -> int:
        lanes = [self._lanes[lane] for lane in chain]
        points = resampled(np.concatenate([lane.shape for lane in lanes]), SPACING)
        while self._used + len(points) > len(self._points):
            self._points = np.concatenate([self._points, np.zeros_like(self._points)])
            self._inside = np.concatenate([self._inside, np.zeros_like(self._inside)])
        ends = np.cumsum([_length(lane) for lane in lanes])
        on = np.minimum(np.searchsorted(ends, SPACING * np.arange(len(points)), "right"), len(lanes) - 1)
        added = slice(self._used, self._used + len(points))
        self._points[added], self._inside[added] = points, np.array([lane.internal for lane in lanes])[on]
        row = len(self._rows)
        if row == len(self._table):
            self._table = np.concatenate([self._table, np.zeros_like(self._table)])
        scale = _length(lanes[0]) / max(lanes[0].length, 0.1)
        self._table[row] = self._used, self._used + len(points) - 1, scale
        self._used += len(points)
        return row


def _length(lane: Lane) -> float:
    return float(np.hypot(*np.diff(lane.shape, axis=0).T).sum())


def resampled(line: Floats, spacing: float) -> Floats:
    """Points every `spacing` m along the polyline `line` (k, 2), from its begin; a shorter remainder is cut off."""
    steps = np.diff(line, axis=0)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    s = np.arange(0.0, along[-1] + 1e-9, spacing)
    return np.column_stack([np.interp(s, along, line[:, 0]), np.interp(s, along, line[:, 1])])
