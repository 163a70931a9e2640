"""Imitation: what is shown belongs to the window, and the policy learns what only the image tells."""

import numpy as np
import pytest
import torch

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.learning.rl.imitation import Demonstrations, ImitationSettings, demonstrations, imitate, recorded_traffic
from slrl_sumo.learning.supervised.windows import windows
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.perception.ego_image import ego_images
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.sumo.scenario import find_scenario


def test_lessons_show_what_the_road_user_of_the_window_saw(shipped_bundle: ModelBundle) -> None:
    recording, ground = recorded_traffic(find_scenario("intersection"), 60.0, 3)
    shown = demonstrations(recording, ground, shipped_bundle, 5)
    every = windows([recording], 5)
    assert len(shown) == len(every) > 50
    np.testing.assert_array_equal(shown.vector, every.vector)
    for row in (0, 17, len(shown) - 1):
        frame = int(every.frame[row])
        assert frame % 5 == 0
        world = recording.world(frame)
        (me,) = np.flatnonzero([user == recording.ids[every.track[row]] for user in world.ids])
        np.testing.assert_array_equal(shown.image[row], ego_images(world, np.array([me]), ground)[0])
        assert world.speed[me] == pytest.approx(shown.vector[row, 0], abs=1e-5)
        # The chosen mode is the one whose centre is nearest to where the road user went.
        apart = np.hypot(*(shipped_bundle.mode_centres[shown.type[row]] - every.destination[row]).T)
        assert apart.argmin() == shown.mode[row]
    assert (ground.surface_at(recording.x, recording.y) != Surface.NONE).mean() > 0.85


def _made(n: int, seed: int) -> Demonstrations:
    """Windows in which the brightness of the image says which of two modes was chosen."""
    random = np.random.default_rng(seed)
    bright = random.random(n) < 0.5
    vector = np.zeros((n, len(FEATURES)), np.float32)
    kind = random.integers(0, 3, n)
    vector[np.arange(n), 2 + kind] = 1.0
    image = np.where(bright, 220, 30)[:, None, None, None] + random.integers(0, 30, (n, 20, 40, 3))
    return Demonstrations(vector, image.astype(np.uint8), kind, np.where(bright, 4, 11))


def test_the_policy_learns_what_only_the_image_tells(shipped_bundle: ModelBundle) -> None:
    def teach() -> tuple[list[dict[str, float]], dict[str, torch.Tensor]]:
        torch.manual_seed(1)
        policy = Policy(PolicyConfig(channels=(4, 8), hidden=32, head=16))
        seen: list[dict[str, float]] = []
        plan = ImitationSettings(epochs=3, batch=64)
        imitate(
            policy, shipped_bundle, [_made(900, 1), _made(900, 2)], plan, 5, lambda _, figures: seen.append(figures)
        )
        return seen, policy.state_dict()

    seen, weights = teach()
    assert len(seen) == 3
    assert seen[-1]["imitation/accuracy"] > 0.95
    assert seen[-1]["imitation/prior_accuracy"] < 0.6
    assert seen[-1]["imitation/cross_entropy"] < seen[-1]["imitation/prior_cross_entropy"]
    again, same = teach()
    assert again == seen
    for name, value in weights.items():
        torch.testing.assert_close(value, same[name], rtol=0, atol=0)
