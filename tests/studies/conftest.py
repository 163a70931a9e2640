import numpy as np
import pytest
import torch

from slrl_sumo.models.bundle import BundleConfig, ModelBundle
from slrl_sumo.models.displacement import DisplacementModels
from slrl_sumo.models.prior import Prior


@pytest.fixture
def bundle() -> ModelBundle:
    """A bundle of random weights, whose modes differ."""
    generator = torch.Generator().manual_seed(7)
    displacement, prior = DisplacementModels(hidden=(8,)), Prior(hidden=(8,))
    for module in (displacement, prior):
        for parameter in module.parameters():
            with torch.no_grad():
                parameter.copy_(torch.randn(parameter.shape, generator=generator))
        module.networks.scale.fill_(0.3)
    displacement.acceleration_bounds.copy_(torch.tensor([[-4.0, 3.0], [-3.0, 2.0], [-1.5, 1.0]]))
    displacement.yaw_rate_bounds.copy_(torch.tensor([[-0.7, 0.6], [-0.8, 0.9], [-2.0, 1.5]]))
    displacement.max_curvature.copy_(torch.tensor([0.2, 0.5, 3.0]))
    displacement.max_speed.copy_(torch.tensor([15.0, 8.0, 2.5]))
    return ModelBundle(
        name="random",
        config=BundleConfig(displacement_hidden=(8,), prior_hidden=(8,)),
        mode_centres=np.random.default_rng(7).normal(0.0, 5.0, (3, 20, 2)),
        mode_counts=np.ones((3, 20), np.int64),
        displacement=displacement.requires_grad_(False),
        prior=prior.requires_grad_(False),
        training={},
        card="# Model bundle `random`\n",
    )
