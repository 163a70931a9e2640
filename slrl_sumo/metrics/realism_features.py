"""Features of road users for the realism score, and the bins in which they are compared."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.metrics.conflicts import boxes, velocities
from slrl_sumo.metrics.neighbours import row_pairs
from slrl_sumo.metrics.road_edge import edge_distance
from slrl_sumo.metrics.surrogate_safety import box_distance, time_to_collision
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import STANDING_SPEED

LONGEST_TTC = 5.0
"""Greatest time to collision (s); longer times, and none, count as this value."""
FARTHEST_BOX = 40.0
"""Greatest distance (m) of a neighbour; larger distances, and none, count as this value."""
NEAREST_CENTRES = 6
"""Number of road users, the nearest by their centres, among which the nearest box is searched."""
ROWS_BEFORE_KNOWN = 2
"""Number of rows of a track before the first row with all features: a yaw acceleration needs three positions."""


@dataclass(frozen=True)
class Feature:
    """A feature with its weight, compared in `bins` bins from `low` to `high` in `unit`."""

    group: str
    """kinematic, interactive or map."""
    unit: str
    low: float
    high: float
    bins: int
    weight: float
    event: bool = False
    """Whether the feature is 1 for a window with an event at any moment, instead of a value of each moment."""


FEATURES: Mapping[str, Feature] = {
    "speed": Feature("kinematic", "m/s", 0.0, 25.0, 50, 0.10),
    "standing": Feature("kinematic", "1", 0.0, 1.0, 2, 0.10),
    "acceleration": Feature("kinematic", "m/s²", -12.0, 12.0, 49, 0.05),
    "yaw_rate": Feature("kinematic", "rad/s", -2.0, 2.0, 41, 0.05),
    "yaw_acceleration": Feature("kinematic", "rad/s²", -4.0, 4.0, 41, 0.05),
    "nearest": Feature("interactive", "m", -5.0, FARTHEST_BOX, 45, 0.15),
    "overlap": Feature("interactive", "1", 0.0, 1.0, 2, 0.15, event=True),
    "ttc": Feature("interactive", "s", 0.0, LONGEST_TTC, 10, 0.10),
    "road_edge": Feature("map", "m", -10.0, 10.0, 40, 0.10),
    "off_surface": Feature("map", "1", 0.0, 1.0, 2, 0.15, event=True),
}
"""Features of the challenge, and standing. Overlaps and leaving the surface have lower weights than in the challenge
(0.25 each): no more than speed and standing, so that traffic without encounters does not compensate unrealistic motion.
Bins are finer, because cyclists and pedestrians use only the lowest bins of the challenge."""


def features(
    trajectories: Trajectories, shapes: SurfaceShapes | None = None, rows: NDArray[np.intp] | None = None
) -> dict[str, Floats]:
    """The features of each row, (R,), by name, in the units of FEATURES; map features only with the ground, `shapes`.

    With `rows`, only these rows are computed, (len(rows),); all other rows still count as neighbours. Features are
    known from the row ROWS_BEFORE_KNOWN of a track on; earlier values are 0 or those of a neighbouring row.
    """
    t = trajectories
    rows = np.arange(len(t)) if rows is None else rows
    nearest = nearest_distance(t, rows)
    values = {
        "speed": t.speed[rows],
        "standing": (t.speed[rows] < STANDING_SPEED).astype(np.float64),
        "acceleration": t.acceleration[rows],
        "yaw_rate": t.yaw_rate[rows],
        "yaw_acceleration": (np.diff(t.yaw_rate, prepend=0.0) / t.dt)[rows],
        "nearest": nearest,
        "overlap": (nearest <= 0.0).astype(np.float64),
        "ttc": shortest_ttc(t)[rows],
    }
    if shapes is not None:
        edge = edge_distance(shapes=shapes, x=t.x[rows], y=t.y[rows], kind=t.type[t.track[rows]])
        values |= {"road_edge": edge, "off_surface": (edge > 0.0).astype(np.float64)}
    return values


def nearest_distance(trajectories: Trajectories, rows: NDArray[np.intp] | None = None) -> Floats:
    """Distance (m) between the boxes of each row, or of `rows`, and the nearest other road user at the time.

    At most FARTHEST_BOX; negative for an overlap.
    """
    t = trajectories
    rows = np.arange(len(t)) if rows is None else rows
    nearest = np.full(len(rows), FARTHEST_BOX)
    if not len(rows):
        return nearest
    box = boxes(t)
    apart = 4.0 * FARTHEST_BOX
    points = np.column_stack([t.x, t.y, (t.frame - t.frame.min()) * apart])
    count = min(NEAREST_CENTRES + 1, len(t))
    _, index = cKDTree(points).query(points[rows], k=count, distance_upper_bound=2.0 * FARTHEST_BOX)
    for column in np.asarray(index).reshape(len(rows), count).T:
        some = np.flatnonzero((column < len(t)) & (column != rows))
        nearest[some] = np.minimum(nearest[some], box_distance(a=box[rows[some]], b=box[column[some]]))
    return nearest


def shortest_ttc(trajectories: Trajectories) -> Floats:
    """Shortest time to collision with any road user, s, (R,), at most LONGEST_TTC."""
    t = trajectories
    box, velocity = boxes(t), velocities(t)
    shortest = np.full(len(t), LONGEST_TTC)
    reach = 0.5 * np.hypot(box[:, 3], box[:, 4]) + LONGEST_TTC * np.hypot(velocity[:, 0], velocity[:, 1])
    for i, j in row_pairs(x=t.x, y=t.y, frame=t.frame, reach=reach):
        ttc = time_to_collision(a=box[i], b=box[j], velocity_a=velocity[i], velocity_b=velocity[j])
        for rows in (i, j):
            np.minimum.at(shortest, rows, ttc)
    return shortest
