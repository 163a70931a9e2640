"""Figures of a training per update: episodes, rewards and motion, by road-user type."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.learning.rl.ppo import Batch
from slrl_sumo.learning.rl.rewards import TERMS
from slrl_sumo.scene.types import STANDING_SPEED, TYPE_NAMES


class EpisodeFigures:
    """Returns of the episodes of n slots, accumulated from step to step."""

    def __init__(self, slots: int) -> None:
        self._return = np.zeros(slots)

    def start(self) -> None:
        """All simulations restart: discard the episodes under way."""
        self._return[:] = 0.0

    def figures(self, batch: Batch, infos: list[dict[str, Any]]) -> dict[str, float]:
        """The figures of one rollout; names have a slash, by which TensorBoard groups them. Slots with `replaced` in an
        info restarted just before that step.

        `episode/return`: mean over the episodes that ended (NaN if none did); `episode/success`: share of them that
        ended by time, not by contact or loss, also per type; `reward/TERM`: mean of each term before weighting;
        `motion/…`: mean speed (m/s) and share of time standing, per type.
        """
        reward, terminated = batch.rewards.numpy(), batch.terminated.numpy()
        ended = terminated | batch.truncated.numpy()
        replaced = np.stack([info["replaced"] for info in infos])
        kind = np.stack([info["type"] for info in infos])
        speed = np.stack([info["speed_mps"] for info in infos])
        returns: list[NDArray[np.float64]] = []
        for t in range(len(reward)):
            self._return[replaced[t]] = 0.0
            self._return += reward[t]
            returns.append(self._return[ended[t]])
            self._return[ended[t]] = 0.0
        result = {"episode/return": _mean(np.concatenate(returns)), "episode/success": _mean(~terminated[ended])}
        result["reward/total"] = float(reward.mean())
        for name in TERMS:
            result[f"reward/{name}"] = float(np.mean([info[name] for info in infos]))
        for number, name in enumerate(TYPE_NAMES):
            mine = kind == number
            result[f"episode/success_{name}"] = _mean(~terminated[ended & mine])
            result[f"motion/mean_speed_{name}_mps"] = _mean(speed[mine])
            result[f"motion/standing_{name}"] = _mean(speed[mine] < STANDING_SPEED)
            result[f"episode/ends_per_1000_steps_{name}"] = 1000.0 * _mean(terminated[mine])
        return result


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if len(values) else float("nan")
