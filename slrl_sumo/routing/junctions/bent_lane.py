"""Internal lanes that are bent to another lane of the edge after the junction.

Where an edge is too short for a lane change, a road user enters it on the lane that its route needs. Networks imported
from OpenStreetMap have edges of 0.2 to 13 m between junctions, on which SUMO's vehicles, which change lanes within one
step, cross up to three lanes.
"""

import math
from dataclasses import replace

import numpy as np

from slrl_sumo.routing.polyline import line_through
from slrl_sumo.sumo.network.lanes import Lane, lane_index

STEEPEST = 1.0
"""Greatest lateral shift, as a share of the length of the internal lane: 45 degrees on average."""
BENT = ">"
"""Between the id of an internal lane and the index of the lane to which it is bent."""
SPACING = 1.0
"""Distance (m) between the points of a bent lane."""


def bent_lane(lane: Lane, target: Lane) -> Lane | None:
    """The internal `lane`, bent so that it ends at the begin of `target`; None if it is too short for that.

    Directions at both ends stay. The id is that of `lane` with the index of `target`, of the same junction.
    """
    (x0, y0), (x1, y1) = lane.points[-1], target.points[0]
    line, _ = line_through(lane.points)
    if math.hypot(x1 - x0, y1 - y0) > STEEPEST * line.end:
        return None
    share = np.linspace(0.0, 1.0, 1 + math.ceil(line.end / SPACING))
    places = np.array([line.at(s)[:2] for s in (share * line.end).tolist()])
    shift = share * share * (3.0 - 2.0 * share)
    shape = places + shift[:, None] * np.array([x1 - x0, y1 - y0])
    length = float(np.hypot(*np.diff(shape, axis=0).T).sum())
    return replace(lane, id=f"{lane.id}{BENT}{lane_index(target.id)}", shape=shape, length=length)


def is_bent(lane: str) -> bool:
    """Whether a lane, by its id, is a bent one."""
    return BENT in lane
