"""Proximal policy optimisation of the selector, in the order and with the names of CleanRL's ppo.py (paper, 3.4).

Schulman et al. 2017, https://arxiv.org/abs/1707.06347. Each iteration rolls out T steps in N slots with the current
policy, then updates the policy on them for some epochs of minibatches.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from slrl_sumo.learning.environments.seeds import drawn_seed
from slrl_sumo.learning.rl.actor import Agent, kind_of
from slrl_sumo.learning.rl.batch import Batch, gae, normalised
from slrl_sumo.models.policy import learn_only
from slrl_sumo.scene.types import TYPE_NAMES


@dataclass(frozen=True)
class PpoSettings:
    """Settings of PPO, with the names of CleanRL."""

    num_steps: int = 64
    """T: decisions of each slot between two updates."""
    learning_rate: float = 5e-4
    anneal_lr: bool = True
    gamma: float = 0.97
    gae_lambda: float = 0.95
    num_minibatches: int = 4
    update_epochs: int = 3
    norm_adv: bool = True
    clip_coef: float = 0.2
    clip_vloss: bool = False
    ent_coef: float = 0.01
    vf_coef: float = 0.05
    """A tenth of CleanRL's value: returns are of order 10, and the critic must not dominate the shared layers."""
    max_grad_norm: float = 0.5
    explore: float = 0.03
    """Share of modes drawn uniformly: modes that are never tried, such as braking, would never be learned."""
    kl_coef: float = 1.0
    kl_coef_last: float = 0.1
    """First and last weight of the divergence KL(teacher || policy), interpolated linearly. The teacher is the initial
    policy minus the cost of each mode (Arena.teacher_costs). Thus behaviour imitated from recordings fades only where
    it contradicts the reward (as in human-regularised PPO, arXiv 2403.19648)."""
    kl_until: float = 1.0
    """Share of the training at which kl_coef_last is reached."""
    kl_kept: tuple[str, ...] = ()
    """Types with a constant kl_coef: they deviate from the teacher only for a large gain of reward."""
    prior_coef: float = 0.0
    """Weight of the divergence KL(policy || prior) from the bundle's prior, learned from recordings."""
    teacher_first: int = 40
    """Number of first updates in which the policy learns only from the teacher, while the critic learns its values: an
    untrained critic would destroy the imitated behaviour."""
    only: tuple[str, ...] = ()
    """Types that learn; the networks of all other types, and the shared layers, stay unchanged. (): all types."""


class Rollouts(Protocol):
    """Source of rollouts: several simulations, on this machine or elsewhere."""

    def reset(self, seed: int) -> None:
        """Restart all simulations, drawn only by `seed`."""

    def collect(self, agent: "Agent", num_steps: int, seed: int) -> tuple[Batch, list[dict[str, Any]]]:
        """Run `num_steps` more steps of all slots with the current policy; return them with the infos of each step.

        Modes are drawn only by `seed`.
        """


def update(
    agent: Agent,
    batch: Batch,
    settings: PpoSettings,
    generator: torch.Generator,
    *,
    kl_coef: float = 0.0,
    teacher_only: bool = False,
) -> dict[str, float]:
    """One PPO update on a rollout. Returns the figures of CleanRL's log (losses, approx_kl, clipfrac,
    explained_variance), kl_teacher (see PpoSettings.kl_coef) and kl_prior.

    Advantages are normalised within each type, because the returns of pedestrians vary less than those of cars.
    """
    advantages, returns = gae(batch, settings.gamma, settings.gae_lambda)
    active = batch.active.flatten()

    def taken(values: Tensor) -> Tensor:
        """The rows of slots with a road user."""
        return values.flatten(0, 1)[active].to(agent.device)

    flat = {name: taken(getattr(batch, name)) for name in ("actions", "logprobs", "values")}
    seen = {name: taken(value) for name, value in batch.seen.items() if name != "active"}
    kind = kind_of(seen["vector"])
    # Weight of the divergence for each road user.
    kl_coefs = torch.full(kind.shape, kl_coef, device=agent.device)
    for name in settings.kl_kept:
        kl_coefs[kind == TYPE_NAMES.index(name)] = settings.kl_coef
    teacher = agent.teacher_logits(seen, taken(batch.teacher_costs)) if bool(kl_coefs.any()) else None
    prior = agent.prior_logits(seen) if settings.prior_coef and not teacher_only else None
    b_advantages, b_returns = taken(advantages), taken(returns)
    if settings.norm_adv:
        b_advantages = normalised(b_advantages, kind)
    size = len(b_returns)
    minibatch = math.ceil(size / settings.num_minibatches)
    sums: dict[str, float] = {}
    updates = 0
    for _ in range(settings.update_epochs):
        order = torch.randperm(size, generator=generator).to(agent.device)
        for start in range(0, size, minibatch):
            mb = order[start : start + minibatch]
            logits, newvalue = agent.logits_and_value({name: value.index_select(0, mb) for name, value in seen.items()})
            newlogprob = logits.gather(1, flat["actions"][mb][:, None])[:, 0]
            entropy = -(logits.exp() * logits).sum(-1).mean()
            logratio = newlogprob - flat["logprobs"][mb]
            ratio = logratio.exp()
            mb_advantages = b_advantages[mb]
            pg_loss1 = -mb_advantages * ratio
            pg_loss2 = -mb_advantages * ratio.clamp(1 - settings.clip_coef, 1 + settings.clip_coef)
            pg_loss = torch.max(pg_loss1, pg_loss2).mean()
            v_loss = (newvalue - b_returns[mb]) ** 2
            if settings.clip_vloss:
                change = (newvalue - flat["values"][mb]).clamp(-settings.clip_coef, settings.clip_coef)
                v_loss = torch.max(v_loss, (flat["values"][mb] + change - b_returns[mb]) ** 2)
            v_loss = 0.5 * v_loss.mean()
            loss = settings.vf_coef * v_loss
            kl_teacher = kl_prior = torch.zeros(())
            if not teacher_only:
                loss = pg_loss - settings.ent_coef * entropy + loss
            if teacher is not None:
                divergence = (teacher[mb].exp() * (teacher[mb] - logits)).sum(-1)
                kl_teacher = divergence.mean()
                loss = loss + (kl_coefs[mb] * divergence).mean()
            if prior is not None:
                kl_prior = (logits.exp() * (logits - prior[mb])).sum(-1).mean()
                loss = loss + settings.prior_coef * kl_prior
            agent.optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(agent.policy.parameters(), settings.max_grad_norm)
            agent.optimizer.step()
            with torch.no_grad():
                figures = {
                    "policy_loss": pg_loss,
                    "value_loss": v_loss,
                    "entropy": entropy,
                    "kl_teacher": kl_teacher,
                    "kl_prior": kl_prior,
                    "approx_kl": ((ratio - 1) - logratio).mean(),
                    "clipfrac": ((ratio - 1).abs() > settings.clip_coef).float().mean(),
                }
            for name, value in figures.items():
                sums[name] = sums.get(name, 0.0) + float(value.detach())
            updates += 1
    figures_mean = {name: value / updates for name, value in sums.items()}
    var = float(b_returns.var())
    unexplained = float((b_returns - flat["values"]).var())
    figures_mean["explained_variance"] = 1.0 - unexplained / var if var > 0 else 0.0
    return figures_mean


def learn(
    agent: Agent,
    rollouts: Rollouts,
    settings: PpoSettings,
    *,
    iterations: range,
    total: int,
    reset_every: int,
    seed: int,
    after: Callable[[int, Batch, list[dict[str, Any]], dict[str, float]], None],
) -> None:
    """Run `iterations` (a part of range(total)) of rollout and update; `after` is called after each one.

    Every `reset_every` iterations, all simulations restart, drawn only by `seed` and the iteration: a training resumed
    there continues exactly as without the interruption. `iterations` must begin at such an iteration.
    """
    if iterations.start % reset_every:
        raise ValueError("training can be resumed only where simulations restart")
    generator = torch.Generator()
    if settings.only:
        learn_only(agent.policy, settings.only)
    for iteration in iterations:
        number = drawn_seed(seed, iteration)
        if iteration % reset_every == 0:
            rollouts.reset(number)
        generator.manual_seed(number)
        frac = 1.0 - iteration / total
        if settings.anneal_lr:
            agent.optimizer.param_groups[0]["lr"] = frac * settings.learning_rate
        started = time.perf_counter()
        batch, infos = rollouts.collect(agent, settings.num_steps, number)
        rolled = time.perf_counter()
        left = max(0.0, 1.0 - iteration / (total * settings.kl_until)) if settings.kl_until else 0.0
        kl_coef = settings.kl_coef_last + left * (settings.kl_coef - settings.kl_coef_last)
        teacher_only = iteration < settings.teacher_first
        figures = update(agent, batch, settings, generator, kl_coef=kl_coef, teacher_only=teacher_only)
        figures["rollout_s"], figures["update_s"] = rolled - started, time.perf_counter() - rolled
        after(iteration, batch, infos, figures)
