"""What each mode of a road user would lead to in the next seconds, if all others went on as they are."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.perception.observation import Observation
from slrl_sumo.simulation.tally import OWN_SURFACE
from slrl_sumo.world.geometry import Floats, boxes_overlap, wrap_angle
from slrl_sumo.world.roadmap import RoadMap
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL

STEPS = 8
"""Intervals that are looked ahead: 3.2 s."""
HELD = 5
"""Intervals for which a mode's acceleration and yaw rate are kept up; then speed and heading stay."""
MARGIN = 0.4
"""m between boxes below which two meet."""
REACH = 30.0
"""m within which others are looked at."""


@dataclass(frozen=True, eq=False)
class Lookahead:
    """For n road users and all their modes, (n, modes) each."""

    meeting: Floats
    """0 where nobody is met within STEPS, up to 1 where somebody is met at once."""
    off_surface: Floats
    """Share of the STEPS off the own surface."""
    speed: Floats
    """m/s after HELD intervals."""
    turn: Floats
    """rad turned after HELD intervals."""


def look_ahead(
    bundle: ModelBundle, observation: Observation, world: WorldState, rows: NDArray[np.intp], roadmap: RoadMap
) -> Lookahead:
    """What every mode leads to, for the n road users `rows` of `world`, which made `observation`.

    Each of them alone follows a mode as `advance` would move it; the others keep speed and yaw rate.
    """
    n, me = len(observation), world.take(rows)
    with torch.inference_mode():
        motions = bundle.displacement.motion_all(*tensors(observation))
        acceleration, yaw_rate = (motion.double().numpy() for motion in motions)
    modes = acceleration.shape[1]
    top = bundle.max_speed[me.type, None]
    x, y, heading, speed = (np.repeat(column[:, None], modes, axis=1) for column in (me.x, me.y, me.heading, me.speed))
    length, width = (np.repeat(column[:, None] + MARGIN, modes, axis=1) for column in (me.length, me.width))
    own = OWN_SURFACE[me.type]
    everyone = cKDTree(np.column_stack([world.x, world.y]))
    pairs = cKDTree(np.column_stack([me.x, me.y])).sparse_distance_matrix(everyone, REACH, output_type="ndarray")
    ego, other = pairs["i"], pairs["j"]
    ego, other = ego[rows[ego] != other], other[rows[ego] != other]
    reach = np.hypot(world.length, world.width)
    meeting, off = np.zeros((n, modes)), np.zeros((n, modes))
    final_speed, turned = speed, np.zeros((n, modes))
    for step in range(1, STEPS + 1):
        if step <= HELD:
            speed = np.clip(speed + acceleration * DECISION_INTERVAL, 0.0, top)
            turn = yaw_rate * DECISION_INTERVAL
            final_speed, turned = speed, turned + turn
        else:
            turn = np.zeros_like(yaw_rate)
        middle = heading + 0.5 * turn
        x, y = x + speed * DECISION_INTERVAL * np.cos(middle), y + speed * DECISION_INTERVAL * np.sin(middle)
        heading = wrap_angle(heading + turn)
        surface = roadmap.surface_at(x.ravel(), y.ravel()).reshape(n, modes)
        off += ~np.take_along_axis(own, surface.astype(np.intp), axis=1)
        them = _led_on(world, step * DECISION_INTERVAL)
        # Whose circles do not meet under any mode need not be compared box by box.
        spread = np.hypot(x[ego] - them[other, None, 0], y[ego] - them[other, None, 1]).min(axis=1)
        close = spread < 0.5 * (reach[rows[ego]] + reach[other]) + 2 * MARGIN
        e, o = ego[close], other[close]
        boxes = np.stack([x[e], y[e], heading[e], length[e], width[e]], axis=-1).reshape(-1, 5)
        hit = boxes_overlap(boxes, np.repeat(them[o], modes, axis=0)).reshape(-1, modes)
        weight = 1.0 - (step - 1) / STEPS
        np.maximum.at(meeting, e, hit * weight)
    return Lookahead(meeting, off / STEPS, final_speed, turned)


def with_ahead(
    bundle: ModelBundle, observation: Observation, world: WorldState, rows: NDArray[np.intp], roadmap: RoadMap
) -> Observation:
    """`observation` with what every mode leads to: its `ahead` has the fields of Lookahead, in m/s and rad."""
    ahead = look_ahead(bundle, observation, world, rows, roadmap)
    columns = (ahead.meeting, ahead.off_surface, ahead.speed, ahead.turn)
    return replace(observation, ahead=np.stack(columns, axis=-1).astype(np.float32))


def _led_on(world: WorldState, seconds: float) -> Floats:
    """Boxes (m, 5), MARGIN larger, after some seconds at constant speed and yaw rate."""
    turn = world.yaw_rate * seconds
    middle = world.heading + 0.5 * turn
    x = world.x + world.speed * seconds * np.cos(middle)
    y = world.y + world.speed * seconds * np.sin(middle)
    return np.column_stack([x, y, world.heading + turn, world.length + MARGIN, world.width + MARGIN])
