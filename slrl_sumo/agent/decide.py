"""The decision: from a scene to the motion of its road users in the next 0.4 s.

`consider` makes observations and mode rollouts; `decide` chooses a mode and returns its motion. Runs, `attach`,
training, the environments, evaluations on scenarios and recordings, and the benchmarks call only these two functions.
`RoadUserEnv`, in which a user controls the ego, calls `choose` for the other road users.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.braking import with_braking
from slrl_sumo.agent.constraints import Constraints, cap_speed, stand_still
from slrl_sumo.agent.deadlock import DeadlockTimer, force_progress
from slrl_sumo.agent.guard import guard
from slrl_sumo.agent.mode_motions import ModeMotions, mode_motions
from slrl_sumo.agent.path_smoothing import smooth_paths
from slrl_sumo.agent.selection import Mask, Modes, Selector
from slrl_sumo.agent.steering import with_steering
from slrl_sumo.jobs.row_threads import ONE, RowThreads
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts, mode_rollouts
from slrl_sumo.lookahead.route_fit import allowed_speed
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import Capability, capability_of
from slrl_sumo.perception.observation import Observation, observe
from slrl_sumo.perception.presets import PRESETS, vector_for
from slrl_sumo.perception.route_context import RouteContext, route_context
from slrl_sumo.perception.scene import Scene
from slrl_sumo.scene.geometry import Floats

STEERED = 0.01
"""Steering correction (rad/s) above which a decision counts as changed."""

BRAKED = 0.05
"""Braking correction (m/s²) above which a decision counts as changed."""

Changed = dict[str, NDArray[np.bool_]]
"""For each constraint, by name, the decisions that it changed, (n,)."""


@dataclass(frozen=True, eq=False)
class Agent:
    """Models, selector and constraints, with their state, that decide for the learned road users of a simulation."""

    bundle: ModelBundle
    selector: Selector
    constraints: Constraints = field(default_factory=Constraints)
    deadlock: DeadlockTimer = field(default_factory=DeadlockTimer)
    threads: RowThreads = ONE
    """Threads over which the road users are distributed; decisions do not depend on their number."""

    @cached_property
    def capability(self) -> Capability:
        """Capability of the models with the constraints, measured on first use."""
        found = capability_of(self.bundle)
        if self.constraints.braking_residual:
            found = with_braking(found, self.bundle)
        return with_steering(found, self.bundle) if self.constraints.steering_residual else found


@dataclass(frozen=True, eq=False)
class Situation:
    """The inputs of the decisions of n road users."""

    scene: Scene
    observation: Observation
    context: RouteContext | None
    """Routes of the learned road users of the scene, adapted to their models; None without routes."""
    rollouts: ModeRollouts | None
    """Mode rollouts that the selector reads; None if neither selector nor constraints need them."""
    masks: dict[str, Mask]
    """Allowed modes, (n, modes), after each constraint that excludes modes, by the name of the constraint."""
    changed: Changed
    """Decisions that constraints have changed so far."""
    motions: ModeMotions | None = None
    """Motions of the modes with what constraints added to them; None where they add nothing."""

    @property
    def mask(self) -> Mask | None:
        """Allowed modes after all constraints, (n, modes); None: all modes."""
        return list(self.masks.values())[-1] if self.masks else None


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of n road users in the next 0.4 s, (n,) each."""

    modes: Modes
    acceleration: Floats
    """m/s²."""
    yaw_rate: Floats
    """rad/s."""
    max_speed: Floats
    """Upper limit of the speed, m/s (see scene.advance)."""
    changed: Changed


def consider(scene: Scene, agent: Agent, *, last_look: bool = False) -> Situation:
    """Observations, mode rollouts and allowed modes of the deciding road users of `scene`.

    Call it once per decision, because it counts standing times. With `last_look`, no decision follows (the observation
    at the end of an episode): nothing is counted or excluded, and `rows` of the scene may be a subset.
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
    # Constraints use rollouts along the routes, even if the selector does not.
    rules, motions = agent.constraints, None
    if seen is not None:
        motions = mode_motions(bundle, observation, scene, context, rules, agent.threads)
    judged = mode_rollouts(
        bundle,
        observation,
        scene,
        context,
        agent.capability,
        motions=None if motions is None else motions[:2],
        off_route=rules.guard,
        threads=agent.threads,
    )
    masks = {} if last_look else _masks(scene, agent, context, judged)
    rollouts = judged
    if selector.needs_rollouts and seen is None:
        rollouts = mode_rollouts(bundle, observation, scene, threads=agent.threads)
    return Situation(scene, observation, context, rollouts, masks, changed, motions)


def _context(scene: Scene, agent: Agent) -> tuple[RouteContext | None, Changed]:
    """The routes of the learned road users of a scene, adapted to their models, and the decisions that this changes."""
    if scene.route is None:
        return None, {}
    levels = scene.road_map.shapes.levels
    if not agent.constraints.path_smoothing:
        return route_context(scene.route, scene.world, agent.threads, levels), {}
    route, smoothed = smooth_paths(scene.route, scene.world, agent.capability)
    return route_context(route, scene.world, agent.threads, levels), {"path_smoothing": smoothed[scene.rows]}


def _masks(scene: Scene, agent: Agent, context: RouteContext, judged: ModeRollouts) -> dict[str, Mask]:
    """Allowed modes after each constraint that excludes modes; all learned road users of `scene` decide."""
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
    """The mode of each road user of a situation, (n,), and the choices that each mask has changed."""
    masks = situation.masks
    chosen = selector.choose(situation.observation, situation.rollouts, ids, list(masks.values()))
    changed = {name: earlier != later for name, (earlier, later) in zip(masks, pairwise(chosen), strict=True)}
    return chosen[-1], changed


def decide(situation: Situation, agent: Agent, ids: Sequence[Hashable] | None = None) -> Motion:
    """Choose the mode of each road user of a situation and return the motion. `ids` (n,): ids of the road users."""
    scene, rules = situation.scene, agent.constraints
    modes, excluded = choose(situation, agent.selector, ids)
    changed = {name: np.zeros(len(modes), np.bool_) for name, applies in vars(rules).items() if applies}
    changed |= situation.changed | excluded
    each = np.arange(len(modes))
    if situation.rollouts is None:
        acceleration, yaw_rate = agent.bundle.motion(situation.observation, modes)
    else:
        acceleration, yaw_rate = situation.rollouts.acceleration[each, modes], situation.rollouts.yaw_rate[each, modes]
    if situation.motions is not None:
        if rules.steering_residual:
            changed["steering_residual"] = np.abs(situation.motions.steering_residual[each, modes]) > STEERED
        if rules.braking_residual:
            changed["braking_residual"] = situation.motions.braking_residual[each, modes] < -BRAKED
    speed, kind = scene.world.speed[scene.rows], scene.world.type[scene.rows]
    max_speed = np.full(len(modes), np.inf)
    if rules.speed_cap:
        max_speed, changed["speed_cap"] = cap_speed(speed, acceleration, agent.bundle.max_speed[kind])
    if rules.standing_still and situation.context is not None:
        acceleration, changed["standing_still"] = stand_still(speed, acceleration, max_speed)
    return Motion(modes, acceleration, yaw_rate, max_speed, changed)
