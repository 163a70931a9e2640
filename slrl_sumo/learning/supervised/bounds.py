"""Bounds of the motion of each type, from recorded motion."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from slrl_sumo.learning.supervised.windows import Windows
from slrl_sumo.models.displacement import SPEED, DisplacementModels
from slrl_sumo.scene.types import DECISION_INTERVAL, STANDING_SPEED, RoadUserType

TURNING_RATE = 0.02
"""Yaw rate (rad/s) above which a road user is turning."""
CORNERING = 10.0
"""Speed (m/s) below which the curvature of vehicles' turns is measured."""
FREE_TURNING = 0.5
"""Speed (m/s) above which pedestrians reach their highest yaw rate; below, the limit falls with the speed."""

HARDEST = 0.2
"""Percentile of the recorded accelerations of moving road users for emergency braking. The 1st percentile, which bounds
the models, corresponds to a pedestrian that slows down: halving the speed in 0.4 s is rarer."""

TOP_SPEED_PERCENTILE = {"paths": 99.9}
"""Percentile of the recorded speeds that is the top speed of the models, if it is not the 99th. Joggers among SDD's
pedestrians exceed the 99th percentile; models that slow them down have an error of 2.7 instead of 1.5 m there, which is
0.04 of constant velocity's error over all pedestrians."""


def set_bounds(models: DisplacementModels, train: Windows, types: Sequence[RoadUserType], modes: str) -> None:
    """Set the bounds of each type from its recorded motion, without standing road users, which would narrow them."""
    before = train.vector[:, SPEED].astype(np.float64)
    after = before + train.acceleration * DECISION_INTERVAL
    in_motion = _in_motion(train)
    for t in types:
        rows = train.type == t
        moving = rows & in_motion
        rows = moving if moving.any() else rows
        # Most of the motion is straight (pedestrians in SUMO turn at corners only) and would dominate the percentiles.
        turning = rows & (np.abs(train.yaw_rate) > TURNING_RATE)
        turning = turning if turning.any() else rows
        for bounds, values in (
            (models.acceleration_bounds, train.acceleration[rows]),
            (models.yaw_rate_bounds, train.yaw_rate[turning]),
        ):
            lowest, highest = np.percentile(values, (1, 99))
            bounds[t] = torch.tensor([min(lowest, 0.0), max(highest, 0.0)])
        # Sharp turns are slow: long straight drives in the recordings must not lower the bound.
        steering = rows & (after > 1.0) & (after < CORNERING)
        steering = steering if steering.any() else rows & (after > 1.0)
        if t == RoadUserType.PEDESTRIAN:
            models.max_curvature[t] = float(models.yaw_rate_bounds[t].abs().max()) / FREE_TURNING
        elif steering.any():
            models.max_curvature[t] = float(np.percentile(np.abs(train.yaw_rate[steering]) / after[steering], 99.7))
        models.max_speed[t] = float(np.percentile(before[train.type == t], TOP_SPEED_PERCENTILE.get(modes, 99.0)))


def _in_motion(train: Windows) -> NDArray[np.bool_]:
    """Whether the road user of each window moves before or after the first interval, (N,); others do not count."""
    before = train.vector[:, SPEED].astype(np.float64)
    return np.asarray(np.maximum(before, before + train.acceleration * DECISION_INTERVAL) > STANDING_SPEED)


def hardest_braking(train: Windows) -> float:
    """Acceleration (m/s², not positive) of emergency braking of the road users of one type."""
    moving = _in_motion(train)
    return min(float(np.percentile(train.acceleration[moving], HARDEST)), 0.0) if moving.any() else 0.0
