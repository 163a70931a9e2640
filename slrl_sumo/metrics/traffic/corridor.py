"""The busiest corridor of a scene, and the positions of road users along it."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.types import RoadUserType

PATH_END_CELL = 20.0
"""Side (m) of the squares of a grid: paths with the same begin square and the same end square belong together."""
CORRIDOR_SPACING = 1.0
"""Spacing (m) of the points of a corridor."""
MAX_LATERAL_OFFSET = 5.0
"""Distance (m) from the middle of a corridor within which a road user is in the corridor."""
MAX_HEADING_DIFFERENCE = np.radians(45.0)
"""Greatest angle (rad) between a heading and the direction of the corridor."""
SHORTEST_CORRIDOR = 20.0
"""Least length (m) of a corridor."""


@dataclass(frozen=True, eq=False)
class Corridor:
    """A path as points (k, 2), m, `CORRIDOR_SPACING` apart, with its direction at each, rad, (k,)."""

    points: Floats
    direction: Floats


def busiest(trajectories: Trajectories) -> Corridor | None:
    """The longest path between the two places with the greatest total distance travelled; None if all are short.

    Paths of vehicles count; without vehicles, paths of pedestrians.
    """
    t = trajectories
    walking = t.type == RoadUserType.PEDESTRIAN
    candidates = np.flatnonzero(walking if walking.all() else ~walking)
    travelled: Counter[tuple[int, ...]] = Counter()
    longest: dict[tuple[int, ...], tuple[float, int]] = {}
    for track in candidates.tolist():
        first, last = int(t.starts[track]), int(t.starts[track + 1]) - 1
        metres = float(np.hypot(np.diff(t.x[first : last + 1]), np.diff(t.y[first : last + 1])).sum())
        ends = np.array([t.x[first], t.y[first], t.x[last], t.y[last]])
        pair = tuple(np.floor(ends / PATH_END_CELL).astype(np.int64).tolist())
        travelled[pair] += round(metres)
        longest[pair] = max(longest.get(pair, (0.0, track)), (metres, track))
    if not travelled or longest[travelled.most_common(1)[0][0]][0] < SHORTEST_CORRIDOR:
        return None
    _, track = longest[travelled.most_common(1)[0][0]]
    rows = slice(int(t.starts[track]), int(t.starts[track + 1]))
    way = np.column_stack([t.x[rows], t.y[rows]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    places = np.arange(0.0, along[-1], CORRIDOR_SPACING)
    points = np.column_stack([np.interp(places, along, way[:, 0]), np.interp(places, along, way[:, 1])])
    ahead = np.gradient(points, axis=0)
    return Corridor(points, np.arctan2(ahead[:, 1], ahead[:, 0]))


def along(corridor: Corridor, trajectories: Trajectories) -> Floats:
    """Position (m along the corridor) of each row, (R,); nan outside the corridor and in other directions."""
    t = trajectories
    apart, nearest = cKDTree(corridor.points).query(np.column_stack([t.x, t.y]))
    turned = np.abs(wrap_angle(t.heading - corridor.direction[nearest]))
    dx, dy = t.x - corridor.points[nearest, 0], t.y - corridor.points[nearest, 1]
    beyond = dx * np.cos(corridor.direction[nearest]) + dy * np.sin(corridor.direction[nearest])
    # Before the begin and past the end, the nearest point is the first or the last point.
    inside = (apart < MAX_LATERAL_OFFSET) & (turned < MAX_HEADING_DIFFERENCE) & (np.abs(beyond) <= CORRIDOR_SPACING)
    return np.where(inside, nearest * CORRIDOR_SPACING + beyond, np.nan)
