"""A rollout as tensors: observations, actions and rewards, and the advantages of the actions."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor


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
        """(T, N) bool: whether the slot had a road user."""
        return self.seen["active"].bool() if "active" in self.seen else torch.ones_like(self.terminated)


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

    A truncated episode bootstraps from the value of its last observation, a terminated episode from 0; neither depends
    on the next episode in its slot.
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


def normalised(advantages: Tensor, kind: Tensor) -> Tensor:
    """Advantages (n,) with mean 0 and deviation 1 within each type."""
    result = torch.zeros_like(advantages)
    for rows in (kind == k for k in range(3)):
        if rows.sum() > 1:
            result[rows] = (advantages[rows] - advantages[rows].mean()) / (advantages[rows].std() + 1e-8)
    return result
