"""The one decision: from a scene to the motion of its road users in the next 0.4 s.

`consider` looks and rolls out all modes; `decide` chooses one of them and returns its motion. Runs, `attach`, training,
the environments, evaluations on scenarios and recordings and the benchmarks call these two and nothing else; only
`RoadUserEnv`, whose ego is controlled from outside, uses `choose` for the other road users.
"""

from collections.abc import Hashable, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.constraints import Constraints, cap_speed, stand_still
from slrl_sumo.agent.deadlock import DeadlockTimer, force_progress
from slrl_sumo.agent.guard import guard
from slrl_sumo.agent.path_smoothing import smooth_paths
from slrl_sumo.agent.selection import Mask, Modes, Selector
from slrl_sumo.jobs.row_threads import ONE, RowThreads
from slrl_sumo.lookahead.braking import with_braking
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts, mode_rollouts
from slrl_sumo.lookahead.route_fit import allowed_speed
from slrl_sumo.lookahead.steering import with_steering
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import Capability, capability_of
from slrl_sumo.perception.observation import Observation, observe
from slrl_sumo.perception.presets import PRESETS, vector_for
from slrl_sumo.perception.route_context import RouteContext, route_context
from slrl_sumo.perception.scene import Scene
from slrl_sumo.scene.geometry import Floats

STEERED = 0.01
"""rad/s from which a correction of the steering counts as a change."""

BRAKED = 0.05
"""m/s² from which a correction of the braking counts as a change."""

Changed = dict[str, NDArray[np.bool_]]
"""By the name of a constraint: which decisions it changed, (n,)."""


@dataclass(frozen=True, eq=False)
class Agent:
    """What decides for the learned road users of a simulation: models, selector and constraints, with their memory."""

    bundle: ModelBundle
    selector: Selector
    constraints: Constraints = field(default_factory=Constraints)
    deadlock: DeadlockTimer = field(default_factory=DeadlockTimer)
    threads: RowThreads = ONE
    """Over which road users are distributed; the decisions are the same for any number."""

    @cached_property
    def capability(self) -> Capability:
        """What the models can do, probed when it is first needed."""
        found = capability_of(self.bundle)
        if self.constraints.braking_residual:
            found = with_braking(found, self.bundle)
        return with_steering(found, self.bundle) if self.constraints.steering_residual else found


@dataclass(frozen=True, eq=False)
class Situation:
    """What n road users decide from."""

    scene: Scene
    observation: Observation
    context: RouteContext | None
    """Routes of the learned road users of the scene, as their models can drive them; None without routes."""
    rollouts: ModeRollouts | None
    """All modes as the selector reads them; None where neither selector nor constraints need them."""
    masks: dict[str, Mask]
    """Modes that may be chosen, (n, modes), after each constraint that excludes some, by its name."""
    changed: Changed
    """What constraints have changed so far."""

    @property
    def mask(self) -> Mask | None:
        """Modes that may be chosen, (n, modes); None: all."""
        return list(self.masks.values())[-1] if self.masks else None


@dataclass(frozen=True, eq=False)
class Motion:
    """What n road users do in the next 0.4 s, (n,) each."""

    modes: Modes
    acceleration: Floats
    """m/s²."""
    yaw_rate: Floats
    """rad/s."""
    max_speed: Floats
    """m/s that they do not exceed (see scene.advance)."""
    changed: Changed


def consider(scene: Scene, agent: Agent, *, last_look: bool = False) -> Situation:
    """What the deciding road users of `scene` perceive, what each mode leads to, and which modes they may choose.

    Call it once per decision, because it counts how long road users stand. With `last_look` no decision follows (the
    observation at an episode's end): nothing is counted or excluded, and `rows` of the scene may be a part.
    """
    selector, bundle = agent.selector, agent.bundle
    context, changed = _context(scene, agent)
    preset = PRESETS[selector.preset]
    seen = context if preset.knows_route else None
    state = vector_for(bundle.config.preset, selector.preset)
    observation = observe(scene, with_image=selector.needs_image, context=seen, state=state, path=preset.path)
    if context is None:
        rollouts = mode_rollouts(bundle, observation, scene, threads=agent.threads) if selector.needs_rollouts else None
        return Situation(scene, observation, None, rollouts, {}, changed)
    # Constraints judge modes along the routes, also where the selector knows no routes.
    guarded = agent.constraints.guard
    steers = agent.constraints.steering_residual and seen is not None
    judged = mode_rollouts(
        bundle,
        observation,
        scene,
        context,
        agent.capability,
        off_route=guarded,
        steering=steers,
        braking=agent.constraints.braking_residual and seen is not None,
        threads=agent.threads,
    )
    masks = {} if last_look else _masks(scene, agent, context, judged)
    rollouts = judged
    if selector.needs_rollouts and seen is None:
        rollouts = mode_rollouts(bundle, observation, scene, threads=agent.threads)
    return Situation(scene, observation, context, rollouts, masks, changed)


def _context(scene: Scene, agent: Agent) -> tuple[RouteContext | None, Changed]:
    """The routes of the learned road users of a scene as their models can drive them."""
    if scene.route is None:
        return None, {}
    levels = scene.road_map.shapes.levels
    if not agent.constraints.path_smoothing:
        return route_context(scene.route, scene.world, agent.threads, levels), {}
    route, smoothed = smooth_paths(scene.route, scene.world, agent.capability)
    return route_context(route, scene.world, agent.threads, levels), {"path_smoothing": smoothed[scene.rows]}


def _masks(scene: Scene, agent: Agent, context: RouteContext, judged: ModeRollouts) -> dict[str, Mask]:
    """Modes that may be chosen after each constraint that excludes some; all learned road users of `scene` decide."""
    masks: dict[str, Mask] = {}
    users, allowed = scene.world.take(scene.rows), None
    if agent.constraints.guard:
        allowed = masks["guard"] = guard(judged, users.type, context.route)
    if agent.constraints.deadlock_release:
        tolerance = agent.deadlock.tolerance(users, context, allowed_speed(context, agent.capability, users))
        released = force_progress(judged, tolerance, allowed)
        if released is not None and released is not allowed:
            masks["deadlock_release"] = released
    return masks


def choose(situation: Situation, selector: Selector, ids: Sequence[Hashable] | None = None) -> tuple[Modes, Changed]:
    """The mode of each road user of a situation, (n,), and which choices each mask has changed."""
    masks = situation.masks
    chosen = selector.choose(situation.observation, situation.rollouts, ids, list(masks.values()))
    changed = {name: earlier != later for name, (earlier, later) in zip(masks, pairwise(chosen), strict=True)}
    return chosen[-1], changed


def decide(situation: Situation, agent: Agent, ids: Sequence[Hashable] | None = None) -> Motion:
    """Choose the mode of each road user of a situation; returns its motion. `ids` (n,) name the road users."""
    scene, rules = situation.scene, agent.constraints
    modes, excluded = choose(situation, agent.selector, ids)
    changed = {name: np.zeros(len(modes), np.bool_) for name, applies in asdict(rules).items() if applies}
    changed |= situation.changed | excluded
    if situation.rollouts is None:
        acceleration, yaw_rate = agent.bundle.motion(situation.observation, modes)
    else:
        each = np.arange(len(modes))
        acceleration, yaw_rate = situation.rollouts.acceleration[each, modes], situation.rollouts.yaw_rate[each, modes]
        if situation.rollouts.steering_residual is not None:
            changed["steering_residual"] = np.abs(situation.rollouts.steering_residual[each, modes]) > STEERED
        if situation.rollouts.braking_residual is not None:
            changed["braking_residual"] = situation.rollouts.braking_residual[each, modes] < -BRAKED
    speed, kind = scene.world.speed[scene.rows], scene.world.type[scene.rows]
    max_speed = np.full(len(modes), np.inf)
    if rules.speed_cap:
        max_speed, changed["speed_cap"] = cap_speed(speed, acceleration, agent.bundle.max_speed[kind])
    if rules.standing_still and situation.context is not None:
        acceleration, changed["standing_still"] = stand_still(speed, acceleration, max_speed)
    return Motion(modes, acceleration, yaw_rate, max_speed, changed)
