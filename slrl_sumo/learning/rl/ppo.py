"""Proximal policy optimisation of the selector, in the order and with the names of CleanRL's ppo.py (paper, 3.4).

Schulman et al. 2017, https://arxiv.org/abs/1707.06347. Each iteration rolls out T steps in N slots with the current
policy, then updates the policy on them for some epochs of minibatches.
"""

import copy
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from slrl_sumo.models.policy import Policy, policy_logits
from slrl_sumo.models.prior import Prior
from slrl_sumo.perception.features import FEATURES

RAREST = -8.0
"""Log probability at which the prior's end, so that a mode that was never recorded costs a bounded amount."""
CAR = FEATURES.index("car")
"""First column of the one-hot type in the vector."""


@dataclass(frozen=True)
class PpoSettings:
    """Names as in CleanRL."""

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
    """A tenth of CleanRL's: returns are of order 10, and the critic must not dominate the layers that it shares."""
    max_grad_norm: float = 0.5
    explore: float = 0.03
    """Share of modes drawn uniformly: a mode that is never tried is never learned, and braking is one of them."""
    kl_coef: float = 1.0
    kl_coef_last: float = 0.1
    """First and last weight of the divergence KL(teacher || policy), interpolated linearly. The teacher is the initial
    policy minus the cost of each mode (Arena.teacher_costs). So behaviour imitated from recordings fades only
    where the reward opposes it (as in human-regularised PPO, arXiv 2403.19648)."""
    kl_until: float = 1.0
    """Share of the training at which kl_coef_last is reached."""
    prior_coef: float = 0.0
    """Weight of the divergence KL(policy || prior) from the bundle's prior, learned from recordings."""
    teacher_first: int = 40
    """Updates in which the policy learns from the teacher alone while the critic learns its values: an untrained critic
    would destroy what was imitated before."""


class Slots(Protocol):
    """Part of an environment that a rollout needs: gymnasium's VectorEnv.step with autoreset in the same step."""

    num_envs: int

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[dict[str, NDArray[Any]], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]: ...


@dataclass(frozen=True, eq=False)
class Batch:
    """One rollout: T steps of N slots."""

    seen: dict[str, Tensor]
    """(T, N, ...): observations `vector`, `rollouts` and optionally `image`, `route`, `action_mask` and `active`."""
    actions: Tensor
    """(T, N) int64."""
    logprobs: Tensor
    values: Tensor
    rewards: Tensor
    """(T, N)."""
    terminated: Tensor
    """(T, N) bool: the episode ended; its remaining return is 0."""
    truncated: Tensor
    """(T, N) bool: the episode was cut off; its remaining return is estimated by `final_values`."""
    final_values: Tensor
    """(T, N); 0 where `truncated` is false."""
    next_value: Tensor
    """(N,): value of the observation after the last step."""
    teacher_costs: Tensor
    """(T, N, modes): cost of each mode (Arena.teacher_costs)."""

    @property
    def active(self) -> Tensor:
        """(T, N) bool: which slots had a road user."""
        return self.seen["active"].bool() if "active" in self.seen else torch.ones_like(self.terminated)


class Rollouts(Protocol):
    """Source of rollouts: several simulations, on this machine or elsewhere."""

    def reset(self, seed: int) -> None:
        """Restart all simulations, drawn by `seed` alone."""

    def collect(self, agent: "Agent", num_steps: int, seed: int) -> tuple[Batch, list[dict[str, Any]]]:
        """`num_steps` more steps of all slots with the current policy, modes drawn by `seed` alone; and the infos of
        every step."""


def joined(batches: Sequence[Batch]) -> Batch:
    """The slots of several rollouts of equal length, side by side."""
    parts: dict[str, Any] = {}
    for name in (field.name for field in fields(Batch)):
        values = [getattr(batch, name) for batch in batches]
        if name == "seen":
            parts[name] = {key: torch.cat([value[key] for value in values], 1) for key in values[0]}
        else:
            parts[name] = torch.cat(values, 0 if name == "next_value" else 1)
    return Batch(**parts)


def gae(batch: Batch, gamma: float, gae_lambda: float) -> tuple[Tensor, Tensor]:
    """Generalised advantage estimates and returns, (T, N) each (Schulman et al. 2016, arXiv 1506.02438).

    A truncated episode bootstraps from the value of its last observation, a terminated one from 0; neither depends on
    the next episode in its slot.
    """
    done = (batch.terminated | batch.truncated).float()
    advantages = torch.zeros_like(batch.rewards)
    lastgaelam = torch.zeros_like(batch.next_value)
    following = batch.next_value
    for t in reversed(range(len(batch.rewards))):
        nextvalue = torch.where(batch.truncated[t], batch.final_values[t], following * (1.0 - done[t]))
        delta = batch.rewards[t] + gamma * nextvalue - batch.values[t]
        lastgaelam = delta + gamma * gae_lambda * (1.0 - done[t]) * lastgaelam
        advantages[t] = lastgaelam
        following = batch.values[t]
    return advantages, advantages + batch.values


class Actor:
    """The policy on a device, as rollouts use it."""

    def __init__(self, policy: Policy, prior: Prior, explore: float, device: torch.device) -> None:
        self.policy, self.prior = policy.to(device), prior.to(device)
        self.device, self.explore = device, explore

    def logits_and_value(self, seen: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Log probabilities (n, modes) and values (n,) of observations on any device; 0 without a road user."""
        active = seen.get("active")
        if active is None or bool(active.all()):
            return self._logits(self.policy, seen)
        rows = active.nonzero()[:, 0]
        some, worth = self._logits(self.policy, {name: value[rows] for name, value in seen.items()})
        logits, values = some.new_zeros(len(active), some.shape[1]), worth.new_zeros(len(active))
        logits[rows], values[rows] = some, worth
        return logits, values

    def prior_logits(self, seen: dict[str, Tensor]) -> Tensor:
        """Log probabilities (n, modes) of the bundle's prior, at least RAREST."""
        vector = seen["vector"].to(self.device)
        with torch.no_grad():
            return torch.log_softmax(self.prior.logits(vector, _kind(vector)), -1).clamp_min(RAREST)

    def _logits(self, policy: Policy, seen: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        vector, rollouts = (seen[name].to(self.device) for name in ("vector", "rollouts"))
        optional = ("image", "route", "action_mask")
        image, route, mask = (seen[name].to(self.device) if name in seen else None for name in optional)
        kind = _kind(vector)
        mask = None if mask is None else mask.bool()
        return policy_logits(policy, self.prior, vector, image, kind, rollouts, route, mask=mask, explore=self.explore)


def _kind(vector: Tensor) -> Tensor:
    """RoadUserType of feature vectors (n, 12), (n,)."""
    return vector[:, CAR : CAR + 3].argmax(-1)


class Agent(Actor):
    """The policy that is trained, with a copy of its initial state and the optimiser."""

    def __init__(self, policy: Policy, prior: Prior, settings: PpoSettings, device: torch.device) -> None:
        super().__init__(policy, prior, settings.explore, device)
        self.begin = copy.deepcopy(policy).requires_grad_(False)
        self.optimizer = torch.optim.Adam(self.policy.parameters(), lr=settings.learning_rate, eps=1e-5, fused=True)

    def teacher_logits(self, seen: dict[str, Tensor], teacher_costs: Tensor) -> Tensor:
        """Log probabilities (n, modes) of the teacher: see PpoSettings.kl_coef."""
        parts = []
        with torch.no_grad():
            for rows in torch.split(torch.arange(len(teacher_costs)), 2048):
                taught, _ = self._logits(self.begin, {name: value[rows] for name, value in seen.items()})
                parts.append(torch.log_softmax(taught - teacher_costs[rows], -1))
        return torch.cat(parts)


def rollout(
    agent: Actor,
    env: Slots,
    observation: dict[str, NDArray[Any]],
    teacher_costs: NDArray[np.float32],
    num_steps: int,
    generator: torch.Generator,
) -> tuple[Batch, dict[str, NDArray[Any]], list[dict[str, Any]], NDArray[np.float32]]:
    """T steps of all slots from `observation` on, with its `teacher_costs` (N, modes).

    Returns the batch, the observation after it, the infos of every step, and the teacher_costs of that observation.
    """
    shape = (num_steps, env.num_envs)
    seen = {
        name: torch.empty(*shape, *value.shape[1:], dtype=torch.from_numpy(value).dtype)
        for name, value in observation.items()
    }
    guided = torch.empty(*shape, teacher_costs.shape[1])
    actions = torch.empty(shape, dtype=torch.int64)
    logprobs, values, rewards, final_values = (torch.zeros(shape) for _ in range(4))
    terminated, truncated = (torch.empty(shape, dtype=torch.bool) for _ in range(2))
    final: list[tuple[int, NDArray[np.intp], dict[str, NDArray[Any]]]] = []
    infos: list[dict[str, Any]] = []
    with torch.no_grad():
        for t in range(num_steps):
            for name, value in observation.items():
                seen[name][t] = torch.from_numpy(value)
            guided[t] = torch.from_numpy(teacher_costs)
            logits, worth = agent.logits_and_value({name: value[t] for name, value in seen.items()})
            logits, values[t] = logits.cpu(), worth.cpu()
            actions[t] = torch.multinomial(logits.exp(), 1, generator=generator)[:, 0]
            logprobs[t] = logits.gather(1, actions[t][:, None])[:, 0]
            observation, reward, over, cut, info = env.step(actions[t].numpy())
            rewards[t], teacher_costs = torch.from_numpy(reward), info["teacher_costs"]
            terminated[t], truncated[t] = torch.from_numpy(over), torch.from_numpy(cut)
            if cut.any():
                rows = np.flatnonzero(cut)
                final.append((t, rows, {name: value[rows] for name, value in info["final_obs"].items()}))
            infos.append(
                {name: values for name, values in info.items() if "final" not in name and name != "teacher_costs"}
            )
        if final:
            _, worth = agent.logits_and_value(
                {name: torch.from_numpy(np.concatenate([last[name] for *_, last in final])) for name in observation}
            )
            times = np.concatenate([np.full(len(rows), t) for t, rows, _ in final])
            final_values[times, np.concatenate([rows for _, rows, _ in final])] = worth.cpu()
        _, next_value = agent.logits_and_value({n: torch.from_numpy(value) for n, value in observation.items()})
    batch = Batch(
        seen, actions, logprobs, values, rewards, terminated, truncated, final_values, next_value.cpu(), guided
    )
    return batch, observation, infos, teacher_costs


def update(
    agent: Agent,
    batch: Batch,
    settings: PpoSettings,
    generator: torch.Generator,
    *,
    kl_coef: float = 0.0,
    teacher_only: bool = False,
) -> dict[str, float]:
    """One PPO update on a rollout. Returns the figures that CleanRL logs (losses, approx_kl, clipfrac,
    explained_variance), kl_teacher (see PpoSettings.kl_coef) and kl_prior.

    Advantages are normalised within each type: the returns of pedestrians differ less than those of cars.
    """
    advantages, returns = gae(batch, settings.gamma, settings.gae_lambda)
    active = batch.active.flatten()

    def taken(values: Tensor) -> Tensor:
        """The rows of slots with a road user."""
        return values.flatten(0, 1)[active].to(agent.device)

    flat = {name: taken(getattr(batch, name)) for name in ("actions", "logprobs", "values")}
    seen = {name: taken(value) for name, value in batch.seen.items() if name != "active"}
    teacher = agent.teacher_logits(seen, taken(batch.teacher_costs)) if kl_coef else None
    prior = agent.prior_logits(seen) if settings.prior_coef and not teacher_only else None
    b_advantages, b_returns = taken(advantages), taken(returns)
    if settings.norm_adv:
        b_advantages = _normalised(b_advantages, _kind(seen["vector"]))
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
                kl_teacher = (teacher[mb].exp() * (teacher[mb] - logits)).sum(-1).mean()
                loss = loss + kl_coef * kl_teacher
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


def _normalised(advantages: Tensor, kind: Tensor) -> Tensor:
    """Advantages (n,) with mean 0 and deviation 1 within each type."""
    result = torch.zeros_like(advantages)
    for rows in (kind == k for k in range(3)):
        if rows.sum() > 1:
            result[rows] = (advantages[rows] - advantages[rows].mean()) / (advantages[rows].std() + 1e-8)
    return result


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

    Every `reset_every` iterations all simulations restart, drawn by `seed` and the iteration alone: a training that is
    resumed there continues exactly as without the interruption. `iterations` must begin at such a point.
    """
    if iterations.start % reset_every:
        raise ValueError("training can be resumed only where simulations restart")
    generator = torch.Generator()
    for iteration in iterations:
        number = int(np.random.SeedSequence([seed, iteration]).generate_state(1)[0] >> 1)
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
