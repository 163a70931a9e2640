"""Road user types and their figures."""

from enum import IntEnum

import numpy as np

DECISION_INTERVAL = 0.4
"""Time (s) between two decisions of a learned road user (paper, section 3.2)."""
STANDING_SPEED = 0.1
"""Speed (m/s) below which a road user stands."""


class RoadUserType(IntEnum):
    """The three types of the paper.

    All vehicles except bicycles are perceived as cars; the car's models move only vehicles that are similar to cars
    (`sumo.vehicle_classes`).
    """

    CAR = 0
    BICYCLE = 1
    PEDESTRIAN = 2


PEDESTRIAN = int(RoadUserType.PEDESTRIAN)
"""The type as a number: with a member of an enumeration, numpy's comparison of 64 numbers takes 10 instead of 2 us."""
TYPE_NAMES: tuple[str, ...] = tuple(t.name.lower() for t in RoadUserType)
"""Names of the types as they appear in files and on the command line, indexed by RoadUserType."""

DEFAULT_LENGTH = np.array([5.0, 1.6, 0.215])
"""Box length in m per type: SUMO's defaults for passenger, bicycle and pedestrian
(https://sumo.dlr.de/docs/Vehicle_Type_Parameter_Defaults.html)."""

DEFAULT_WIDTH = np.array([1.8, 0.65, 0.478])
"""Box width in m per type, from the same source."""
MAX_POSITION = 1e8
"""Distance (m) from the origin beyond which a position is an error; positions of map projections stay below 1e7."""
SPAWNED_PREFIX = "learned_"
"""Prefix of ids, vTypes and routes of spawned road users in SUMO."""
