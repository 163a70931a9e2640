"""Mode rollouts: all modes of road users, simulated for the next seconds and rated."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.jobs.row_threads import ONE, RowThreads
from slrl_sumo.lookahead.collision import MARGIN, Others, blame_of, collision_scores
from slrl_sumo.lookahead.first_contact import STANDING, START, Blame
from slrl_sumo.lookahead.forecast import PathFollowing, bring_to_paths, forecast_boxes, path_following
from slrl_sumo.lookahead.mode_paths import HELD, ModePaths, mode_paths
from slrl_sumo.lookahead.off_surface import off_surface
from slrl_sumo.lookahead.precedence import precedence
from slrl_sumo.lookahead.route_fit import RouteFit, route_fit
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import Capability
from slrl_sumo.perception.observation import Observation
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.perception.scene import Scene
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, PEDESTRIAN


@dataclass(frozen=True, eq=False)
class ModeRollouts:
    """Consequences of each mode of n road users, (n, modes) each."""

    acceleration: Floats
    """Present acceleration (m/s²) of the mode."""
    yaw_rate: Floats
    """Present yaw rate (rad/s) of the mode."""
    collision: Floats
    """Collision score: 0 without a collision within STEPS, 1 for an immediate collision. Vehicles that follow a route
    are rated along their route."""
    off_surface: Floats
    """Share of the STEPS intervals off the own surfaces; for road users with a route of the first NEAR intervals,
    weighted by distance (see lookahead.off_surface)."""
    speed: Floats
    """Speed (m/s) after HELD intervals."""
    turn: Floats
    """Turn (rad) after HELD intervals."""
    route: RouteFit | None = None
    """Fit of the mode to the route; None without routes."""
    collision_off_route: Floats | None = None
    """Collision score on the path of the mode itself, also for vehicles that follow a route; None unless requested."""

    def columns(self, names: Sequence[str]) -> NDArray[np.float32]:
        """Fields of this class and of RouteFit by name, as input of a network, (n, modes, len(names)).

        Fields of RouteFit are 0 without routes.
        """
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
    motions: tuple[Floats, Floats] | None = None,
    off_route: bool = False,
    threads: RowThreads = ONE,
) -> ModeRollouts:
    """Roll out all modes of the deciding road users of `scene`, which have the `observation`.

    In each rollout, one road user follows a mode as `advance` would move it; all others keep speed and yaw rate. With
    `context` and `capability` (of the models), vehicles with a route follow the route at the speeds of the mode, so
    that a collision does not depend on their present yaw rate. `motions`: accelerations (m/s²) and yaw rates (rad/s) of
    the modes, (n, modes) each; without them, the displacement models give these. `off_route` also computes
    `collision_off_route`. The road users are distributed over `threads`.
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
        if motions is None:
            acceleration, yaw_rate = bundle.motions(observation.vector[some], observation.type[some])
        else:
            acceleration, yaw_rate = motions[0][some], motions[1][some]
        part = replace(scene, rows=scene.rows[some])
        return _judged(bundle, part, expected, acceleration, yaw_rate, context, capability, off_route)

    return joined(threads.each(judged, len(scene)))


def joined(parts: list[ModeRollouts]) -> ModeRollouts:
    """Concatenate the rollouts of the `parts`, in this order."""
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
    """Forecast of all road users of a world, common to all rollouts."""

    world: WorldState
    following: PathFollowing
    others: Others
    on_foot: "_Expected | None" = None
    """Forecast that pedestrians use, if it is a different one."""

    def collisions(self, paths: ModePaths, blame: Blame, users: WorldState, scene: Scene) -> Floats:
        """Collision scores of all modes of the deciding road users of a scene, (n, modes)."""
        rows, levels = scene.rows, scene.road_map.shapes.levels
        if self.on_foot is None:
            return collision_scores(paths, blame, self.others, self.world, rows, levels)
        walks, scores = users.type == PEDESTRIAN, np.empty(paths.x[:, 0].shape)
        for some, expected in ((~walks, self), (walks, self.on_foot)):
            of_some = ModePaths(*(values[some] for values in paths)), Blame(*(values[some] for values in blame))
            scores[some] = collision_scores(*of_some, expected.others, expected.world, rows[some], levels)
        return scores


def _expected(world: WorldState, context: RouteContext | None) -> _Expected:
    following = path_following(context, world)
    if context is None:
        margin = np.full(len(world), MARGIN.max())
    else:
        # Standing road users need no margin: otherwise vehicles stand for ever before waiting vehicles where SUMO's
        # lanes pass each other with less than the margin.
        margin = np.where(world.speed < STANDING, 0.0, MARGIN[world.type])
        world = _with_persons_as_expected(world)
    going = forecast_boxes(world, following, margin)
    # Without routes there is no precedence, and no road user waits.
    yielding = going if context is None else forecast_boxes(world, following, margin, yielding=True)
    order = precedence(context, following, len(world))
    return _Expected(world, following, Others(going, yielding, order, _starting(world, context)))


def _starting(world: WorldState, context: RouteContext | None) -> NDArray[np.bool_]:
    """The standing learned pedestrians of a world that need not stop, such as at a red signal, (m,)."""
    starts = np.zeros(len(world), np.bool_)
    if context is not None:
        n = len(context)
        stands = (world.type[:n] == PEDESTRIAN) & (world.speed[:n] < STANDING)
        starts[:n] = stands & context.route.known & (context.route.stop > START)
    return starts


def _with_persons_as_expected(world: WorldState) -> WorldState:
    """The same world with pedestrians that do not turn and are as long as they are wide.

    Pedestrians turn by up to 4 rad/s from decision to decision, but not in circles; and shoulders across the way at one
    decision may be along it at the next.
    """
    walks = world.type == PEDESTRIAN
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
) -> ModeRollouts:
    world, rows = scene.world, scene.rows
    users = world.take(rows)
    paths = mode_paths(users, acceleration, yaw_rate, bundle.max_speed[users.type], on_route=context is not None)
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
    )
