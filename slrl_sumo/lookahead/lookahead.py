"""What each mode of a road user would lead to in the next seconds, if all others went on as they are."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.lookahead.collision import MARGIN, meeting
from slrl_sumo.lookahead.forecast import boxes, bring_to_paths, paths_kept
from slrl_sumo.lookahead.mode_rollout import HELD, roll_out
from slrl_sumo.lookahead.off_surface import off_surface
from slrl_sumo.lookahead.route_fit import RouteContext, RouteFit, on_route
from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL


@dataclass(frozen=True, eq=False)
class Lookahead:
    """For n road users and all their modes, (n, modes) each."""

    meeting: Floats
    """0 where nobody is met within STEPS, up to 1 where somebody is met at once."""
    off_surface: Floats
    """Share of the STEPS off the own surface; of the first NEAR ones for who has a route."""
    speed: Floats
    """m/s after HELD intervals."""
    turn: Floats
    """rad turned after HELD intervals."""
    acceleration: Floats
    """m/s², as the models of the modes have it now."""
    yaw_rate: Floats
    """rad/s, likewise."""
    route: RouteFit | None = None
    touching: Floats | None = None
    """As `meeting`, on the very course of the mode, also for who keeps to a path; where it was asked for."""


def look_ahead(
    bundle: ModelBundle,
    observation: Observation,
    world: WorldState,
    rows: NDArray[np.intp],
    roadmap: RoadMap,
    context: RouteContext | None = None,
    *,
    touching: bool = False,
) -> Lookahead:
    """What every mode leads to, for the n road users `rows` of `world`, which made `observation`.

    Each of them alone follows a mode as `advance` would move it; the others keep speed and yaw rate. With `context`
    vehicles that have a route follow it, at the speeds of the mode: where they meet somebody does not depend on how
    they turn in the next moment. With `touching` it is also looked whom they meet if they do not.
    """
    me = world.take(rows)
    motions = bundle.displacement.motion_all(*tensors(observation))
    acceleration, yaw_rate = (motion.double().numpy() for motion in motions)
    free = roll_out(me, acceleration, yaw_rate, bundle.max_speed[me.type], halting=context is not None)
    turned = HELD * DECISION_INTERVAL * yaw_rate
    off = off_surface(free, me.type, roadmap, rows, None if context is None else context.route)
    if context is None:
        kept, margin, fits, excused = None, np.full_like(MARGIN, MARGIN.max()), None, np.zeros(len(me), np.bool_)
    else:
        # Who keeps to a path cannot step aside, as pedestrians do.
        kept, margin = paths_kept(context.route, world), MARGIN
        fits, excused = on_route(context, me, rows, free, yaw_rate), kept.keeps[rows]
    theirs = boxes(world, kept, margin)
    touched = meeting(free, excused, theirs, world, rows) if touching else None
    if kept is not None:
        bring_to_paths(free, kept, rows)
    met = meeting(free, excused, theirs, world, rows)
    return Lookahead(met, off, free.speed[:, HELD - 1], turned, acceleration, yaw_rate, fits, touched)


def with_ahead(
    bundle: ModelBundle,
    observation: Observation,
    world: WorldState,
    rows: NDArray[np.intp],
    roadmap: RoadMap,
    context: RouteContext | None = None,
) -> Observation:
    """`observation` with what every mode leads to: its `ahead` has the fields of Lookahead and, with `context`, of
    RouteFit, in m/s, rad and m."""
    return told(observation, look_ahead(bundle, observation, world, rows, roadmap, context))


def told(observation: Observation, ahead: Lookahead) -> Observation:
    """`observation` with `ahead` as columns."""
    columns = [ahead.meeting, ahead.off_surface, ahead.speed, ahead.turn]
    if (route := ahead.route) is not None:
        columns += [route.steer, route.aside, route.pace, route.brake, route.follow]
    result = np.empty((*ahead.meeting.shape, len(columns)), np.float32)
    for column, values in enumerate(columns):
        result[..., column] = values
    return replace(observation, ahead=result)
