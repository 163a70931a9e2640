"""The selector's policy: a network that corrects the prior by the observation (paper, sections 3.1 and 3.4)."""

import math
from collections.abc import Sequence
from typing import TypeVar

import torch
from torch import Tensor, nn

from slrl_sumo.models.motion_models import SPEED
from slrl_sumo.models.policy_config import (
    COUNT_SCALE,
    MOTION_SCALES,
    ROLLOUT_SCALES,
    ROUTE_FIT_SCALES,
    PolicyConfig,
    history_scales,
)
from slrl_sumo.models.policy_network import EXCLUDED_LOGIT, HEADING, KNOWN, LEAST_PRIOR
from slrl_sumo.models.prior import Prior
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS
from slrl_sumo.perception.features import COUNTS, FEATURES
from slrl_sumo.scene.types import TYPE_NAMES, RoadUserType

Layer = TypeVar("Layer", nn.Linear, nn.Conv2d)


IMAGES_AT_ONCE = 256
"""Number of images that are encoded at once: 1,024 take twice as long per image, because they exceed the cache."""


class Policy(nn.Module):
    """Distribution over modes and value of n observations; type-specific heads on a shared trunk.

    The logits are the network's own, which begin at zero, usually plus the logits of the prior: before any training,
    the policy then equals the supervised baseline. The absolute heading is not read, so that a rotated network gives
    the same choices.

    without_route: (3, 2) by type, weights of the heads and the scorers for road users without a known route, in the
        preset `extended`, which learns only with routes; see slrl_sumo.learning.supervised.without_route. If a weight
        is not 1, the prior's logits are added in any case.
    with_route: (3, 2), the same for road users with a known route: 1, except for expected routes
        (slrl_sumo.routing.expected_routes).
    """

    without_route: Tensor
    with_route: Tensor

    def __init__(self, config: PolicyConfig) -> None:
        super().__init__()
        self.config = config
        types = len(RoadUserType)
        inputs = config.inputs
        if config.image:
            self.encoder = _encoder(config)
            inputs += config.hidden
        self.trunk = nn.Sequential(_scaled(nn.Linear(inputs, config.hidden)), _rectifier())
        self.scorers = nn.ModuleList(_scorer(config) for _ in range(types if config.looks_ahead else 0))
        self.actors = nn.ModuleList(_head(config, config.modes, 0.0) for _ in range(types))
        self.critics = nn.ModuleList(_head(config, 1, 1.0) for _ in range(types))
        # Stored in the record of the training, because the weights file contains only trained weights.
        self.register_buffer("without_route", torch.ones(types, 2), persistent=False)
        self.register_buffer("with_route", torch.ones(types, 2), persistent=False)

    def forward(
        self,
        vector: Tensor,
        image: Tensor | None,
        kind: Tensor,
        rollouts: Tensor | None = None,
        route: Tensor | None = None,
    ) -> tuple[Tensor, Tensor]:
        """The network's own logits, (n, modes), and the value, (n,).

        `vector`: (n, 12) feature vectors, in the preset `image` (n, 33), with the last 2 s and the nearest road users.
        `image`: (n, EGO_ROWS, EGO_COLS, 3) uint8, for policies that read images. `kind`: (n,) int64 types. `rollouts`:
        (n, modes, features), columns as in `PolicyConfig.rollout_features`, for policies that read rollouts. `route`:
        (n, 14) in the preset `extended`, (n, 30) in the preset `image`.
        """
        seen = self._seen(vector, image, route)
        types = _Types(kind)
        return self._correction(seen, vector, kind, types, rollouts, route), types.each(self.critics, seen)[:, 0]

    def correction(
        self,
        vector: Tensor,
        image: Tensor | None,
        kind: Tensor,
        rollouts: Tensor | None = None,
        route: Tensor | None = None,
    ) -> Tensor:
        """Only the first result of `forward`."""
        return self._correction(self._seen(vector, image, route), vector, kind, _Types(kind), rollouts, route)

    def parts(
        self, vector: Tensor, image: Tensor | None, kind: Tensor, rollouts: Tensor | None, route: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        """The logits of the heads and of the scorers, (n, modes) each, before weighting by `without_route`."""
        return self._parts(self._seen(vector, image, route), vector, _Types(kind), rollouts)

    def _seen(self, vector: Tensor, image: Tensor | None, route: Tensor | None) -> Tensor:
        """Output of the trunk for n observations, (n, hidden)."""
        known = [_normalised(vector, self.config.vector_columns)]
        if self.config.image:
            assert image is not None
            known.insert(0, torch.cat([self._encoded(some) for some in torch.split(image, IMAGES_AT_ONCE)]))
        if self.config.route_columns:
            assert route is not None
            known.append(route)
        seen: Tensor = self.trunk(torch.cat(known, -1))
        return seen

    def _encoded(self, image: Tensor) -> Tensor:
        # Scale colours to -1..1: with 0..1, learning took four times as long.
        features: Tensor = self.encoder(image.permute(0, 3, 1, 2).float().div_(127.5).sub_(1.0))
        return features

    def _correction(
        self,
        seen: Tensor,
        vector: Tensor,
        kind: Tensor,
        types: "_Types",
        rollouts: Tensor | None,
        route: Tensor | None,
    ) -> Tensor:
        heads, scorers = self._parts(seen, vector, types, rollouts)
        if not self.config.route_columns:
            return heads + scorers
        assert route is not None
        share = self.shares(route, kind)
        return share[:, :1] * heads + share[:, 1:] * scorers

    def shares(self, route: Tensor, kind: Tensor) -> Tensor:
        """Weights of heads and scorers, (n, 2)."""
        return torch.where(route[:, KNOWN, None] > 0.0, self.with_route[kind], self.without_route[kind])

    def _parts(self, seen: Tensor, vector: Tensor, types: "_Types", rollouts: Tensor | None) -> tuple[Tensor, Tensor]:
        heads = types.each(self.actors, seen)
        if not self.config.looks_ahead:
            return heads, torch.zeros_like(heads)
        assert rollouts is not None
        return heads, types.each(self.scorers, self._rated(rollouts, vector))[..., 0]

    def _rated(self, rollouts: Tensor, vector: Tensor) -> Tensor:
        """Inputs of the scorers: rollouts of order 1, and products that a layer cannot form, (n, modes, inputs)."""
        names, scales = self.config.rollout_features, {**ROLLOUT_SCALES, **ROUTE_FIT_SCALES}
        columns = rollouts * rollouts.new_tensor([scales[name] for name in names])
        speed = vector[:, None, SPEED, None].expand(*rollouts.shape[:2], 1)
        parts = [columns, _column(rollouts, names, "turn").abs(), 0.2 * speed]
        if self.config.preset == "extended":
            # Steering matters for moving road users.
            steering = _column(columns, names, "heading_error") * (0.5 * speed).clamp(0.2, 1.0)
            parts += [steering, _column(columns, names, "speed_error").abs()]
        return torch.cat(parts, -1)


class _Types:
    """Rows sorted by type, so that each row uses only the head of its type."""

    def __init__(self, kind: Tensor) -> None:
        self._order = kind.argsort()
        self._back = self._order.argsort()
        self._counts = torch.bincount(kind, minlength=len(RoadUserType)).tolist()

    def each(self, heads: nn.ModuleList, x: Tensor) -> Tensor:
        """Output of the head of the row's type for each row of `x` (n, ...): (n, ..., out)."""
        parts = list(zip(heads, torch.split(x[self._order], self._counts), strict=True))
        if not torch.is_grad_enabled():
            # A head without rows costs as much as with a few rows; in training it still needs a gradient of zeros.
            parts = [(head, part) for head, part in parts if len(part)] or parts[:1]
        return torch.cat([head(part) for head, part in parts])[self._back]


def learn_only(policy: Policy, types: Sequence[str]) -> None:
    """Freeze all weights except those of the heads of `types`, by name."""
    policy.requires_grad_(False)
    for heads in (policy.actors, policy.scorers, policy.critics):
        for kind, head in enumerate(heads):
            head.requires_grad_(TYPE_NAMES[kind] in types)


def policy_logits(
    policy: Policy,
    prior: Prior,
    vector: Tensor,
    image: Tensor | None,
    kind: Tensor,
    rollouts: Tensor | None = None,
    route: Tensor | None = None,
    *,
    mask: Tensor | None = None,
    explore: float = 0.0,
) -> tuple[Tensor, Tensor]:
    """Log probabilities of all modes, (n, modes), and values (n,); arguments as in `Policy.forward`.

    Modes with a False `mask` (n, modes) are excluded. The share `explore` of choices is drawn uniformly from the
    allowed modes.

    The prior is frozen; its log probabilities have a lower bound of -4, so that training can find modes that the prior
    has never seen. If the weights of the correction are below 1 (Policy.without_route), there is no bound, and the
    prior counts in any case.
    """
    correction, value = policy(vector, image, kind, rollouts, route)
    logits = _corrected(policy, prior, vector, kind, correction, route)
    if mask is not None:
        logits = masked(logits, mask)
    if explore:
        count = logits.shape[-1] if mask is None else mask.sum(-1, keepdim=True)
        uniform = torch.log(explore / torch.as_tensor(count, dtype=logits.dtype)).expand_as(logits)
        logits = torch.logaddexp(logits + math.log1p(-explore), uniform)
        logits = logits if mask is None else logits.masked_fill(~mask, EXCLUDED_LOGIT)
    return logits, value


def masked(logits: Tensor, mask: Tensor) -> Tensor:
    """Log probabilities (n, modes) of the modes that `mask` (n, modes) allows."""
    return torch.log_softmax(logits.masked_fill(~mask, EXCLUDED_LOGIT), -1)


def choice_logits(
    policy: Policy,
    prior: Prior,
    vector: Tensor,
    image: Tensor | None,
    kind: Tensor,
    rollouts: Tensor | None = None,
    route: Tensor | None = None,
) -> Tensor:
    """Only the log probabilities of `policy_logits`, without values."""
    return _corrected(policy, prior, vector, kind, policy.correction(vector, image, kind, rollouts, route), route)


def _corrected(
    policy: Policy, prior: Prior, vector: Tensor, kind: Tensor, correction: Tensor, route: Tensor | None
) -> Tensor:
    learned = torch.ones_like(kind, dtype=torch.bool)
    if route is not None:
        learned = (policy.shares(route, kind) == 1.0).all(-1)
    with torch.no_grad():
        if policy.config.prior_logits:
            known = torch.log_softmax(prior.logits(vector, kind), -1)
            # The bound lets training find modes that the prior has never seen; without training it would be noise.
            known = torch.where(learned[:, None], known.clamp_min(LEAST_PRIOR), known)
        else:
            known = torch.zeros_like(correction)
            if not learned.all():
                known[~learned] = torch.log_softmax(prior.logits(vector[~learned], kind[~learned]), -1)
    return torch.log_softmax(known + correction, -1)


def _normalised(vector: Tensor, columns: tuple[str, ...]) -> Tensor:
    """The `columns` of the vector without the heading, each of order 1: (n, columns - 1). A vector may have more."""
    motion = vector[:, :HEADING] * vector.new_tensor(MOTION_SCALES)
    counts = COUNT_SCALE * torch.log1p(vector[:, COUNTS : len(FEATURES)])
    history = vector[:, len(FEATURES) : len(columns)] * vector.new_tensor(history_scales(columns))
    return torch.cat([motion, counts, history], -1)


def _column(values: Tensor, names: tuple[str, ...], name: str) -> Tensor:
    """The column of this name, (n, modes, 1)."""
    place = names.index(name)
    return values[..., place : place + 1]


def _encoder(config: PolicyConfig) -> nn.Sequential:
    layers: list[nn.Module] = []
    inputs, rows, cols = 3, EGO_ROWS, EGO_COLS
    for k, channels in enumerate(config.channels):
        kernel = 5 if k == 0 else 3
        layers += [_scaled(nn.Conv2d(inputs, channels, kernel, stride=2, padding=kernel // 2)), _rectifier()]
        inputs, rows, cols = channels, (rows + 1) // 2, (cols + 1) // 2
    return nn.Sequential(*layers, nn.Flatten(), _scaled(nn.Linear(inputs * rows * cols, config.hidden)), _rectifier())


def _scorer(config: PolicyConfig) -> nn.Sequential:
    """Network that rates a mode from its rollout; its output is 0 at first."""
    first = _scaled(nn.Linear(config.scorer_inputs, config.scorer_hidden))
    return nn.Sequential(first, _rectifier(), _scaled(nn.Linear(config.scorer_hidden, 1), 0.0))


def _head(config: PolicyConfig, outputs: int, gain: float) -> nn.Sequential:
    return nn.Sequential(
        _scaled(nn.Linear(config.hidden, config.head)), _rectifier(), _scaled(nn.Linear(config.head, outputs), gain)
    )


def _rectifier() -> nn.ReLU:
    # In place, because the input is no longer needed, and small networks are limited by memory access.
    return nn.ReLU(inplace=True)


def _scaled(layer: Layer, gain: float = 2**0.5) -> Layer:
    """Orthogonal weights and no bias, the usual start of PPO (CleanRL's layer_init)."""
    nn.init.orthogonal_(layer.weight, gain) if gain else nn.init.zeros_(layer.weight)
    assert layer.bias is not None
    nn.init.zeros_(layer.bias)
    return layer
