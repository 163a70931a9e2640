"""Policies of PyTorch in the folders of bundles, and copies of policies for other uses."""

import json
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from safetensors.torch import save
from torch import Tensor

from slrl_sumo.models.bundle_folder import POLICY_FILES
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_files import damage_reported, read_policy_files
from slrl_sumo.models.policy_network import PolicyNetwork


def write_policy(folder: Path, policy: Policy, training: dict[str, Any]) -> None:
    """Write the policy's files into a bundle's folder; `training`: record of the training, plain JSON values."""
    values = {**asdict(policy.config), "training": training}
    (folder / POLICY_FILES[0]).write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
    state = {k: v.detach().cpu().contiguous() for k, v in policy.state_dict().items()}
    (folder / POLICY_FILES[1]).write_bytes(save(state))


def read_policy(folder: Path, modes: int) -> tuple[Policy, dict[str, Any]] | None:
    """The frozen policy of a bundle's folder, and the record of its training; None without a policy.

    `modes`: number of modes of the bundle.

    Raises InputError if its files are damaged or not for this version.
    """
    files = read_policy_files(folder, modes)
    if files is None:
        return None
    with damage_reported(folder):
        # The meta device allocates and initialises nothing: after a fork, initialisation would wait for ever for the
        # threads of the parent (OpenMP). It serves to compare the sizes.
        with torch.device("meta"):
            policy = Policy(files.config)
        policy.load_state_dict({name: _tensor(value) for name, value in files.weights.items()}, assign=True)
        policy.without_route = torch.from_numpy(files.without_route)
        policy.with_route = torch.ones(files.without_route.shape)
    return policy.requires_grad_(False).eval(), files.training


def _tensor(value: NDArray[Any]) -> Tensor:
    """A copy in PyTorch's memory, made by numpy, which needs no threads."""
    copied = torch.empty(value.shape)
    copied.numpy()[...] = value
    return copied


def network_of(policy: Policy) -> PolicyNetwork:
    """The network of a policy without images, for decisions without PyTorch; its weights are copied."""
    weights = {name: value.detach().cpu().numpy() for name, value in policy.state_dict().items()}
    return PolicyNetwork.of(policy.config, weights, policy.without_route.cpu().numpy(), policy.with_route.cpu().numpy())


def on_expected_routes(policy: Policy, training: dict[str, Any]) -> Policy | None:
    """A copy of a policy for expected routes, with the shares in the record of its `training`.

    None without shares, or if all shares are 0.
    """
    shares = torch.tensor(training.get("expected_route", [[0.0, 0.0]]))
    if not shares.any():
        return None
    copied = deepcopy(policy)
    copied.with_route.copy_(shares)
    return copied
