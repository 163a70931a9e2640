"""Figures of each update of a training: episodes, rewards and motion, by road user type; and their log file."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.input_files import read_text
from slrl_sumo.learning.rewards.terms import TERMS
from slrl_sumo.learning.rl.batch import Batch
from slrl_sumo.scene.types import STANDING_SPEED, TYPE_NAMES

Figures = dict[str, float]

LOG = "log.csv"


class EpisodeFigures:
    """Returns of the episodes of n slots, accumulated from step to step."""

    def __init__(self, slots: int) -> None:
        self._return = np.zeros(slots)

    def start(self) -> None:
        """Discard the current episodes, because all simulations restart."""
        self._return[:] = 0.0

    def figures(self, batch: Batch, infos: list[dict[str, Any]]) -> dict[str, float]:
        """The figures of one rollout; names have a slash, by which TensorBoard groups them.

        Slots with `replaced` in an info restarted just before that step. `episode/return`: mean over the episodes that
        ended (NaN without any); `episode/completed`: share of these that ended by time or at the destination, not by
        contact or loss, also by type; `reward/TERM`: mean of each term before weighting; `motion/…`: mean speed (m/s)
        and share of standing time, by type; `trips/…`: see `_trips`.
        """
        active = batch.active.numpy()
        reward, terminated = batch.rewards.numpy(), batch.terminated.numpy()
        ended = terminated | batch.truncated.numpy()
        failed = terminated & ~np.stack([info.get("reached", np.zeros(len(reward[0]), np.bool_)) for info in infos])
        replaced = np.stack([info["replaced"] for info in infos])
        kind = np.stack([info["type"] for info in infos])
        speed = np.stack([info["speed_mps"] for info in infos])
        returns: list[NDArray[np.float64]] = []
        for t in range(len(reward)):
            self._return[replaced[t]] = 0.0
            self._return += reward[t]
            returns.append(self._return[ended[t]])
            self._return[ended[t]] = 0.0
        result = {"episode/return": _mean(np.concatenate(returns)), "episode/completed": _mean(~failed[ended])}
        result["reward/total"] = _mean(reward[active])
        for name in TERMS:
            if name in infos[0]:
                result[f"reward/{name}"] = _mean(np.stack([info[name] for info in infos])[active])
        if "reached" in infos[0]:
            result |= _trips(infos, active)
        for number, name in enumerate(TYPE_NAMES):
            mine = (kind == number) & active
            result[f"episode/completed_{name}"] = _mean(~failed[ended & mine])
            result[f"motion/mean_speed_{name}_mps"] = _mean(speed[mine])
            result[f"motion/standing_{name}"] = _mean(speed[mine] < STANDING_SPEED)
            result[f"episode/ends_per_1000_steps_{name}"] = 1000.0 * _mean(failed[mine])
        return result


def _trips(infos: list[dict[str, Any]], active: NDArray[np.bool_]) -> Figures:
    """Figures of trips.

    `trips/active`: share of slots with a road user. `trips/reached`: share of the handed-back road users at their
    destination. `trips/clean`: share of the latter without a contact and never off their own surfaces.
    """
    reached, clean, handed_back = (np.stack([info[name] for info in infos]) for name in ("reached", "clean", "gone"))
    return {
        "trips/active": float(active.mean()),
        "trips/ended": float(handed_back.sum()),
        "trips/reached": _mean(reached[handed_back]),
        "trips/clean": _mean(clean[reached]),
    }


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if len(values) else float("nan")


def read_rows(folder: Path, done: int) -> list[Figures]:
    """The figures of the first `done` updates. Raises InputError if the file is damaged."""
    file = folder / LOG
    if not done or not file.exists():
        return []
    try:
        lines = csv.DictReader(read_text(file).splitlines())
        rows = [{key: float(value) for key, value in line.items()} for line in lines]
        return [row for row in rows if row["iteration"] < done]
    except (OSError, ValueError, TypeError, KeyError, csv.Error) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise InputError(f"{file}: is damaged ({reason}); delete it, the training goes on") from None


class TrainingLog:
    """log.csv and TensorBoard; rows after the checkpoint of a stopped training are dropped."""

    def __init__(self, folder: Path, rows: list[Figures], done: int, rollout_size: int) -> None:
        """`rows`: figures of the updates before `done`, see `read_rows`."""
        from torch.utils.tensorboard.writer import SummaryWriter

        self.rows = rows
        self._size = rollout_size
        self._path = folder / LOG
        self._open = self._path.open("w", newline="", encoding="utf-8")
        self._writer: csv.DictWriter[str] | None = None
        for row in self.rows:
            self._write(row)
        self._charts = SummaryWriter(str(folder / "tensorboard"), purge_step=done * rollout_size)

    def add(self, iteration: int, figures: Figures) -> None:
        row = {"iteration": float(iteration), "agent_steps": float((iteration + 1) * self._size), **figures}
        self.rows.append(row)
        self._write(row)
        self._open.flush()
        for name, value in figures.items():
            self._charts.add_scalar(name, value, (iteration + 1) * self._size)

    def close(self) -> None:
        self._open.close()
        self._charts.close()

    def _write(self, row: dict[str, float]) -> None:
        if self._writer is None:
            self._writer = csv.DictWriter(self._open, list(row))
            self._writer.writeheader()
        if set(row) != set(self._writer.fieldnames):
            raise InputError(
                f"{self._path}: has other columns than this version writes; delete it, the training goes on"
            )
        self._writer.writerow(row)
