"""The policy for rollouts and updates."""

import copy

import torch
from torch import Tensor

from slrl_sumo.models.policy import Policy, policy_logits
from slrl_sumo.models.prior import Prior
from slrl_sumo.perception.features import FEATURES

LOWEST_PRIOR = -8.0
"""Lower bound of the prior's log probabilities, so that a mode that was never recorded has a bounded cost."""
CAR = FEATURES.index("car")
"""First column of the one-hot type in the vector."""


class Actor:
    """The policy on a device, for rollouts."""

    def __init__(self, policy: Policy, prior: Prior, explore: float, device: torch.device) -> None:
        self.policy, self.prior = policy.to(device), prior.to(device)
        self.device, self.explore = device, explore

    def logits_and_value(self, seen: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Log probabilities (n, modes) and values (n,) of observations on any device; 0 for slots without a road
        user."""
        active = seen.get("active")
        if active is None or bool(active.all()):
            return self._logits(self.policy, seen)
        rows = active.nonzero()[:, 0]
        some, worth = self._logits(self.policy, {name: value[rows] for name, value in seen.items()})
        logits, values = some.new_zeros(len(active), some.shape[1]), worth.new_zeros(len(active))
        logits[rows], values[rows] = some, worth
        return logits, values

    def prior_logits(self, seen: dict[str, Tensor]) -> Tensor:
        """Log probabilities (n, modes) of the bundle's prior, at least LOWEST_PRIOR."""
        vector = seen["vector"].to(self.device)
        with torch.no_grad():
            return torch.log_softmax(self.prior.logits(vector, kind_of(vector)), -1).clamp_min(LOWEST_PRIOR)

    def _logits(self, policy: Policy, seen: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        vector, optional = seen["vector"].to(self.device), ("image", "rollouts", "route", "action_mask")
        image, rollouts, route, mask = (seen[name].to(self.device) if name in seen else None for name in optional)
        kind = kind_of(vector)
        mask = None if mask is None else mask.bool()
        return policy_logits(policy, self.prior, vector, image, kind, rollouts, route, mask=mask, explore=self.explore)


def kind_of(vector: Tensor) -> Tensor:
    """RoadUserType of feature vectors (n, 12), (n,)."""
    return vector[:, CAR : CAR + 3].argmax(-1)


class Agent(Actor):
    """The trained policy, with a copy of its initial state and the optimiser."""

    def __init__(
        self, policy: Policy, prior: Prior, explore: float, learning_rate: float, device: torch.device
    ) -> None:
        super().__init__(policy, prior, explore, device)
        self.begin = copy.deepcopy(policy).requires_grad_(False)
        self.optimizer = torch.optim.Adam(self.policy.parameters(), lr=learning_rate, eps=1e-5, fused=True)

    def teacher_logits(self, seen: dict[str, Tensor], teacher_costs: Tensor) -> Tensor:
        """Log probabilities (n, modes) of the teacher: see PpoSettings.kl_coef."""
        parts = []
        with torch.no_grad():
            for rows in torch.split(torch.arange(len(teacher_costs)), 2048):
                taught, _ = self._logits(self.begin, {name: value[rows] for name, value in seen.items()})
                parts.append(torch.log_softmax(taught - teacher_costs[rows], -1))
        return torch.cat(parts)
