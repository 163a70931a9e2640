"""Long rollouts: a check whether road users of a recording still move plausibly after a long simulation."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Integers, Trajectories
from slrl_sumo.metrics.distributions import EDGES, jensen_shannon_distance
from slrl_sumo.metrics.realism_features import nearest_distance
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.perception.past_motion import later, recorded_past
from slrl_sumo.scene.advance import advance
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import STANDING_SPEED, TYPE_NAMES
from slrl_sumo.studies.prediction.rollout import Cast, Moment, Move, cast_of
from slrl_sumo.studies.prediction.rollout_realism import Recorded

LONG_STEPS = 64
"""Intervals: 25.6 s, four times as long as a prediction."""

SLOW_SPEED = 0.3
"""m/s; slower road users should hardly turn."""

NEAREST_BINS = np.linspace(-1.0, 20.0, 43)
"""Borders of bins of the distance to the nearest, m."""


@dataclass(frozen=True, eq=False)
class LongRollout:
    """U road users over LONG_STEPS intervals."""

    type: NDArray[np.int8]
    """RoadUserType, (U,)."""
    speed: Floats
    """m/s, (U, LONG_STEPS)."""
    acceleration: Floats
    yaw_rate: Floats
    sideslip: Floats
    """rad between an interval's displacement and the heading after it, 0 where there was none, (U, LONG_STEPS)."""
    nearest: Floats
    """m from box to box of the nearest other road user after each interval, (U, LONG_STEPS)
    (metrics.realism_features)."""
    distance: Floats
    """m from the start to the end, (U,)."""


def long_rollout(
    recording: Trajectories, starts: Integers, make: Callable[[Cast], Move], types: NDArray[np.bool_] | None = None
) -> LongRollout:
    """Simulate all road users present and in motion at the frames `starts` for LONG_STEPS, without the recording.

    No road user enters or leaves, and those of other than `types` (3,) are not there. `make` gives the motion.
    """
    every = cast_of(recording, starts, types=types)
    cast = every.take(np.flatnonzero((every.enters == 0) & (every.leaves > 0)))
    row, track = cast.row, recording.track[cast.row]
    world = WorldState(
        time=0.0,
        ids=("",) * len(row),
        type=recording.type[track],
        x=recording.x[row],
        y=recording.y[row],
        heading=recording.heading[row],
        speed=recording.speed[row],
        acceleration=recording.acceleration[row],
        yaw_rate=recording.yaw_rate[row],
        length=recording.length[track],
        width=recording.width[track],
        learned=np.ones(len(row), np.bool_),
    )
    every_row = np.arange(len(row))
    begin, move = world, make(cast)
    kept: list[Floats] = []
    nearest: list[Floats] = []
    past = recorded_past(recording, row)
    for step in range(LONG_STEPS):
        # There is no recorded truth here; the present positions take its place.
        moment = Moment(world, cast.scene, every_row, every_row, step, world.x, world.y, past)
        then = advance(world, *move(moment), recording.dt)
        dx, dy = then.x - world.x, then.y - world.y
        slip = np.where(np.hypot(dx, dy) > 1e-6, np.abs(wrap_angle(np.arctan2(dy, dx) - then.heading)), 0.0)
        kept.append(np.stack([then.speed, then.acceleration, then.yaw_rate, slip]))
        nearest.append(_nearest(then, cast.scene))
        past, world = later(past, world.speed, world.yaw_rate), then
    speed, acceleration, yaw_rate, sideslip = np.stack(kept, axis=-1)
    distance = np.hypot(world.x - begin.x, world.y - begin.y)
    return LongRollout(world.type, speed, acceleration, yaw_rate, sideslip, np.stack(nearest, axis=-1), distance)


def _nearest(world: WorldState, scene: Integers) -> Floats:
    """Distance of the nearest other road user of the scene, (U,), m."""
    n = len(world)
    every = Trajectories(
        track=np.arange(n),
        frame=scene,
        x=world.x,
        y=world.y,
        heading=world.heading,
        ids=tuple(map(str, range(n))),
        type=world.type,
        length=world.length,
        width=world.width,
    )
    return nearest_distance(every)


def long_rollout_figures(
    name: str, drives: Sequence[LongRollout], bundle: ModelBundle, truth: Recorded
) -> list[dict[str, Any]]:
    """Per type: extremes of motion, and the share of steps within the 1st to 99th percentile of the training data.

    `js`: Jensen-Shannon distances of the distributions of speed, acceleration, yaw rate and distance to the nearest,
    over all steps, from those of the recording. `standing`, `recorded_standing`: shares of steps below STANDING_SPEED.

    `slow_yaw_rate_first` and `_last`: 99th percentile of the absolute yaw rate below SLOW_SPEED, in the first and the
    last quarter of the steps: the second must not be the greater one by much. None where no road user was slow, or the
    bundle does not say what was recorded.
    """
    rows = []
    for kind, type_name in enumerate(TYPE_NAMES):
        mine = [(drive, drive.type == kind) for drive in drives]
        if not any(chosen.any() for _, chosen in mine):
            continue
        speed, acceleration, yaw_rate, sideslip = (
            np.concatenate([getattr(drive, field)[chosen] for drive, chosen in mine])
            for field in ("speed", "acceleration", "yaw_rate", "sideslip")
        )
        nearest = np.concatenate([drive.nearest[chosen] for drive, chosen in mine])
        slow = speed < SLOW_SPEED
        quarter = LONG_STEPS // 4
        simulated = {"speed": speed, "acceleration": acceleration, "yaw_rate": yaw_rate, "nearest": nearest}
        true = {quantity: truth.of_type(quantity, kind) for quantity in (*simulated, "standing")}
        recorded = bundle.training.get("types", {}).get(type_name, {})
        rows.append(
            {
                "selector": name,
                "type": type_name,
                "n": len(speed),
                "steps": LONG_STEPS,
                "farthest_m": float(np.concatenate([drive.distance[chosen] for drive, chosen in mine]).max()),
                "yaw_rate_p99_radps": float(np.percentile(np.abs(yaw_rate), 99)),
                "sideslip_p99_rad": float(np.percentile(sideslip, 99)),
                "slow_yaw_rate_first_radps": _p99(np.abs(yaw_rate[:, :quarter])[slow[:, :quarter]]),
                "slow_yaw_rate_last_radps": _p99(np.abs(yaw_rate[:, -quarter:])[slow[:, -quarter:]]),
                "js": {
                    quantity: jensen_shannon_distance(
                        a=values.ravel(),
                        b=true[quantity],
                        edges=EDGES[quantity][kind] if quantity in EDGES else NEAREST_BINS,
                    )
                    for quantity, values in simulated.items()
                },
                "standing": float((speed < STANDING_SPEED).mean()),
                "recorded_standing": float(true["standing"].mean()),
                "speed_within": _share_within(speed, recorded.get("speed_percentiles_mps")),
                "acceleration_within": _share_within(acceleration, recorded.get("acceleration_percentiles_mps2")),
            }
        )
    return rows


def _p99(values: Floats) -> float | None:
    return float(np.percentile(values, 99)) if len(values) else None


def _share_within(values: Floats, bounds: Sequence[float] | None) -> float | None:
    """Share within bounds; a rounding error outside still counts as within."""
    if bounds is None:
        return None
    return float(((values >= bounds[0] - 1e-3) & (values <= bounds[1] + 1e-3)).mean())
