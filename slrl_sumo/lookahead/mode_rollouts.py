"""All modes of road users, rolled out for the next seconds and judged."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.jobs.row_threads import ONE, RowThreads
from slrl_sumo.lookahead.braking import braking_residual
from slrl_sumo.lookahead.collision import MARGIN, Others, blame_of, collision_scores
from slrl_sumo.lookahead.first_contact import STANDING, START, Blame
from slrl_sumo.lookahead.forecast import PathFollowing, bring_to_paths, forecast_boxes, path_following
from slrl_sumo.lookahead.mode_paths import HELD, ModePaths, mode_paths
from slrl_sumo.lookahead.off_surface import off_surface
from slrl_sumo.lookahead.precedence import precedence
from slrl_sumo.lookahead.route_fit import RouteFit, route_fit
from slrl_sumo.lookahead.steering import steering_residual
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import Capability
from slrl_sumo.perception.observation import Observation
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.perception.scene import Scene
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType


@dataclass(frozen=True, eq=False)
class ModeRollouts:
    """What each mode of n road users leads to, (n, modes) each."""

    acceleration: Floats
    """m/s² of the mode's displacement model now."""
    yaw_rate: Floats
    """rad/s, likewise."""
    collision: Floats
    """0 where the mode collides with no road user within STEPS, up to 1 where it does at once; along the route for
    vehicles that follow one."""
    off_surface: Floats
    """Share of the STEPS off the own surface; of the first NEAR steps for road users with a route, each counted by how
    far off it is (see lookahead.off_surface)."""
    speed: Floats
    """m/s after HELD intervals."""
    turn: Floats
    """rad turned after HELD intervals."""
    route: RouteFit | None = None
    """How it fits the route; None without routes."""
    collision_off_route: Floats | None = None
    """As `collision`, on the path of the mode itself also for vehicles that follow a route; None unless asked for."""

    steering_residual: Floats | None = None
    """rad/s by which `yaw_rate` is more than that of the mode; None without the constraint."""
    braking_residual: Floats | None = None
    """m/s² by which `acceleration` is more than that of the mode; None without the constraint."""

    def columns(self, names: Sequence[str]) -> NDArray[np.float32]:
        """Fields of this class and of RouteFit by name, for a network, (n, modes, len(names)); those of RouteFit are 0
        without routes."""
        result = np.zeros((*self.collision.shape, len(names)), np.float32)
        for column, name in enumerate(names):
            if name not in RouteFit._fields:
                result[..., column] = getattr(self, name)
            elif self.route is not None:
                result[..., column] = getattr(self.route, name)
        return result


def mode_rollouts(
    bundle: ModelBundle,
    observation: Observation,
    scene: Scene,
    context: RouteContext | None = None,
    capability: Capability | None = None,
    *,
    off_route: bool = False,
    steering: bool = False,
    braking: bool = False,
    threads: RowThreads = ONE,
) -> ModeRollouts:
    """Roll out all modes of the deciding road users of `scene`, which made the `observation`.

    Each road user alone follows a mode as `advance` would move it; all others keep speed and yaw rate. With `context`
    (and what the models can do, `capability`) vehicles that have a route follow it at the speeds of the mode, so that
    a collision does not depend on how they turn in the next moment. `off_route` also gives `collision_off_route`.
    With `steering` and `braking`, modes are corrected by the modules of these names. The road users are distributed
    over `threads`.
    """
    if scene.group is not None:
        acceleration, yaw_rate = bundle.motions(observation.vector, observation.type)
        collision, outside, speed, turn = (np.empty_like(acceleration) for _ in range(4))
        for part, places in scene.groups():
            one = _judged(bundle, part, _expected(part.world, None), acceleration[places], yaw_rate[places])
            collision[places], outside[places] = one.collision, one.off_surface
            speed[places], turn[places] = one.speed, one.turn
        return ModeRollouts(acceleration, yaw_rate, collision, outside, speed, turn)
    expected = _expected(scene.world, context)
    if scene.places is not None:
        x, y = scene.places
        expected = expected._replace(on_foot=_expected(replace(scene.world, x=x, y=y), context))

    def judged(some: slice) -> ModeRollouts:
        motions = bundle.motions(observation.vector[some], observation.type[some])
        part = replace(scene, rows=scene.rows[some])
        return _judged(bundle, part, expected, *motions, context, capability, off_route, steering, braking)

    return joined(threads.each(judged, len(scene)))


def joined(parts: list[ModeRollouts]) -> ModeRollouts:
    """The rollouts of road users of which each of the `parts` has some, in this order."""
    if len(parts) == 1:
        return parts[0]
    together: dict[str, Any] = {}
    for field in fields(ModeRollouts):
        values = [getattr(part, field.name) for part in parts]
        if isinstance(values[0], RouteFit):
            together[field.name] = RouteFit(*map(np.concatenate, zip(*values, strict=True)))
        else:
            together[field.name] = None if values[0] is None else np.concatenate(values)
    return ModeRollouts(**together)


class _Expected(NamedTuple):
    """What is expected of all road users of a world, whatever is judged."""

    world: WorldState
    following: PathFollowing
    others: Others
    on_foot: "_Expected | None" = None
    """What pedestrians expect, where that is something else."""

    def collisions(self, paths: ModePaths, blame: Blame, users: WorldState, scene: Scene) -> Floats:
        """How soon each mode of the deciding road users of a scene collides, (n, modes)."""
        rows, levels = scene.rows, scene.road_map.shapes.levels
        if self.on_foot is None:
            return collision_scores(paths, blame, self.others, self.world, rows, levels)
        walks, scores = users.type == RoadUserType.PEDESTRIAN, np.empty(paths.x[:, 0].shape)
        for some, expected in ((~walks, self), (walks, self.on_foot)):
            of_some = ModePaths(*(values[some] for values in paths)), Blame(*(values[some] for values in blame))
            scores[some] = collision_scores(*of_some, expected.others, expected.world, rows[some], levels)
        return scores


def _expected(world: WorldState, context: RouteContext | None) -> _Expected:
    following = path_following(context, world)
    if context is None:
        margin = np.full(len(world), MARGIN.max())
    else:
        # What stands does not sway: else vehicles stand for ever before others that wait where SUMO's lanes pass each
        # other with less than the margin.
        margin = np.where(world.speed < STANDING, 0.0, MARGIN[world.type])
        world = _with_persons_as_expected(world)
    going = forecast_boxes(world, following, margin)
    # Without routes there is no order, and none waits.
    yielding = going if context is None else forecast_boxes(world, following, margin, yielding=True)
    order = precedence(context, following, len(world))
    return _Expected(world, following, Others(going, yielding, order, _starting(world, context)))


def _starting(world: WorldState, context: RouteContext | None) -> NDArray[np.bool_]:
    """The learned persons of a world that stand, and that no red light keeps from walking on, (m,)."""
    starts = np.zeros(len(world), np.bool_)
    if context is not None:
        n = len(context)
        stands = (world.type[:n] == RoadUserType.PEDESTRIAN) & (world.speed[:n] < STANDING)
        starts[:n] = stands & context.route.known & (context.route.stop > START)
    return starts


def _with_persons_as_expected(world: WorldState) -> WorldState:
    """The same with pedestrians that do not turn, and are as long as they are wide.

    They turn by up to 4 rad/s from decision to decision, not in circles; and shoulders that are across the way in one
    decision are along it in the next one.
    """
    walks = world.type == RoadUserType.PEDESTRIAN
    length = np.where(walks, np.maximum(world.length, world.width), world.length)
    return replace(world, length=length, yaw_rate=np.where(walks, 0.0, world.yaw_rate))


def _judged(
    bundle: ModelBundle,
    scene: Scene,
    expected: _Expected,
    acceleration: Floats,
    yaw_rate: Floats,
    context: RouteContext | None = None,
    capability: Capability | None = None,
    off_route: bool = False,
    steering: bool = False,
    braking: bool = False,
) -> ModeRollouts:
    world, rows = scene.world, scene.rows
    users = world.take(rows)
    top, residual, harder = bundle.max_speed[users.type], None, None
    if context is not None and braking:
        harder = braking_residual(acceleration, bundle.hardest_braking[users.type])
        acceleration = acceleration + harder
    paths = mode_paths(users, acceleration, yaw_rate, top, on_route=context is not None)
    if context is not None and steering:
        residual = steering_residual(context, users, rows, paths, yaw_rate, bundle.max_curvature)
        yaw_rate = yaw_rate + residual
        paths = mode_paths(users, acceleration, yaw_rate, top, on_route=True)
    route = None if context is None else context.route
    outside = off_surface(paths, users.type, scene.road_map, rows, route)
    fit, follows, routed = None, np.zeros(len(users), np.bool_), np.zeros(len(users), np.bool_)
    following = expected.following
    if context is not None and capability is not None:
        fit = route_fit(context, capability, users, rows, paths, yaw_rate)
        follows, routed = following.follows[rows], context.route.known[rows]
    blame = blame_of(users.type, follows, routed)
    direct = expected.collisions(paths, blame, users, scene) if off_route else None
    if context is not None:
        bring_to_paths(paths, following, rows)
    collision = expected.collisions(paths, blame, users, scene)
    return ModeRollouts(
        acceleration=acceleration,
        yaw_rate=yaw_rate,
        collision=collision,
        off_surface=outside,
        speed=paths.speed[:, HELD - 1],
        turn=HELD * DECISION_INTERVAL * yaw_rate,
        route=fit,
        collision_off_route=direct,
        steering_residual=residual,
        braking_residual=harder,
    )
