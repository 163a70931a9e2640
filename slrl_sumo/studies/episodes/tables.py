"""The rows of a table from the outcomes of many episodes, added up as they come; no outcome is kept.

Sums of floats depend on their order, so these sums are exact (fractions): the table does not depend on the order in
which episodes finish.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.metrics.outcomes import TypeOutcome, mean_survival, survival_counts
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.studies.episodes.episode import Episode

FIGURES = (
    "success_rate",
    "mean_speed_mps",
    "mean_speed_moving_mps",
    "standing_share",
    "collisions_per_1000_steps",
    "near_misses_per_1000_steps",
    "off_surface_share",
    "paper_success_rate",
    "paper_survival_steps",
    "paper_collisions_per_1000_steps",
)
"""Figures; figures by the paper's definitions begin with `paper_`."""

SPREAD = ("success_rate", "mean_speed_mps", "paper_success_rate", "paper_survival_steps")
"""Figures with a standard deviation over episodes."""

COLUMNS = (
    "selector",
    "type",
    "agents",
    "episodes",
    "seeds",
    "road_users",
    *FIGURES,
    *(f"{name}_std" for name in SPREAD),
    *(f"{name}_seed_std" for name in FIGURES),
)


class EpisodeTables:
    """A row for each selector, number of agents and type, from episodes in any order.

    `parties`: selectors and numbers of agents, in the order of the rows. `steps`: decisions of an episode. `per_seed`:
    episodes that each party has of each seed; what is remembered of a seed is forgotten when as many have been added
    or left out, so that memory does not grow with their number. Add no episode twice.
    """

    def __init__(self, parties: Sequence[tuple[str, int]], steps: int, per_seed: int) -> None:
        self._steps, self._per_seed = steps, per_seed
        self._episodes = dict.fromkeys(parties, 0)
        self._cells = {(party, kind): _Cell(_Sums(steps)) for party in parties for kind in TYPE_NAMES}
        self._seeds: dict[tuple[tuple[str, int], int], _Seed] = {}

    def add(self, episode: Episode, outcome: tuple[TypeOutcome, ...]) -> None:
        """Count an episode of one of the parties."""
        party = episode.selector, episode.agents
        self._episodes[party] += 1
        seed = self._seed(episode)
        for part in outcome:
            one = _Sums(self._steps)
            one.add(part)
            cell = self._cells[party, part.type]
            cell.all.merge(one)
            figures = one.figures()
            cell.between_episodes.add({name: figures[name] for name in SPREAD})
            seed.sums.setdefault(part.type, _Sums(self._steps)).merge(one)
        self._ended(episode, seed)

    def leave_out(self, episode: Episode) -> None:
        """Count a failed episode, which has no outcome."""
        self._ended(episode, self._seed(episode))

    def rows(self) -> list[dict[str, Any]]:
        """The rows, with COLUMNS as keys; call it once, at the end.

        Figures are over all decisions (or road users) of all episodes of all seeds together; `_std` is the sample
        standard deviation between the figures of single episodes that have the type, `_seed_std` between those of whole
        seeds. None where there is nothing to take a figure from.
        """
        for party, seed in list(self._seeds):
            self._close(party, seed)
        rows = []
        for kind in TYPE_NAMES:
            for party, episodes in self._episodes.items():
                cell = self._cells[party, kind]
                if not cell.all.users:
                    continue
                row: dict[str, Any] = {"selector": party[0], "type": kind, "agents": party[1], "episodes": episodes}
                row |= {"seeds": cell.seeds, "road_users": cell.all.users}
                row |= {name: _rounded(value) for name, value in cell.all.figures().items()}
                row |= {f"{name}_std": cell.between_episodes.deviation(name) for name in SPREAD}
                row |= {f"{name}_seed_std": cell.between_seeds.deviation(name) for name in FIGURES}
                rows.append(row)
        return rows

    def _seed(self, episode: Episode) -> "_Seed":
        return self._seeds.setdefault(((episode.selector, episode.agents), episode.seed), _Seed())

    def _ended(self, episode: Episode, seed: "_Seed") -> None:
        seed.ended += 1
        if seed.ended == self._per_seed:
            self._close((episode.selector, episode.agents), episode.seed)

    def _close(self, party: tuple[str, int], seed: int) -> None:
        for kind, sums in self._seeds.pop((party, seed)).sums.items():
            cell = self._cells[party, kind]
            cell.seeds += 1
            cell.between_seeds.add(sums.figures())


class _Sums:
    """Of the road users of one type in some episodes."""

    def __init__(self, steps: int) -> None:
        self.users = self.succeeded = self.paper_succeeded = 0
        self._survival: NDArray[np.int64] = np.zeros((2, steps), np.int64)
        self._counts = [0] * 6  # decisions, standing, collisions, near misses, paper collisions, off surface
        self._speeds = [Fraction(0), Fraction(0)]  # of all decisions, of those in motion
        self._surfaces_known = True

    def add(self, part: TypeOutcome) -> None:
        present, survived = np.array(part.present, np.float64), np.array(part.paper_survived, np.float64)
        self.users += len(present)
        self.succeeded += part.succeeded
        self.paper_succeeded += int((survived == present).sum())
        self._survival += survival_counts(present, survived, self._survival.shape[1])
        contacts = (part.collisions, part.near_misses, part.paper_collisions)
        counts = (part.steps, part.standing, *contacts, part.off_surface or 0)
        self._counts = [a + b for a, b in zip(self._counts, counts, strict=True)]
        speeds = Fraction(part.speed_sum), Fraction(part.moving_speed_sum)
        self._speeds = [a + b for a, b in zip(self._speeds, speeds, strict=True)]
        self._surfaces_known &= part.off_surface is not None

    def merge(self, other: "_Sums") -> None:
        self.users += other.users
        self.succeeded += other.succeeded
        self.paper_succeeded += other.paper_succeeded
        self._survival += other._survival
        self._counts = [a + b for a, b in zip(self._counts, other._counts, strict=True)]
        self._speeds = [a + b for a, b in zip(self._speeds, other._speeds, strict=True)]
        self._surfaces_known &= other._surfaces_known

    def figures(self) -> dict[str, float | None]:
        """FIGURES, of at least one road user."""
        total, standing, collisions, near_misses, paper_collisions, off_surface = self._counts
        return {
            "success_rate": self.succeeded / self.users,
            "mean_speed_mps": _ratio(self._speeds[0], total),
            "mean_speed_moving_mps": _ratio(self._speeds[1], total - standing),
            "standing_share": _ratio(standing, total),
            "collisions_per_1000_steps": _ratio(1000 * collisions, total),
            "near_misses_per_1000_steps": _ratio(1000 * near_misses, total),
            "off_surface_share": _ratio(off_surface, total) if self._surfaces_known else None,
            "paper_success_rate": self.paper_succeeded / self.users,
            "paper_survival_steps": mean_survival(self._survival),
            "paper_collisions_per_1000_steps": _ratio(1000 * paper_collisions, total),
        }


class _Spread:
    """Of figures between several sets of road users."""

    def __init__(self) -> None:
        self._moments: dict[str, tuple[int, Fraction, Fraction]] = {}

    def add(self, figures: dict[str, float | None]) -> None:
        for name, value in figures.items():
            if value is not None:
                n, first, second = self._moments.get(name, (0, Fraction(0), Fraction(0)))
                exact = Fraction(value)
                self._moments[name] = n + 1, first + exact, second + exact * exact

    def deviation(self, name: str) -> float | None:
        """The sample standard deviation; None for fewer than two values."""
        n, first, second = self._moments.get(name, (0, Fraction(0), Fraction(0)))
        return round(math.sqrt((second - first * first / n) / (n - 1)), 6) if n > 1 else None


@dataclass
class _Cell:
    all: _Sums
    between_episodes: _Spread = field(default_factory=_Spread)
    between_seeds: _Spread = field(default_factory=_Spread)
    seeds: int = 0


@dataclass
class _Seed:
    ended: int = 0
    sums: dict[str, _Sums] = field(default_factory=dict)


def _ratio(value: Fraction | int, count: int) -> float | None:
    return float(value / count) if count else None


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 6)
