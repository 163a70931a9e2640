"""The lane that a vehicle changes to, as lines on which the other road users have positions.

Lanes may be curved, such as in a roundabout: on a ring of 25 m radius, a straight line misses vehicles more than 12 m
ahead or behind.
"""

from typing import NamedTuple

import numpy as np

from slrl_sumo.routing.polyline import Polyline
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState

FAR_SIGHT = 100.0
"""Distance (m) from a vehicle within which its lane changes consider other road users."""
BEYOND_END = 0.5
"""Distance (m) beyond an end of a line from which a road user is not on the line."""


class NextLane(NamedTuple):
    """The centre line of a lane beside a vehicle, and of the lanes that lead to it."""

    line: Polyline
    """The line from a point before the lane on, with the following lanes of the vehicle's route."""
    begin: float
    """Position (m along the line) at which the lane begins."""
    approaches: tuple[Polyline, ...] = ()
    """Lines that end at the begin of the lane."""


class LanePositions(NamedTuple):
    """Positions of all m road users of a world relative to one vehicle, along its next lane, (m,) each."""

    ahead: Floats
    """Distance (m) along the lane, between the centres; inf beyond FAR_SIGHT."""
    left: Floats
    """Distance (m) to the left of the vehicle; inf for road users beside no part of the lane."""
    direction: Floats
    """Direction (rad) of the lane at the road user."""


def lane_positions(lane: NextLane, world: WorldState, row: int) -> LanePositions:
    """Positions of the road users of a `world` relative to the one in a `row`."""
    x, y = world.x.item(row), world.y.item(row)
    near = np.flatnonzero(np.hypot(world.x - x, world.y - y) <= FAR_SIGHT)
    here, _ = lane.line.nearest(x, y)
    places = _places(lane, world.x[near], world.y[near], here + FAR_SIGHT)
    s, left, distance, direction = places
    own = np.searchsorted(near, row)
    beyond = np.sqrt(np.maximum(distance * distance - left * left, 0.0))
    positions = LanePositions(np.full(len(world), np.inf), np.full(len(world), np.inf), np.zeros(len(world)))
    positions.ahead[near] = s - s[own]
    positions.left[near] = np.where(beyond > BEYOND_END, np.inf, left - left[own])
    positions.direction[near] = direction
    return positions


def _places(lane: NextLane, x: Floats, y: Floats, end: float) -> Floats:
    """The places of positions on the lane, or on the lanes that lead to it, see `Polyline.places`."""
    places = lane.line.places(x, y, end)
    before = np.flatnonzero(places[0] <= lane.begin)
    if not len(before) or not lane.approaches:
        return places
    found = np.stack([line.places(x[before], y[before]) for line in lane.approaches])
    found[:, 0] += lane.begin - np.array([line.end for line in lane.approaches])[:, None]
    nearest = found[:, 2].argmin(axis=0)
    places[:, before] = found[nearest, :, np.arange(len(before))].T
    return places
