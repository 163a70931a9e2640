import numpy as np
import pytest
import torch

from slrl_sumo.models.bundle import BundleConfig, ModelBundle
from slrl_sumo.models.displacement import DisplacementModels
from slrl_sumo.models.prior import Prior
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.perception.observation import Observation


def _drawn(parameter: torch.Tensor, generator: torch.Generator) -> None:
    with torch.no_grad():
        parameter.copy_(torch.randn(parameter.shape, generator=generator))


@pytest.fixture
def bundle() -> ModelBundle:
    """A bundle of random weights: every layer, bias and bound says something."""
    generator = torch.Generator().manual_seed(7)
    displacement, prior = DisplacementModels(hidden=(8, 6)), Prior(hidden=(10, 8))
    for module in (displacement, prior):
        for parameter in module.parameters():
            _drawn(parameter, generator)
        _drawn(module.networks.mean, generator)
        module.networks.scale.copy_(torch.rand(3, len(FEATURES), generator=generator))
    displacement.acceleration_bounds.copy_(torch.tensor([[-4.0, 3.0], [-3.0, 2.0], [-1.5, 1.0]]))
    displacement.yaw_rate_bounds.copy_(torch.tensor([[-0.7, 0.6], [-0.8, 0.9], [-2.0, 1.5]]))
    displacement.max_curvature.copy_(torch.tensor([0.2, 0.5, 3.0]))
    displacement.max_speed.copy_(torch.tensor([15.0, 8.0, 2.5]))
    random = np.random.default_rng(7)
    return ModelBundle(
        name="random",
        config=BundleConfig(displacement_hidden=(8, 6), prior_hidden=(10, 8)),
        mode_centres=random.normal(0.0, 10.0, (3, 20, 2)),
        mode_counts=random.integers(1, 100, (3, 20)),
        displacement=displacement.requires_grad_(False),
        prior=prior.requires_grad_(False),
        training={"seed": 7, "types": {"car": {"windows": 12}}},
        card="# Model bundle `random`\n\nNothing was learned here, süß.\n",
    )


@pytest.fixture
def seen() -> Observation:
    """What 300 road users of all types see."""
    random = np.random.default_rng(1)
    vector = random.normal(2.0, 3.0, (300, len(FEATURES))).astype(np.float32)
    vector[:, 0] = random.uniform(0.0, 12.0, 300)
    vector[:50, 0] = 0.0
    return Observation(vector=vector, image=None, type=(np.arange(300) % 3).astype(np.int8))
