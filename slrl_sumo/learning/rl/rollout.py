"""Steps of a vector environment with the current policy."""

from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from slrl_sumo.learning.rl.actor import Actor
from slrl_sumo.learning.rl.batch import Batch


class Slots(Protocol):
    """Part of an environment that a rollout needs: gymnasium's VectorEnv.step with autoreset in the same step."""

    num_envs: int

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[dict[str, NDArray[Any]], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]: ...


def rollout(
    agent: Actor,
    env: Slots,
    observation: dict[str, NDArray[Any]],
    teacher_costs: NDArray[np.float32],
    num_steps: int,
    generator: torch.Generator,
) -> tuple[Batch, dict[str, NDArray[Any]], list[dict[str, Any]], NDArray[np.float32]]:
    """T steps of all slots from `observation` on, with its `teacher_costs` (N, modes).

    Returns the batch, the following observation, the infos of each step, and the teacher_costs of that observation.
    """
    shape = (num_steps, env.num_envs)
    seen = {
        name: torch.empty(*shape, *value.shape[1:], dtype=torch.from_numpy(value).dtype)
        for name, value in observation.items()
    }
    guided = torch.empty(*shape, teacher_costs.shape[1])
    actions = torch.empty(shape, dtype=torch.int64)
    logprobs, values, rewards, final_values = (torch.zeros(shape) for _ in range(4))
    terminated, truncated = (torch.empty(shape, dtype=torch.bool) for _ in range(2))
    final: list[tuple[int, NDArray[np.intp], dict[str, NDArray[Any]]]] = []
    infos: list[dict[str, Any]] = []
    with torch.no_grad():
        for t in range(num_steps):
            for name, value in observation.items():
                seen[name][t] = torch.from_numpy(value)
            guided[t] = torch.from_numpy(teacher_costs)
            logits, worth = agent.logits_and_value({name: value[t] for name, value in seen.items()})
            logits, values[t] = logits.cpu(), worth.cpu()
            actions[t] = torch.multinomial(logits.exp(), 1, generator=generator)[:, 0]
            logprobs[t] = logits.gather(1, actions[t][:, None])[:, 0]
            observation, reward, over, cut, info = env.step(actions[t].numpy())
            rewards[t], teacher_costs = torch.from_numpy(reward), info["teacher_costs"]
            terminated[t], truncated[t] = torch.from_numpy(over), torch.from_numpy(cut)
            if cut.any():
                rows = np.flatnonzero(cut)
                final.append((t, rows, {name: value[rows] for name, value in info["final_obs"].items()}))
            infos.append(
                {name: values for name, values in info.items() if "final" not in name and name != "teacher_costs"}
            )
        if final:
            _, worth = agent.logits_and_value(
                {name: torch.from_numpy(np.concatenate([last[name] for *_, last in final])) for name in observation}
            )
            times = np.concatenate([np.full(len(rows), t) for t, rows, _ in final])
            final_values[times, np.concatenate([rows for _, rows, _ in final])] = worth.cpu()
        _, next_value = agent.logits_and_value({n: torch.from_numpy(value) for n, value in observation.items()})
    batch = Batch(
        seen, actions, logprobs, values, rewards, terminated, truncated, final_values, next_value.cpu(), guided
    )
    return batch, observation, infos, teacher_costs
