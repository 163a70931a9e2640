"""The trained selector's network without PyTorch, for decisions; slrl_sumo.models.policy is the one for training."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.models.motion_models import SPEED, Networks, Singles, Weights, layer, outputs
from slrl_sumo.models.policy_config import (
    COUNT_SCALE,
    MOTION_SCALES,
    ROLLOUT_SCALES,
    ROUTE_FIT_SCALES,
    PolicyConfig,
    history_scales,
)
from slrl_sumo.perception.features import COUNTS, FEATURES
from slrl_sumo.perception.route_features import ROUTE_FEATURES
from slrl_sumo.scene.types import RoadUserType

HEADING = FEATURES.index("heading")
KNOWN = ROUTE_FEATURES.index("known")
LEAST_PRIOR = -4.0
"""Least log probability of the prior, so that training can find modes that the prior has never seen."""
EXCLUDED_LOGIT = -1e4
"""Log probability of a mode that is not allowed: its exponential is 0, and 0 times it is 0 (unlike -inf)."""


class Layer(NamedTuple):
    """A linear layer by type, as `motion_models.layer` takes it."""

    weight: Singles
    """(types, 1, in, out)."""
    bias: Singles
    """(types, 1, 1, out)."""


@dataclass(frozen=True, eq=False)
class PolicyNetwork:
    """See slrl_sumo.models.policy.Policy: the same function of the same weights, for policies that read no image.

    Each road user's logits depend on its own row alone.
    """

    config: PolicyConfig
    trunk: Layer
    actors: tuple[Layer, Layer]
    scorers: tuple[Layer, Layer] | None
    """None for policies that do not look ahead."""
    without_route: Singles
    """(3, 2), see Policy."""
    with_route: Singles
    """(3, 2), see Policy."""

    @classmethod
    def of(
        cls, config: PolicyConfig, weights: Weights, without_route: Singles, with_route: Singles | None = None
    ) -> "PolicyNetwork":
        """The network of the `weights` of a policy, by their names in its file."""
        types = range(len(RoadUserType))

        def stacked(name: str) -> Layer:
            each = [name.format(type=one) for one in types]
            weight = np.stack([weights[f"{one}.weight"].T for one in each])[:, None]
            return Layer(
                np.ascontiguousarray(weight), np.stack([weights[f"{one}.bias"] for one in each])[:, None, None]
            )

        actors = stacked("actors.{type}.0"), stacked("actors.{type}.2")
        scorers = (stacked("scorers.{type}.0"), stacked("scorers.{type}.2")) if config.looks_ahead else None
        with_route = np.ones_like(without_route) if with_route is None else with_route
        return cls(config, stacked("trunk.0"), actors, scorers, without_route, with_route)

    def choice_logits(
        self,
        prior: Networks,
        vector: Singles,
        kind: NDArray[np.int64],
        rollouts: Singles | None,
        route: Singles | None,
    ) -> Singles:
        """As policy.choice_logits: log probabilities of all modes, (n, modes)."""
        correction = self._correction(vector, kind, rollouts, route)
        learned = np.ones(len(kind), np.bool_)
        if route is not None:
            learned = (self._shares(route, kind) == 1.0).all(axis=1)
        known = np.zeros_like(correction)
        asked = np.flatnonzero(~learned | self.config.prior_logits)
        if len(asked):
            known[asked] = log_softmax(outputs(prior, vector[asked], kind[asked])[:, 0])
        known[learned] = known[learned].clip(LEAST_PRIOR)
        return log_softmax(known + correction)

    def _correction(
        self, vector: Singles, kind: NDArray[np.int64], rollouts: Singles | None, route: Singles | None
    ) -> Singles:
        known = [normalised(vector, self.config.vector_columns)]
        if self.config.route_columns:
            assert route is not None
            known.append(route)
        seen = _rectified(self.trunk, np.concatenate(known, axis=1)[:, None], kind)
        heads = layer(_rectified(self.actors[0], seen, kind), kind, *self.actors[1])[:, 0]
        if self.scorers is None:
            scores = np.zeros_like(heads)
        else:
            assert rollouts is not None
            rated = self._rated(rollouts, vector)
            each = np.repeat(kind, rated.shape[1])
            inner = _rectified(self.scorers[0], rated.reshape(-1, 1, rated.shape[2]), each)
            scores = layer(inner, each, *self.scorers[1]).reshape(heads.shape)
        if route is None:
            return heads + scores
        share = self._shares(route, kind)
        return share[:, :1] * heads + share[:, 1:] * scores

    def _shares(self, route: Singles, kind: NDArray[np.int64]) -> Singles:
        """How much heads and scorers count, (n, 2)."""
        shares: Singles = np.where(route[:, KNOWN, None] > 0.0, self.with_route[kind], self.without_route[kind])
        return shares

    def _rated(self, rollouts: Singles, vector: Singles) -> Singles:
        """Inputs of the scorers, as Policy makes them, (n, modes, inputs)."""
        names = self.config.rollout_features
        scales = {**ROLLOUT_SCALES, **ROUTE_FIT_SCALES}
        columns = rollouts * np.array([scales[name] for name in names], np.float32)
        speed = np.broadcast_to(vector[:, SPEED, None, None], (*rollouts.shape[:2], 1))

        def column(values: Singles, name: str) -> Singles:
            place = names.index(name)
            return values[..., place : place + 1]

        parts = [columns, np.abs(column(rollouts, "turn")), np.float32(0.2) * speed]
        if self.config.preset == "extended":
            steering = column(columns, "heading_error") * (np.float32(0.5) * speed).clip(0.2, 1.0)
            parts += [steering, np.abs(column(columns, "speed_error"))]
        return np.concatenate(parts, axis=-1, dtype=np.float32)


def normalised(vector: Singles, columns: tuple[str, ...] = FEATURES) -> Singles:
    """As policy._normalised: the `columns` of the vector without the heading, each of order 1, (n, columns - 1)."""
    motion = vector[:, :HEADING] * np.array(MOTION_SCALES, np.float32)
    counts = np.float32(COUNT_SCALE) * np.log1p(vector[:, COUNTS : len(FEATURES)])
    history = vector[:, len(FEATURES) : len(columns)] * np.array(history_scales(columns), np.float32)
    return np.concatenate([motion, counts, history], axis=1)


def log_softmax(logits: Singles) -> Singles:
    """Log probabilities, (n, modes)."""
    away = logits - logits.max(axis=1, keepdims=True)
    return np.asarray(away - np.log(np.exp(away).sum(axis=1, keepdims=True)))


def masked(logits: Singles, mask: NDArray[np.bool_]) -> Singles:
    """As policy.masked: log probabilities (n, modes) when only modes where `mask` (n, modes) is True may be chosen."""
    return log_softmax(np.where(mask, logits, np.float32(EXCLUDED_LOGIT)))


def _rectified(one: Layer, x: Singles, kind: NDArray[np.int64]) -> Singles:
    """Outputs of a layer with rectifiers, (n, 1, out), of inputs (n, 1, in)."""
    result: Singles = layer(x, kind, *one)
    np.maximum(result, np.float32(0.0), out=result)
    return result
