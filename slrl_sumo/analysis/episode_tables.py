"""From the outcomes of many episodes to the rows of a table."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from slrl_sumo.analysis.episodes import Episode
from slrl_sumo.analysis.outcomes import TypeOutcome, mean_survival
from slrl_sumo.world.types import TYPE_NAMES

FIGURES = (
    "success_rate",
    "survival_steps",
    "mean_speed_mps",
    "mean_speed_moving_mps",
    "standing_share",
    "collisions_per_1000_steps",
    "overlaps_per_1000_steps",
    "off_surface_share",
)

SPREAD = ("success_rate", "survival_steps", "mean_speed_mps")
"""Figures whose standard deviation over episodes is given."""

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


def table_rows(played: Mapping[Episode, tuple[TypeOutcome, ...]], steps: int) -> list[dict[str, Any]]:
    """A row for each selector, number of agents and type, with COLUMNS as keys, in the order of `played`.

    Figures are over all decisions (or road users) of all episodes of all seeds together; `_std` is the sample standard
    deviation between the figures of single episodes that have the type, `_seed_std` between those of whole seeds.
    None where there is nothing to take a figure from. `steps`: decisions of an episode.
    """
    cells = dict.fromkeys((episode.selector, episode.agents) for episode in played)
    rows = []
    for kind in TYPE_NAMES:
        for selector, agents in cells:
            mine = {
                episode: part
                for episode, outcome in played.items()
                if (episode.selector, episode.agents) == (selector, agents)
                for part in outcome
                if part.type == kind
            }
            if not mine:
                continue
            count = sum((episode.selector, episode.agents) == (selector, agents) for episode in played)
            of_seed = {episode.seed: [p for e, p in mine.items() if e.seed == episode.seed] for episode in mine}
            parts = list(mine.values())
            row: dict[str, Any] = {"selector": selector, "type": kind, "agents": agents, "episodes": count}
            row |= {"seeds": len(of_seed), "road_users": sum(len(part.present) for part in parts)}
            row |= {name: _rounded(value) for name, value in figures(parts, steps).items()}
            between = [figures([part], steps) for part in parts]
            row |= {f"{name}_std": _deviation([figure[name] for figure in between]) for name in SPREAD}
            seeds = [figures(some, steps) for some in of_seed.values()]
            row |= {f"{name}_seed_std": _deviation([figure[name] for figure in seeds]) for name in FIGURES}
            rows.append(row)
    return rows


def figures(parts: Sequence[TypeOutcome], steps: int) -> dict[str, float | None]:
    """FIGURES of the road users of one type in some episodes, at least one road user, taken together."""
    present = np.concatenate([part.present for part in parts]).astype(np.float64)
    survived = np.concatenate([part.survived for part in parts]).astype(np.float64)
    total = sum(part.steps for part in parts)
    standing = sum(part.standing for part in parts)
    off_surface = [part.off_surface for part in parts if part.off_surface is not None]
    return {
        "success_rate": float((survived == present).mean()),
        "survival_steps": mean_survival(present, survived, steps),
        "mean_speed_mps": _ratio(sum(part.speed_sum for part in parts), total),
        "mean_speed_moving_mps": _ratio(sum(part.moving_speed_sum for part in parts), total - standing),
        "standing_share": _ratio(standing, total),
        "collisions_per_1000_steps": _ratio(1000 * sum(part.collisions for part in parts), total),
        "overlaps_per_1000_steps": _ratio(1000 * sum(part.overlaps for part in parts), total),
        "off_surface_share": _ratio(sum(off_surface), total) if len(off_surface) == len(parts) else None,
    }


def _ratio(value: float, count: float) -> float | None:
    return value / count if count else None


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 6)


def _deviation(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return round(float(np.std(known, ddof=1)), 6) if len(known) > 1 else None
