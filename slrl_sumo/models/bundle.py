"""Model bundles: all learned models in one folder.

config.json           version and shapes (BundleConfig)
weights.safetensors   all weights, bounds, normalisation and mode centres
training.json         record of the training and its measurements
MODEL_CARD.md         the same as text, with the licence of the data
NOTICE                the notice that this licence requires, if any
selector.*            the trained selector, if any (see slrl_sumo.models.policy)
"""

import json
import os
import tempfile
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from slrl_sumo.errors import InputError
from slrl_sumo.models.bundle_config import BundleConfig
from slrl_sumo.models.bundle_files import read_card, read_object, read_training, read_weights
from slrl_sumo.models.bundle_folder import NOTICE, check_replaceable, find_bundle
from slrl_sumo.models.motion_models import MotionModels, Networks, Weights, motion_models, motions, networks
from slrl_sumo.models.policy_files import read_network, read_policy_files
from slrl_sumo.models.policy_network import PolicyNetwork
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES

if TYPE_CHECKING:  # PyTorch takes longer to import than the rest of a start: import it only where needed
    from torch import Tensor

    from slrl_sumo.models.displacement import DisplacementModels
    from slrl_sumo.models.policy import Policy
    from slrl_sumo.models.prior import Prior

Network = TypeVar("Network", "DisplacementModels", "Prior")


@dataclass(frozen=True, eq=False)
class ModelBundle:
    """The learned models of the road user types, with the record of their training."""

    name: str
    config: BundleConfig
    mode_centres: Floats
    """Centres of the clusters of each type and mode, (3, modes, 2) m, ego frame: destinations, or destinations relative
    to the own speed (`training["modes_by"]`, see slrl_sumo.learning.supervised.goals)."""
    mode_counts: NDArray[np.int64]
    """Numbers of training windows of each type and mode, (3, modes); 0 for types without models."""
    weights: Weights
    """Weights of the displacement models and the prior, by the names in the file (see `weights_of`)."""
    training: dict[str, Any]
    """Record of the training and its measurements, plain JSON values."""
    card: str
    """Text of the model card (Markdown)."""
    policy: "Policy | None" = None
    """The trained selector in PyTorch, if it exists and was read so."""
    network: PolicyNetwork | None = None
    """The trained selector for decisions only, if it was read so (see `load_bundle`)."""
    policy_training: dict[str, Any] | None = None
    """Record of the training of the selector, plain JSON values."""

    @property
    def types(self) -> NDArray[np.bool_]:
        """Whether the bundle has models for each type, (3,)."""
        return np.asarray(self.mode_counts.sum(1) > 0)

    def missing(self, types: NDArray[np.bool_]) -> str:
        """Names of the `types` (3,) without models, for messages; empty if all types have models."""
        return " and ".join(TYPE_NAMES[k] for k in np.flatnonzero(types & ~self.types))

    @cached_property
    def models(self) -> MotionModels:
        """The displacement models, for decisions."""
        return motion_models(self.weights, "displacement.")

    @cached_property
    def prior_networks(self) -> Networks:
        """The prior, for decisions."""
        return networks(self.weights, "prior.")

    @cached_property
    def displacement(self) -> "DisplacementModels":
        """The displacement models in PyTorch, for training; on the same memory as `models`."""
        from slrl_sumo.models.displacement import DisplacementModels

        made = DisplacementModels(self.config.modes, self.config.displacement_hidden, len(self.config.features))
        return _with_weights(made, self.weights, "displacement.")

    @cached_property
    def prior(self) -> "Prior":
        """The prior in PyTorch, for training; on the same memory as `prior_networks`."""
        from slrl_sumo.models.prior import Prior

        made = Prior(self.config.modes, self.config.prior_hidden, len(self.config.features))
        return _with_weights(made, self.weights, "prior.")

    @cached_property
    def max_speed(self) -> Floats:
        """Top speed of each type, (3,) m/s."""
        return np.asarray(self.models.max_speed, np.float64)

    @cached_property
    def max_curvature(self) -> Floats:
        """Largest curvature of the turns of each type, (3,) 1/m."""
        return np.asarray(self.models.max_curvature, np.float64)

    @cached_property
    def usual_braking(self) -> Floats:
        """Least acceleration of the models of each type, (3,) m/s²: the 1st percentile of the recordings."""
        return np.asarray(self.models.acceleration_bounds[:, 0], np.float64)

    @cached_property
    def hardest_braking(self) -> Floats:
        """Acceleration of each type in emergency braking, (3,) m/s²; `usual_braking` if unknown."""
        types = self.training.get("types", {})
        known = [types.get(name, {}).get("hardest_braking_mps2", 0.0) for name in TYPE_NAMES]
        return np.minimum(known, self.usual_braking)

    def motions(self, vector: NDArray[np.float32], kind: NDArray[np.int8]) -> tuple[Floats, Floats]:
        """Acceleration (m/s²) and yaw rate (rad/s), each (n, modes), of road users of the types `kind` with the feature
        vectors `vector` (n, columns) in all modes."""
        acceleration, yaw_rate = motions(self.models, vector, kind.astype(np.int64))
        return acceleration.astype(np.float64), yaw_rate.astype(np.float64)

    def motion(self, observation: Observation, modes: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Acceleration (m/s²) and yaw rate (rad/s), each (n,), of the observed road users in `modes` (n,)."""
        acceleration, yaw_rate = self.motions(observation.vector, observation.type)
        each = np.arange(len(modes))
        return acceleration[each, modes], yaw_rate[each, modes]

    def save(self, folder: str | Path) -> None:
        """Write the bundle as `folder`, completely or not at all, replacing a bundle there.

        Raises InputError if `folder` contains anything but a bundle, or cannot be written.
        """
        target = Path(folder)
        check_replaceable(target)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent) as temporary:
                made, old = Path(temporary) / "new", Path(temporary) / "old"
                made.mkdir()
                self._write(made)
                if target.exists():
                    os.rename(target, old)
                try:
                    os.rename(made, target)
                except OSError:
                    if old.exists():
                        os.rename(old, target)
                    raise
        except OSError as error:
            raise InputError(f"cannot write bundle {target}: {error.strerror}; name another folder") from error

    def _write(self, folder: Path) -> None:
        state = {**self.weights, "mode_centres": self.mode_centres, "mode_counts": self.mode_counts}
        config = {"name": self.name, **asdict(self.config)}
        (folder / "config.json").write_text(json.dumps(config, indent=2) + "\n", encoding="utf-8")
        (folder / "training.json").write_text(json.dumps(self.training, indent=2) + "\n", encoding="utf-8")
        (folder / "MODEL_CARD.md").write_text(self.card, encoding="utf-8")
        if self.training.get("notice"):
            (folder / NOTICE).write_text(str(self.training["notice"]).strip() + "\n", encoding="utf-8")
        # save_file would make a file that only its owner may read.
        (folder / "weights.safetensors").write_bytes(save({k: np.ascontiguousarray(v) for k, v in state.items()}))
        if self.policy is not None:
            from slrl_sumo.models.trained_policy import write_policy

            write_policy(folder, self.policy, self.policy_training or {})


def weights_of(displacement: "DisplacementModels", prior: "Prior") -> Weights:
    """The weights of models in PyTorch for a bundle, on the same memory."""
    named = (("displacement.", displacement), ("prior.", prior))
    return {prefix + k: v.detach().numpy() for prefix, module in named for k, v in module.state_dict().items()}


def _with_weights(made: Network, weights: Weights, prefix: str) -> Network:
    import torch

    mine = {k.removeprefix(prefix): torch.from_numpy(v) for k, v in weights.items() if k.startswith(prefix)}
    made.load_state_dict(mine, assign=True)
    return made.requires_grad_(False).eval()


def tensors(observation: Observation) -> "tuple[Tensor, Tensor]":
    """Vector (n, columns) float32 and type (n,) int64 of an observation, as inputs of networks in PyTorch."""
    import torch

    return torch.from_numpy(observation.vector), torch.from_numpy(observation.type.astype(np.int64))


def load_bundle(name_or_folder: str | Path, *, policy: bool = True, training: bool = True) -> ModelBundle:
    """Read a bundle: a shipped bundle by name, or a folder.

    A string without a slash is searched among the shipped bundles first. Without `policy`, the trained selector is not
    read. Without `training`, a selector that reads no image is read as `network` instead of `policy`, and PyTorch is
    not imported. Raises InputError if the bundle does not exist, is damaged, or has another format version or other
    features.
    """
    folder = find_bundle(name_or_folder)
    values = read_object(folder / "config.json")
    bundle_name = values.pop("name", None)
    config = BundleConfig.read(values, folder)
    state = read_weights(folder, config)
    trained, network, record = None, None, None
    if policy and not training and (files := read_policy_files(folder, config.modes)) and not files.config.image:
        network, record = read_network(folder, files), files.training
    elif policy:
        from slrl_sumo.models.trained_policy import read_policy

        trained, record = read_policy(folder, config.modes) or (None, None)
    return ModelBundle(
        name=str(bundle_name),
        config=config,
        mode_centres=state.pop("mode_centres"),
        mode_counts=state.pop("mode_counts"),
        weights=state,
        training=read_training(folder / "training.json"),
        card=read_card(folder / "MODEL_CARD.md"),
        policy=trained,
        network=network,
        policy_training=record,
    )
