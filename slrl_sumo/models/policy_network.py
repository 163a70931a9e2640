"""The trained selector's network without PyTorch, for decisions; slrl_sumo.models.policy has the network for training.

selector.json          its shapes (PolicyConfig) and the record of its training
selector.safetensors   its weights
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file

from slrl_sumo.errors import InputError
from slrl_sumo.input_files import read_json
from slrl_sumo.models.bundle_folder import POLICY_FILES
from slrl_sumo.models.motion_models import MODES, SPEED, Networks, Singles, Weights, layer, outputs
from slrl_sumo.perception.features import COUNTS, FEATURES, STATES
from slrl_sumo.perception.presets import PRESETS
from slrl_sumo.perception.route_features import PATH_FEATURES, ROUTE_FEATURES
from slrl_sumo.scene.types import RoadUserType

HEADING = FEATURES.index("heading")
KNOWN = ROUTE_FEATURES.index("known")
ROLLOUT_SCALES = {"collision": 2.0, "off_surface": 1.0, "speed": 0.2, "turn": 1.0}
"""Fields of the mode rollouts that a policy reads, and the factors that scale them to order 1."""
ROUTE_FIT_SCALES = {
    "heading_error": 4.0,
    "lateral_offset": 0.5,
    "speed_error": 2.0,
    "stop_ratio": 1.0,
    "follow_ratio": 1.0,
}
"""The same for the fit of each mode to the route, in the preset `extended`."""
MOTION_SCALES = (0.1, 0.3, 1.0, 1.0, 1.0)
"""The same for the columns of the vector before the heading."""
COUNT_SCALE = 0.5
"""The same for the logarithms of the counts of road users."""
HISTORY_SCALES = {"yaw_rate": 2.0, "speed_": 0.1, "near_": 1.0}
"""The same for the columns of the state `history` after the columns of the paper, by the prefixes of their names."""
MPS_SCALE = 0.2
"""The same for relative velocities."""
LEAST_PRIOR = -4.0
"""Least log probability of the prior, so that training can find modes that the prior has never seen."""
EXCLUDED_LOGIT = -1e4
"""Log probability of a mode that is not allowed: its exponential is 0, and 0 times it is 0 (unlike -inf)."""


@dataclass(frozen=True)
class PolicyConfig:
    """Shapes of a policy, and the parts of the observation that it reads."""

    preset: str = "paper"
    """One of perception.presets.PRESETS."""
    modes: int = MODES
    channels: tuple[int, ...] = (16, 32, 32)
    """Channels of the convolutions, each with stride 2: each leaves a quarter of the pixels."""
    hidden: int = 128
    head: int = 64
    lookahead: bool = True
    """Whether the policy also reads the mode rollouts, if its preset has them."""
    image: bool = True
    """Whether the policy reads the image."""
    prior_logits: bool = True
    """Whether the prior's log probabilities are added to the policy's logits. They slow road users with a route: on an
    empty road, the prior expects a car to keep its speed, not to accelerate."""

    @property
    def looks_ahead(self) -> bool:
        """Whether the policy reads the mode rollouts."""
        return self.lookahead and PRESETS[self.preset].looks_ahead

    @property
    def rollout_features(self) -> tuple[str, ...]:
        """Names of the fields of the mode rollouts that the policy reads, in the order of its inputs."""
        return (*ROLLOUT_SCALES, *(ROUTE_FIT_SCALES if self.preset == "extended" else ()))

    @property
    def vector_columns(self) -> tuple[str, ...]:
        """Names of the columns of Observation.vector for the policy, including the heading, which is not read."""
        return STATES[PRESETS[self.preset].state]

    @property
    def route_columns(self) -> int:
        """Number of columns of Observation.route that the policy reads."""
        preset = PRESETS[self.preset]
        return len(ROUTE_FEATURES) * preset.knows_route + len(PATH_FEATURES) * preset.path

    @property
    def inputs(self) -> int:
        """Inputs of the trunk without those of the image."""
        return len(self.vector_columns) - 1 + self.route_columns

    @property
    def scorer_inputs(self) -> int:
        """Inputs of the scorers: the rollouts and products of theirs."""
        return len(self.rollout_features) + (4 if self.preset == "extended" else 2)

    @property
    def scorer_hidden(self) -> int:
        """Outputs of the first layer of the scorers."""
        return 64 if self.preset == "extended" else 32


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


class PolicyFiles(NamedTuple):
    """What a bundle's folder says of its policy."""

    config: PolicyConfig
    weights: Weights
    training: dict[str, Any]
    without_route: Singles
    """(3, 2), see Policy."""


@contextmanager
def damage_reported(folder: Path) -> Iterator[None]:
    """What goes wrong inside is an InputError that says that the policy of the bundle `folder` is damaged."""
    try:
        yield
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RuntimeError, SafetensorError) as error:
        reason = " ".join(str(getattr(error, "strerror", None) or error).split())[:300]
        raise InputError(
            f"bundle {folder}: its selector is damaged ({reason}); copy the bundle again, or train it anew"
        ) from error


def read_policy_files(folder: Path, modes: int) -> PolicyFiles | None:
    """The policy's files of a bundle's folder with `modes` modes; None where it has none. The shapes of the weights are
    not compared with those of the configuration. Raises InputError where they are damaged or not for this version."""
    there = [(folder / name).is_file() for name in POLICY_FILES]
    if not any(there):
        return None
    if not all(there):
        missing = POLICY_FILES[there.index(False)]
        raise InputError(f"bundle {folder}: its selector is damaged ({missing} missing); copy the bundle again")
    with damage_reported(folder):
        values = read_json(folder / POLICY_FILES[0])
        training = dict(values.pop("training"))
        shapes: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        config = PolicyConfig(**shapes)
        if config.preset not in PRESETS:
            *others, last = PRESETS
            raise InputError(
                f"bundle {folder}: its selector reads preset '{config.preset}', this slrl_sumo runs "
                f"{', '.join(others)} and {last}"
            )
        if config.modes != modes:
            raise ValueError(f"it chooses among {config.modes} modes, the bundle has {modes}")
        sizes = [config.hidden, config.head, *config.channels]
        if len(sizes) > 16 or not all(type(size) is int and 0 < size <= 65536 for size in sizes):
            raise ValueError("its sizes are impossible")
        weights = load_file(folder / POLICY_FILES[1])
        types = len(RoadUserType)
        without_route = np.array(training.get("without_route", np.ones((types, 2))), np.float32)
        expected_route = np.array(training.get("expected_route", np.zeros((types, 2))), np.float32)
        if without_route.shape != (types, 2) or expected_route.shape != (types, 2):
            raise ValueError("without_route or expected_route")
        if not all(bool(np.isfinite(value).all()) for value in (*weights.values(), without_route, expected_route)):
            raise ValueError("weights that are not finite")
    return PolicyFiles(config, weights, training, without_route)


def read_network(folder: Path, files: PolicyFiles) -> PolicyNetwork:
    """The network of the files in `folder` of a policy without image. Raises InputError where they do not fit."""
    with damage_reported(folder):
        expected, found = _shapes(files.config), {name: value.shape for name, value in files.weights.items()}
        if odd := sorted(expected.items() ^ found.items()):
            raise ValueError(f"{odd[0][0]} is {found.get(odd[0][0])} instead of {expected.get(odd[0][0])}")
    return PolicyNetwork.of(files.config, files.weights, files.without_route)


def _shapes(config: PolicyConfig) -> dict[str, tuple[int, ...]]:
    """Of the weights of a policy without image, by their names; nothing is allocated."""
    layers = {"trunk.0": (config.hidden, config.inputs)}
    for one in range(len(RoadUserType)):
        layers |= {f"actors.{one}.0": (config.head, config.hidden), f"actors.{one}.2": (config.modes, config.head)}
        layers |= {f"critics.{one}.0": (config.head, config.hidden), f"critics.{one}.2": (1, config.head)}
        if config.looks_ahead:
            inner = (config.scorer_hidden, config.scorer_inputs)
            layers |= {f"scorers.{one}.0": inner, f"scorers.{one}.2": (1, config.scorer_hidden)}
    shapes: dict[str, tuple[int, ...]] = {f"{name}.weight": shape for name, shape in layers.items()}
    return shapes | {f"{name}.bias": shape[:1] for name, shape in layers.items()}


def normalised(vector: Singles, columns: tuple[str, ...] = FEATURES) -> Singles:
    """As policy._normalised: the `columns` of the vector without the heading, each of order 1, (n, columns - 1)."""
    motion = vector[:, :HEADING] * np.array(MOTION_SCALES, np.float32)
    counts = np.float32(COUNT_SCALE) * np.log1p(vector[:, COUNTS : len(FEATURES)])
    history = vector[:, len(FEATURES) : len(columns)] * np.array(history_scales(columns), np.float32)
    return np.concatenate([motion, counts, history], axis=1)


@cache
def history_scales(columns: tuple[str, ...]) -> tuple[float, ...]:
    """Factors that bring the `columns` of a vector after those of the paper to order 1."""
    return tuple(
        MPS_SCALE
        if name.endswith("_mps")
        else next(scale for begin, scale in HISTORY_SCALES.items() if name.startswith(begin))
        for name in columns[len(FEATURES) :]
    )


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
