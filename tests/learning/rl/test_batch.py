"""Advantages by hand."""

from typing import Any

import torch

from slrl_sumo.learning.rl.batch import Batch, gae, normalised
from slrl_sumo.models.displacement import MODES


def _batch(rewards: list[float], values: list[float], **changes: Any) -> Batch:
    steps = len(rewards)
    none = torch.zeros(steps, 1)
    fields: dict[str, Any] = {
        "seen": {},
        "actions": none,
        "logprobs": none,
        "values": torch.tensor(values)[:, None],
        "rewards": torch.tensor(rewards)[:, None],
        "terminated": torch.zeros(steps, 1, dtype=torch.bool),
        "truncated": torch.zeros(steps, 1, dtype=torch.bool),
        "final_values": none,
        "next_value": torch.tensor([4.0]),
        "teacher_costs": torch.zeros(steps, 1, MODES),
    }
    return Batch(**(fields | changes))


def _only(step: int, steps: int) -> torch.Tensor:
    return (torch.arange(steps) == step)[:, None]


def test_gae_without_ends_by_hand() -> None:
    advantages, returns = gae(_batch([1.0, 2.0], [0.5, 1.5]), gamma=0.5, gae_lambda=0.5)
    last = 2.0 + 0.5 * 4.0 - 1.5
    first = 1.0 + 0.5 * 1.5 - 0.5 + 0.25 * last
    torch.testing.assert_close(advantages[:, 0], torch.tensor([first, last]))
    torch.testing.assert_close(returns[:, 0], torch.tensor([first + 0.5, last + 1.5]))


def test_nothing_comes_after_a_terminated_episode() -> None:
    advantages, _ = gae(_batch([1.0, 2.0], [0.5, 1.5], terminated=_only(0, 2)), 0.5, 0.5)
    torch.testing.assert_close(advantages[:, 0], torch.tensor([1.0 - 0.5, 2.0 + 2.0 - 1.5]))


def test_a_truncated_episode_is_worth_its_last_observation_and_not_the_next_episode() -> None:
    cut = _batch([1.0, 2.0], [0.5, 1.5], truncated=_only(0, 2), final_values=torch.tensor([[10.0], [0.0]]))
    advantages, _ = gae(cut, 0.5, 0.5)
    torch.testing.assert_close(advantages[:, 0], torch.tensor([1.0 + 5.0 - 0.5, 2.0 + 2.0 - 1.5]))


def test_advantages_are_normalised_within_each_type() -> None:
    kind = torch.tensor([0, 0, 1, 1, 2])
    normal = normalised(torch.tensor([1.0, 3.0, 100.0, 300.0, 7.0]), kind)
    torch.testing.assert_close(normal[:2], normal[2:4])
    assert normal[4] == 0.0
