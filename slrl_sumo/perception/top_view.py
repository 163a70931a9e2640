"""A view of the scene from above, around one road user."""

import cv2
import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.picture import SURFACE_GREYS, TYPE_COLOURS
from slrl_sumo.ground.road_map import RoadMap, Surface
from slrl_sumo.scene.geometry import from_ego
from slrl_sumo.scene.state import WorldState

REACH = 32.0
"""Extent (m) to each side."""
SCALE = 8
"""Pixels per metre."""
SMALLEST = 1.0
"""Least drawn length and width (m) of boxes, so that pedestrians are visible."""
SHIFT = 4
"""Fractional bits of the coordinates given to OpenCV."""

GREYS = np.array([SURFACE_GREYS[surface] for surface in Surface], np.uint8)
COLOURS = np.array([[int(name[i : i + 2], 16) for i in (1, 3, 5)] for name in TYPE_COLOURS])
EDGE, RING = (70, 70, 70), (0, 0, 0)


def top_view(world: WorldState, row: int, roadmap: RoadMap) -> NDArray[np.uint8]:
    """The surroundings of road user `row` of `world`, (512, 512, 3) RGB, north up.

    Ground and types have the colours of the report of a run: learned road users in full colour, background road users
    paler. A ring marks the road user in the middle. Boxes have a pointed front.
    """
    x, y = world.x[row], world.y[row]
    middle, straight = np.array([x]), np.zeros(1)
    ground = roadmap.ego_surfaces(
        middle, np.array([y]), straight, behind=REACH, ahead=REACH, side=REACH, resolution=SCALE
    )
    picture = np.ascontiguousarray(GREYS[ground[0]])
    near = np.flatnonzero(np.maximum(np.abs(world.x - x), np.abs(world.y - y)) < REACH + world.length)
    for i in [*near[near != row].tolist(), row]:  # the ego is never hidden
        length, width = (max(float(side[i]), SMALLEST) for side in (world.length, world.width))
        front, left = 0.5 * length, 0.5 * width
        shoulder = front - 0.5 * width
        dx, dy = from_ego(
            np.array([-front, -front, shoulder, front, shoulder]),
            np.array([-left, left, left, 0.0, -left]),
            world.heading[i],
        )
        points = np.stack([world.x[i] + dx - x + REACH, REACH - (world.y[i] + dy - y)], axis=1)
        corners = np.rint((points * SCALE - 0.5) * (1 << SHIFT)).astype(np.int32)
        colour = COLOURS[world.type[i]] if world.learned[i] else (COLOURS[world.type[i]] + 2 * 255) // 3
        cv2.fillPoly(picture, [corners], colour.tolist(), cv2.LINE_AA, SHIFT)
        cv2.polylines(picture, [corners], True, EDGE, 1, cv2.LINE_AA, SHIFT)
    reach = 0.5 * float(np.hypot(world.length[row], world.width[row])) + 1.0
    centre = round((REACH * SCALE - 0.5) * (1 << SHIFT))
    cv2.circle(picture, (centre, centre), round(reach * SCALE * (1 << SHIFT)), RING, 2, cv2.LINE_AA, SHIFT)
    return picture
