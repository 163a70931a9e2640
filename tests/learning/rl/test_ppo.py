"""PPO: a task that must be learned, the same seed the same run."""

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from slrl_sumo.learning.rl.actor import Agent
from slrl_sumo.learning.rl.batch import Batch
from slrl_sumo.learning.rl.ppo import PpoSettings, learn, update
from slrl_sumo.learning.rl.rollout import rollout
from slrl_sumo.models.displacement import MODES
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.models.prior import Prior

SMALL = PolicyConfig(channels=(4, 8), hidden=32, head=16)


def test_slots_without_a_road_user_change_nothing() -> None:
    """The same rollout with an empty slot beside it, of absurd contents, gives the same update."""
    settings = PpoSettings(num_minibatches=1, update_epochs=1, kl_coef=0.0, prior_coef=0.1)
    generator = torch.Generator().manual_seed(1)
    seen = {name: torch.from_numpy(value)[None].repeat(4, 1, *[1] * (value.ndim - 1)) for name, value in
            _seen_at_first(6).items()}  # fmt: skip
    shape = (4, 6)
    fields: dict[str, Any] = {
        "actions": torch.randint(MODES, shape, generator=generator),
        "logprobs": torch.full(shape, -3.0),
        "values": torch.rand(shape, generator=generator),
        "rewards": torch.rand(shape, generator=generator),
        "terminated": torch.zeros(shape, dtype=torch.bool),
        "truncated": torch.zeros(shape, dtype=torch.bool),
        "final_values": torch.zeros(shape),
        "teacher_costs": torch.zeros(*shape, MODES),
    }
    alone = Batch(seen=seen | {"active": torch.ones(shape, dtype=torch.int8)}, next_value=torch.ones(6), **fields)
    wider = {
        name: torch.cat([value, (9 * torch.ones_like(value[:, :1])).to(value.dtype)], 1)
        for name, value in fields.items()
    }
    beside = {name: torch.cat([value, value[:, :1]], 1) for name, value in alone.seen.items()}
    beside["active"][:, 6] = 0
    crowded = Batch(seen=beside, next_value=torch.ones(7), **wider)

    def updated(batch: Batch) -> tuple[dict[str, float], dict[str, torch.Tensor]]:
        torch.manual_seed(2)
        agent = Agent(Policy(SMALL), Prior(MODES), settings.explore, settings.learning_rate, torch.device("cpu"))
        figures = update(agent, batch, settings, torch.Generator().manual_seed(3))
        return figures, agent.policy.state_dict()

    (figures, weights), (again, same) = updated(alone), updated(crowded)
    assert figures == again
    for name, value in weights.items():
        torch.testing.assert_close(value, same[name])
    assert figures["kl_prior"] >= 0.0


class _Lights:
    """A toy: a light is on the left or the right of the image, and the mode must name the side: 3 or 7."""

    def __init__(self, slots: int = 16) -> None:
        self.num_envs = slots

    def reset(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._age = np.zeros(self.num_envs, np.int64)
        self._seen, self._teacher_costs = self._look(), np.zeros((self.num_envs, MODES), np.float32)

    def collect(self, agent: Agent, num_steps: int, seed: int) -> tuple[Batch, list[dict[str, Any]]]:
        generator = torch.Generator().manual_seed(seed)
        batch, self._seen, infos, self._teacher_costs = rollout(
            agent, self, self._seen, self._teacher_costs, num_steps, generator
        )
        return batch, infos

    def step(self, actions: NDArray[np.int64]) -> tuple[Any, ...]:
        right = actions == np.where(self._left, 3, 7)
        self._age += 1
        cut = self._age >= 8
        self._age[cut] = 0
        seen = self._look()
        teacher_costs = np.zeros((self.num_envs, MODES), np.float32)
        info = {"final_obs": seen, "_final_obs": cut, "right": right, "teacher_costs": teacher_costs}
        return seen, right.astype(np.float64), np.zeros(self.num_envs, np.bool_), cut, info

    def _look(self) -> dict[str, NDArray[Any]]:
        self._left = self._random.random(self.num_envs) < 0.5
        image = np.zeros((self.num_envs, 20, 40, 3), np.uint8)
        image[self._left, :, :20] = 255
        image[~self._left, :, 20:] = 255
        vector = np.zeros((self.num_envs, 12), np.float32)
        vector[np.arange(self.num_envs), 2 + np.arange(self.num_envs) % 3] = 1.0
        ahead = np.zeros((self.num_envs, MODES, 4), np.float32)
        return {"vector": vector, "image": image, "rollouts": ahead}


def _seen_at_first(slots: int) -> dict[str, NDArray[Any]]:
    lights = _Lights(slots)
    lights.reset(1)
    return lights._seen


def _train(iterations: int, seed: int = 1, only: tuple[str, ...] = ()) -> tuple[list[float], dict[str, torch.Tensor]]:
    """The share of right answers in each iteration, and the weights in the end."""
    settings = PpoSettings(
        num_steps=16,
        learning_rate=2e-3,
        gamma=0.5,
        ent_coef=0.0,
        kl_coef=0.0,
        kl_coef_last=0.0,
        teacher_first=0,
        only=only,
    )
    torch.manual_seed(seed)
    agent = Agent(Policy(SMALL), Prior(MODES), settings.explore, settings.learning_rate, torch.device("cpu"))
    shares: list[float] = []

    def after(iteration: int, batch: Batch, infos: list[dict[str, Any]], losses: dict[str, float]) -> None:
        shares.append(float(np.mean([info["right"] for info in infos])))
        assert np.isfinite(list(losses.values())).all()

    learn(
        agent,
        _Lights(),
        settings,
        iterations=range(iterations),
        total=iterations,
        reset_every=4,
        seed=seed,
        after=after,
    )
    return shares, agent.policy.state_dict()


@pytest.mark.slow
def test_a_toy_task_is_learned() -> None:
    shares, _ = _train(60)
    assert shares[0] < 0.2
    assert np.mean(shares[-5:]) > 0.9


def test_same_seed_same_run_and_another_seed_another() -> None:
    shares, weights = _train(4)
    again, same = _train(4)
    assert shares == again
    for name, value in weights.items():
        torch.testing.assert_close(value, same[name], rtol=0, atol=0)
    assert _train(4, seed=2)[0] != shares


def test_types_that_do_not_learn_keep_their_weights() -> None:
    _, all_types = _train(1)
    _, before = _train(0)
    _, after = _train(1, only=("pedestrian",))
    changed = {name for name in before if not torch.equal(before[name], after[name])}
    assert changed
    assert all(".2." in name for name in changed)
    assert {name for name in before if not torch.equal(before[name], all_types[name])} > changed


def test_training_can_only_be_taken_up_where_simulations_begin_anew() -> None:
    agent = Agent(Policy(SMALL), Prior(MODES), 0.03, 5e-4, torch.device("cpu"))
    with pytest.raises(ValueError, match="where simulations restart"):
        learn(
            agent,
            _Lights(),
            PpoSettings(),
            iterations=range(2, 4),
            total=4,
            reset_every=4,
            seed=1,
            after=lambda *_: None,
        )


@pytest.mark.parametrize(
    ("kl_coef", "kept", "learns"), [(1.0, (), True), (0.0, ("car",), True), (0.0, ("pedestrian",), False)]
)
def test_the_policy_learns_what_the_teacher_sees_in_each_mode(
    kl_coef: float, kept: tuple[str, ...], learns: bool
) -> None:
    # Looking ahead, one mode of each road user hits nothing: the teacher knows, and the scorer can read it.
    random = np.random.default_rng(3)
    settings = PpoSettings(num_minibatches=1, update_epochs=40, learning_rate=5e-3, explore=0.0, kl_kept=kept)
    torch.manual_seed(2)
    agent = Agent(Policy(SMALL), Prior(MODES), settings.explore, settings.learning_rate, torch.device("cpu"))
    steps, slots = 4, 16
    free = random.integers(0, MODES, (steps, slots))
    ahead = np.zeros((steps, slots, MODES, 4), np.float32)
    ahead[..., 0] = 1.0
    np.put_along_axis(ahead[..., 0], free[..., None], 0.0, axis=-1)
    vector = np.zeros((steps, slots, 12), np.float32)
    vector[..., 2] = 1.0
    seen = {"vector": vector, "image": np.zeros((steps, slots, 20, 40, 3), np.uint8), "rollouts": ahead}
    tensors = {name: torch.from_numpy(value) for name, value in seen.items()}
    none = torch.zeros(steps, slots)
    batch = Batch(
        seen=tensors,
        actions=torch.zeros(steps, slots, dtype=torch.int64),
        logprobs=none,
        values=none,
        rewards=none,
        terminated=none.bool(),
        truncated=none.bool(),
        final_values=none,
        next_value=none[0],
        teacher_costs=torch.from_numpy(10.0 * ahead[..., 0]),
    )
    flat = {name: value.flatten(0, 1) for name, value in tensors.items()}
    teacher = agent.teacher_logits(flat, batch.teacher_costs.flatten(0, 1))
    assert (teacher.argmax(-1).numpy() == free.ravel()).all()
    before = agent.logits_and_value(flat)[0]
    assert (before.argmax(-1).numpy() == free.ravel()).mean() < 0.3
    figures = update(agent, batch, settings, torch.Generator(), kl_coef=kl_coef, teacher_only=True)
    assert (figures["kl_teacher"] > 0) == learns
    after = agent.logits_and_value(flat)[0]
    assert ((after.argmax(-1).numpy() == free.ravel()).mean() > 0.95) == learns
    # The teacher itself stays what it was.
    torch.testing.assert_close(agent.teacher_logits(flat, batch.teacher_costs.flatten(0, 1)), teacher)


def test_exploring_gives_every_mode_a_chance() -> None:
    agent = Agent(Policy(SMALL), Prior(MODES), 0.2, 5e-4, torch.device("cpu"))
    for parameter in agent.policy.actors.parameters():
        parameter.data += 3.0
    agent.policy.actors[0][-1].bias.data[5] += 50.0
    seen = {name: torch.from_numpy(value) for name, value in _seen_at_first(3).items()}
    probability = agent.logits_and_value(seen)[0].exp()
    torch.testing.assert_close(probability.sum(-1), torch.ones(3))
    assert (probability >= 0.2 / MODES - 1e-6).all()
    assert probability[0, 5] > 0.8
