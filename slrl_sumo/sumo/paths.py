"""The ways that vehicles are about to drive: centre lines along lanes and routes, and the boxes swept on them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.sumo.network import Lane, Network
from slrl_sumo.world.geometry import Floats, cos_sin

SPACING = 0.5
"""m between the points of a path."""
REACH = 120.0
"""m that a path goes on beyond the end of its first lane: braking from 33 m/s takes no more."""
MOST_POINTS = 2_000_000
"""Paths kept at a time, counted in points (32 MB); beyond that they are forgotten and made again when needed."""
MOST_LANES = 40
"""Of a path, where they are very short."""
STRAIGHTENING = 15.0
"""m in which a vehicle that drives beside its lane's centre is expected to have come back to it, at the latest."""


class Paths:
    """Paths through a loaded network, made on demand and kept as numbered rows of one pool of points.

    A path is the centre line of a lane from its begin, then that of the lanes that a vehicle's route takes it to.
    """

    def __init__(self, api: Any, network: Network) -> None:
        self._api = api
        self._lanes = {lane.id: lane for lane in network.lanes}
        self._links: dict[str, list[tuple[str, str]]] = {}
        self.clear()

    def clear(self) -> None:
        """Forget all paths: the rows given so far are void."""
        self._rows: dict[tuple[str, ...], int] = {}
        self._points = np.zeros((4096, 2))
        self._used = 0
        self._start: list[int] = []
        self._end: list[int] = []
        self._scale: list[float] = []

    @property
    def full(self) -> bool:
        """Whether it is time to `clear`."""
        return self._used > MOST_POINTS

    def row(self, lane: str, following: tuple[str, ...], vehicle_class: str) -> int:
        """The path from the begin of `lane` to the edges `following`, for a SUMO vehicle class."""
        chain = self.chain(lane, following, vehicle_class)
        row = self._rows.get(chain)
        if row is None:
            row = self._rows[chain] = self._add(chain)
        return row

    def chain(self, lane: str, following: tuple[str, ...], vehicle_class: str) -> tuple[str, ...]:
        """Ids of the lanes from `lane` on, those inside junctions included, at most `REACH` m of them after the first.

        It ends where the route does, and on a lane that does not lead to the route's next edge.
        """
        chain, onward, length = [lane], list(following), 0.0
        while length < REACH and len(chain) < MOST_LANES:
            here = chain[-1]
            choices = [
                (target, inside)
                for target, inside in self._links_of(here)
                if (onward and self._lanes[target].edge == onward[0]) or (not onward and self._lanes[here].internal)
            ]
            choices = [c for c in choices if vehicle_class in self._lanes[c[0]].allowed] or choices
            if not choices:
                break
            # Of several lanes of the next edge, vehicles take one that leads on.
            best = next((c for c in choices if len(onward) > 1 and self._leads(c[0], onward[1])), choices[0])
            chain.append(best[1] or best[0])
            if not self._lanes[chain[-1]].internal and onward:
                onward.pop(0)
            length += self._lanes[chain[-1]].length
        return tuple(chain)

    def sample(self, rows: NDArray[np.intp], lane_position: Floats, count: int) -> tuple[Floats, Floats, Floats]:
        """Points every `SPACING` m on n paths, the first ones at `lane_position` (m, SUMO's measure, (n,)).

        Returns x, y in m, (n, count), and how far the paths go on, in m, (n,); past a path's end its last point recurs.
        """
        start, last = np.array(self._start)[rows], np.array(self._end)[rows] - 1
        # A lane's length in SUMO may differ from that of its drawn shape (attribute "length" of the net).
        along = np.maximum(lane_position * np.array(self._scale)[rows] / SPACING, 0.0)
        first = np.floor(along).astype(np.intp)
        share = (along - first)[:, None, None]
        index = (start + first)[:, None] + np.arange(count + 1)
        points = self._points[np.minimum(index, last[:, None])]
        points = points[:, :-1] + share * np.diff(points, axis=1)
        return points[..., 0], points[..., 1], np.maximum((last - start - along) * SPACING, 0.0)

    def _links_of(self, lane: str) -> list[tuple[str, str]]:
        """Pairs of lane ids: the lane led to, and the one inside the junction that comes before it ('' for none)."""
        links = self._links.get(lane)
        if links is None:
            links = self._links[lane] = [
                (link[0], link[4]) for link in self._api.lane.getLinks(lane) if link[0] in self._lanes
            ]
        return links

    def _leads(self, lane: str, edge: str) -> bool:
        return any(self._lanes[target].edge == edge for target, _ in self._links_of(lane))

    def _add(self, chain: tuple[str, ...]) -> int:
        lanes = [self._lanes[lane] for lane in chain]
        points = resampled(np.concatenate([lane.shape for lane in lanes]), SPACING)
        while self._used + len(points) > len(self._points):
            self._points = np.concatenate([self._points, np.zeros_like(self._points)])
        self._points[self._used : self._used + len(points)] = points
        self._start.append(self._used)
        self._used += len(points)
        self._end.append(self._used)
        self._scale.append(_length(lanes[0]) / max(lanes[0].length, 0.1))
        return len(self._start) - 1


def _length(lane: Lane) -> float:
    return float(np.hypot(*np.diff(lane.shape, axis=0).T).sum())


def resampled(line: Floats, spacing: float) -> Floats:
    """Points every `spacing` m along the polyline `line` (k, 2), from its begin; the rest at its end is cut."""
    steps = np.diff(line, axis=0)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    s = np.arange(0.0, along[-1] + 1e-9, spacing)
    return np.column_stack([np.interp(s, along, line[:, 0]), np.interp(s, along, line[:, 1])])


@dataclass(frozen=True)
class Sweep:
    """Boxes of n vehicles at k places ahead, `SPACING` m apart, the first where they are now; arrays (n, k)."""

    x: Floats
    y: Floats
    heading: Floats
    width: Floats
    """m; wider than the vehicle where it is not known how far beside the lane's centre it will drive."""
    length: Floats
    """m, (n,)."""
    valid: NDArray[np.bool_]
    """False past the end of a path."""


def sweep(
    path_x: Floats, path_y: Floats, room: Floats, front_x: Floats, front_y: Floats, heading: Floats, size: Floats
) -> Sweep:
    """The boxes that vehicles sweep on their paths.

    `path_x`, `path_y`: points ahead, (n, k), the first beside the front; `room`: m to the path's end, (n,);
    `front_x`, `front_y`, `heading`: the middle of the front edge and the direction now, (n,); `size`: rows of length
    and width, (n, 2). Fronts follow the path, rears follow the fronts: long vehicles cut corners, as SUMO draws them.
    """
    k = path_x.shape[1]
    s = SPACING * np.arange(k)
    direction_x, direction_y = cos_sin(heading)
    along_x, along_y = np.gradient(path_x, axis=1), np.gradient(path_y, axis=1)
    norm = np.maximum(np.hypot(along_x, along_y), 1e-9)
    along_x, along_y = along_x / norm, along_y / norm
    # Against its lane (overtaking on the opposite side, or a path of one point): straight on is the better guess.
    astray = along_x[:, 0] * direction_x + along_y[:, 0] * direction_y < 0.5
    path_x = np.where(astray[:, None], front_x[:, None] + s * direction_x[:, None], path_x)
    path_y = np.where(astray[:, None], front_y[:, None] + s * direction_y[:, None], path_y)
    along_x = np.where(astray[:, None], direction_x[:, None], along_x)
    along_y = np.where(astray[:, None], direction_y[:, None], along_y)

    beside = (front_y - path_y[:, 0]) * along_x[:, 0] - (front_x - path_x[:, 0]) * along_y[:, 0]
    kept = np.maximum(1.0 - s / STRAIGHTENING, 0.0)
    # Between staying beside the centre and coming back to it: the box covers both.
    lateral = beside[:, None] * (1.0 + kept) / 2.0
    width = size[:, 1:] + np.abs(beside)[:, None] * (1.0 - kept)
    fronts_x, fronts_y = path_x - lateral * along_y, path_y + lateral * along_x

    length = size[:, 0]
    before = np.arange(k) - np.rint(length / SPACING).astype(np.intp)[:, None]
    back = np.maximum(before, 0)
    still_behind = np.maximum(length[:, None] - s, 0.0)
    rear_x = np.where(
        before >= 0, np.take_along_axis(fronts_x, back, 1), front_x[:, None] - still_behind * direction_x[:, None]
    )
    rear_y = np.where(
        before >= 0, np.take_along_axis(fronts_y, back, 1), front_y[:, None] - still_behind * direction_y[:, None]
    )
    turned = np.arctan2(fronts_y - rear_y, fronts_x - rear_x)
    half, (turned_x, turned_y) = 0.5 * length[:, None], cos_sin(turned)
    return Sweep(
        x=fronts_x - half * turned_x,
        y=fronts_y - half * turned_y,
        heading=turned,
        width=width,
        length=length,
        valid=(s <= room[:, None] + 1e-9) | astray[:, None] | (s == 0.0),
    )
