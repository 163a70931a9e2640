"""The way that lies ahead of road users with a route, as plain arrays."""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.world.geometry import Floats, wrap_angle

Complexes = NDArray[np.complex128]

SPACING = 1.0
"""m between the points of a path."""
BEHIND, AHEAD = 8.0, 40.0
"""m of a path that are known behind and ahead of the road user's place on it."""
POINTS = 1 + round((BEHIND + AHEAD) / SPACING)
CHORD = 3
"""Points from one end to the other of the chords by which curves are measured: lanes are drawn with corners."""
HERE = round(BEHIND / SPACING)
"""Index of the point beside the road user."""


@dataclass(frozen=True, eq=False)
class RouteAhead:
    """Of n road users; where `known` is False there is no route, and the other entries mean nothing.

    Distances to what lies ahead are from the front of the box in m, inf where there is nothing within sight.
    """

    known: NDArray[np.bool_]
    x: Floats
    """Points every SPACING m of the own path, (n, POINTS), from BEHIND m behind to AHEAD m ahead of the centre."""
    y: Floats
    desired: Floats
    """m/s: what limits, here and further on, and the own wishes allow, (n,)."""
    stop: Floats
    """Line before which it has to stop: red, yellow in time, others go first, the end of a lane that leads astray."""
    line: Floats
    """The next line at which a junction or a signalised crossing begins."""
    out: Floats
    """Where that junction ends."""
    signal: NDArray[np.int8]
    """At that line: 0 none, 1 green, 2 yellow, 3 red."""
    closed: NDArray[np.bool_]
    """Whether its signal is red, or yellow in time to stop: the guard and the summary count these."""
    left: Floats
    """To the end of the route."""

    def __len__(self) -> int:
        return len(self.known)

    @cached_property
    def headings(self) -> Floats:
        """Direction of each path (rad) at each of its points, (n, POINTS)."""
        return np.asarray(np.arctan2(slopes(self.y), slopes(self.x)))

    def take(self, rows: NDArray[np.intp]) -> "RouteAhead":
        """The entries of the road users `rows`."""
        return RouteAhead(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    @classmethod
    def unknown(cls, n: int) -> Self:
        """n road users without a route."""
        return cls(
            known=np.zeros(n, np.bool_),
            x=np.zeros((n, POINTS)),
            y=np.zeros((n, POINTS)),
            desired=np.zeros(n),
            stop=np.full(n, np.inf),
            line=np.full(n, np.inf),
            out=np.full(n, np.inf),
            signal=np.zeros(n, np.int8),
            closed=np.zeros(n, np.bool_),
            left=np.full(n, np.inf),
        )


def slopes(points: Floats) -> Floats:
    """Change of coordinates (n, points) along each row; np.gradient, without its overhead."""
    change = np.empty_like(points)
    change[:, 1:-1] = 0.5 * (points[:, 2:] - points[:, :-2])
    change[:, 0], change[:, -1] = points[:, 1] - points[:, 0], points[:, -1] - points[:, -2]
    return change


def on_path(
    route: RouteAhead, x: Floats, y: Floats, rows: NDArray[np.intp] | None = None
) -> tuple[Floats, Floats, Floats]:
    """Where points (n, m), in m, lie beside the n paths: m along from the road user's place, m to the left, and the
    direction there (rad), (n, m) each. Beyond its ends a path goes straight on. With `rows` (n,) those paths are
    meant, else all."""
    path_x, path_y = (route.x, route.y) if rows is None else (route.x[rows], route.y[rows])
    nearest = np.clip(_nearest(path_x, path_y, x, y), 1, POINTS - 2)
    own = np.arange(len(route))[:, None] if rows is None else rows[:, None]
    # Of all paths laid end to end: the nearest points.
    points_x, points_y, nearest = route.x.ravel(), route.y.ravel(), nearest + own * POINTS
    # Two pieces meet at the nearest point: the one that the point lies beside.
    near_x, near_y = points_x[nearest], points_y[nearest]
    dx, dy = points_x[nearest + 1] - near_x, points_y[nearest + 1] - near_y
    begin = nearest - ~((x - near_x) * dx + (y - near_y) * dy > 0.0)
    x0, y0 = points_x[begin], points_y[begin]
    dx, dy = points_x[begin + 1] - x0, points_y[begin + 1] - y0
    length = np.maximum(np.hypot(dx, dy), 1e-6)
    along = ((x - x0) * dx + (y - y0) * dy) / length
    aside = (dx * (y - y0) - dy * (x - x0)) / length
    # Directions change from piece to piece: in between they are blended, so that curves have no corners.
    heading = route.headings.ravel()
    share = np.clip(along / length, 0.0, 1.0)
    before = heading[begin]
    turn = wrap_angle(heading[begin + 1] - before)
    return (begin - own * POINTS - HERE) * SPACING + along, aside, wrap_angle(before + share * turn)


def _nearest(path_x: Floats, path_y: Floats, x: Floats, y: Floats) -> NDArray[np.intp]:
    """Index of the point of each of n paths, (n, POINTS), that is nearest to points (n, m): (n, m).

    Seen from the road user's place, where single precision is good to 0.01 mm: of two points that are alike to that
    either will do, because the piece between them is what counts.
    """
    here_x, here_y = path_x[:, HERE, None], path_y[:, HERE, None]
    gap = (x - here_x).astype(np.float32)[:, :, None] - (path_x - here_x).astype(np.float32)[:, None]
    across = (y - here_y).astype(np.float32)[:, :, None] - (path_y - here_y).astype(np.float32)[:, None]
    gap *= gap
    across *= across
    gap += across
    return np.asarray(gap.argmin(axis=2), np.intp)


def at(route: RouteAhead, along: Floats) -> tuple[Floats, Floats, Floats]:
    """Positions (m) and directions (rad) `along` (n, m) metres from the road user's place on its path, (n, m) each."""
    place = along / SPACING + HERE
    begin = np.clip(np.floor(place).astype(np.intp), 0, POINTS - 2)
    share = place - begin
    begin += np.arange(len(route))[:, None] * POINTS
    # Of all paths laid end to end: from each point to the next one.
    points_x, points_y = route.x.ravel(), route.y.ravel()
    dx, dy = np.diff(points_x, append=0.0), np.diff(points_y, append=0.0)
    direction = np.arctan2(dy, dx)
    return points_x[begin] + share * dx[begin], points_y[begin] + share * dy[begin], direction[begin]


def curvature(route: RouteAhead) -> Floats:
    """How sharply the paths turn to the left, 1/m, (n, POINTS); 0 where the ends are too near."""
    return bend(route.x + 1j * route.y)


def bend(path: Complexes) -> Floats:
    """`curvature` of paths given as x + iy in m, (..., points)."""
    chord = path[..., CHORD:] - path[..., :-CHORD]
    length = np.abs(chord)
    turn = chord[..., CHORD:] * chord[..., :-CHORD].conj()
    middle = np.maximum(0.5 * (length[..., CHORD:] + length[..., :-CHORD]), 0.1)
    sharp = np.zeros(path.shape)
    sharp[..., CHORD:-CHORD] = np.arctan2(turn.imag, turn.real) / middle
    return sharp
