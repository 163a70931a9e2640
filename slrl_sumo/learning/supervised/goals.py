"""The quantities that K-Means clusters into modes, by the name of the clustering."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.learning.supervised.modes import (
    AT_PRESENT,
    CURVATURE_INTERVALS,
    AccelerationRanges,
    Weigh,
    acceleration_ranges,
    assign,
    balance,
    balance_accelerations,
    curved,
    relative_accelerations,
)
from slrl_sumo.learning.supervised.windows import Windows
from slrl_sumo.models.displacement import SPEED
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES, RoadUserType

CLUSTERINGS = ("relative", "kmeans", "balanced", "curved", "accelerations")
MODES_BY = ("paths", *CLUSTERINGS)
"""Quantities that K-Means clusters into modes. `relative`: destinations relative to the present speed
(Windows.relative); of the clusterings, it predicted held-out recordings of HC and SDD best
(docs/measurements/archive/prediction.md).
`kmeans`: destinations, as in the paper. `balanced`: destinations, balanced between turning and going straight
(modes.balance). `curved`: for vehicles, balanced, the distance and the curvature of the first 2 s (modes.curved), so
that some modes decelerate in a turn; the displacement models then learn these 2 s. `accelerations`: for vehicles,
acceleration and lateral acceleration of the first 1.2 s relative to recorded values at the same speed
(modes.relative_accelerations), so that modes brake, keep their speed and accelerate with fine and with sharp steering
at each speed; the models learn these 1.2 s. `paths`: begins as `relative`; then the models of all modes compete for
whole paths of 6.4 s, and each model is trained on the paths that it predicts best (winner_takes_all.train_winners).
Neither these models nor the prior read data of other road users, and the prior learns how well each mode predicts a
path (winner_takes_all.responsibilities)."""

HORIZONS = {"curved": CURVATURE_INTERVALS, "accelerations": AT_PRESENT, "paths": 16}
"""Number of intervals that the models of these modes learn; FUTURE for all other modes. With longer training, models of
modes that describe the next 1 to 2 s would continue a turn in circles."""

Ranges = dict[RoadUserType, AccelerationRanges]


def ranges(every: Windows, types: Sequence[RoadUserType]) -> Ranges:
    """The ranges of accelerations of vehicles, which `goals` needs for `accelerations`."""
    result: Ranges = {}
    for t in types:
        if t == RoadUserType.PEDESTRIAN:
            continue
        mine = every.type == t
        result[t] = acceleration_ranges(every.vector[mine, SPEED].astype(np.float64), every.path[mine])
    return result


def trained_ranges(training: dict[str, Any]) -> Ranges:
    """The ranges of accelerations in the training record of a bundle; empty if its modes do not need them."""
    known = training.get("acceleration_ranges", {})
    return {
        RoadUserType(TYPE_NAMES.index(name)): AccelerationRanges(**{key: np.array(one) for key, one in values.items()})
        for name, values in known.items()
    }


def goals(every: Windows, modes: str, known: Ranges | None = None) -> Floats:
    """The quantity (N, 2) that modes of this kind (one of MODES_BY) cluster: m, or the result of `curved` or
    `relative_accelerations` (by their ranges, `known`) for vehicles."""
    if modes in ("relative", "paths"):
        return every.relative
    if modes == "curved":
        goal = every.destination.copy()
        for kind in (RoadUserType.CAR, RoadUserType.BICYCLE):
            mine = every.type == kind
            goal[mine] = curved(goal[mine], every.path[mine, CURVATURE_INTERVALS - 1], kind)
        return goal
    if modes == "accelerations":
        goal = every.destination.copy()
        for kind, one in (known or {}).items():
            mine = every.type == kind
            goal[mine] = relative_accelerations(every.vector[mine, SPEED].astype(np.float64), every.path[mine], one)
        return goal
    return every.destination


def weigh(modes: str, kind: RoadUserType) -> Weigh | None:
    """The weighting function of this clustering (one of MODES_BY) for the windows of a type; None: equal weights."""
    if modes == "accelerations" and kind != RoadUserType.PEDESTRIAN:
        return balance_accelerations
    return balance if modes in ("balanced", "curved", "accelerations") else None


def modes_of(every: Windows, modes: str, centres: Floats, known: Ranges) -> NDArray[np.int64]:
    """The mode of each window, (N,), by the `centres` of all types, (3, modes, 2)."""
    goal, mode = goals(every, modes, known), np.zeros(len(every), np.int64)
    for t in RoadUserType:
        mode[every.type == t] = assign(goal[every.type == t], centres[t])
    return mode
