"""Selectors measured in a scenario: many episodes, one table (paper, section 4.1)."""

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slrl_sumo.analysis.episode_log import EpisodeLog, Outcome, log_header
from slrl_sumo.analysis.episode_report import print_episodes, write_episodes
from slrl_sumo.analysis.episode_tables import table_rows
from slrl_sumo.analysis.episode_workers import Played, play_all
from slrl_sumo.analysis.episodes import SUMO, WARM_UP, Episode, EpisodeSettings, recorded
from slrl_sumo.analysis.interrupt import interruptible
from slrl_sumo.analysis.progress import progress as progress_bar
from slrl_sumo.analysis.published import published_rows
from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.selector import PolicySelector
from slrl_sumo.records.trajectories import load_trajectories
from slrl_sumo.simulation.driver import GUARDED, SELECTORS
from slrl_sumo.simulation.run import MOST_AGENTS
from slrl_sumo.sumo.scenario import find_scenario


@dataclass(frozen=True)
class EvaluationSettings:
    """What to evaluate; the words are those of `slrl-sumo evaluate SCENARIO`."""

    scenario: str
    bundle: str
    selectors: tuple[str, ...] = ()
    """Nothing: all that the bundle has, and SUMO's own models."""
    agents: tuple[int, ...] = (32,)
    episodes: int = 64
    """Per selector, number of agents and seed."""
    steps: int = 128
    seed: int = 1
    seeds: int = 1
    """How many seeds, from `seed` on."""
    workers: int = 2
    recording: Path | None = None
    """Trajectories of real road users, counted in the same way."""


def evaluate_scenario(
    settings: EvaluationSettings,
    folder: Path,
    *,
    progress: Callable[[int, int, float], None] = lambda done, total, per_s: None,
) -> dict[str, Any]:
    """Play all episodes that `folder`/episodes.jsonl does not hold yet, and make the tables, ready for JSON.

    `rows`: see `slrl_sumo.analysis.episode_tables.table_rows`; `published`: the paper's; `left_out`: episodes that
    could not be played. The figures do not depend on the number of workers. `progress` is told how many episodes are
    done, of how many, and how many a second. Raises InputError where settings or files are wrong, SumoError where no
    episode can be played.
    """
    bundle, scenario = load_bundle(settings.bundle), find_scenario(settings.scenario)
    selectors = settings.selectors or _selectors_of(bundle)
    _check(settings, selectors, bundle)
    truth = _recorded(settings)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); name another --out") from None
    common = EpisodeSettings(settings.scenario, settings.bundle, settings.steps)
    log = EpisodeLog(folder / "episodes.jsonl", log_header(common, scenario, bundle))
    wanted = _episodes(settings, selectors)
    missing = [episode for episode in wanted if episode not in log.done]
    left_out = []
    progress(len(wanted) - len(missing), len(wanted), 0.0)
    begin = time.perf_counter()
    with closing(play_all(common, missing, settings.workers)) as results:
        for number, played in enumerate(results, start=1):
            if played.outcome is None:
                left_out.append(played)
            else:
                log.add(played.episode, played.outcome)
            done = len(wanted) - len(missing) + number
            progress(done, len(wanted), number / (time.perf_counter() - begin))
    results_by_episode = {episode: log.done[episode] for episode in wanted if episode in log.done}
    if not results_by_episode:
        raise SumoError(f"no episode could be played: {left_out[-1].reason}")
    return {
        "scenario": scenario.name,
        "bundle": bundle.name,
        "selectors": list(selectors),
        "episodes": settings.episodes,
        "steps": settings.steps,
        "seed": settings.seed,
        "seeds": settings.seeds,
        "warm_up_s": WARM_UP,
        "recording": str(settings.recording) if settings.recording else None,
        "rows": table_rows({**results_by_episode, **truth}, settings.steps),
        "left_out": [_record(played) for played in sorted(left_out, key=lambda played: played.episode)],
        "published": published_rows(),
    }


def write_evaluation(settings: EvaluationSettings, folder: Path) -> int:
    """Evaluate with a progress bar, and write and print the tables. Returns 0, or the number of the signal (SIGINT or
    SIGTERM) that interrupted it; what was finished by then is in `folder`/episodes.jsonl."""
    with interruptible() as caught, progress_bar("{task.fields[rate]:.1f} episodes/s") as bar:
        task = bar.add_task(settings.scenario, total=None, rate=0.0)
        try:
            result = evaluate_scenario(
                settings,
                folder,
                progress=lambda done, total, rate: bar.update(task, completed=done, total=total, rate=rate),
            )
        except KeyboardInterrupt:
            bar.stop()
            print("interrupted: the same command goes on from the episodes that are finished", file=sys.stderr)
            return caught[0]
    write_episodes(result, folder)
    print_episodes(result)
    return 0


def _selectors_of(bundle: ModelBundle) -> tuple[str, ...]:
    return ("prior", "greedy", "sampled", SUMO) if bundle.policy is not None else ("prior", SUMO)


def _check(settings: EvaluationSettings, selectors: Sequence[str], bundle: ModelBundle) -> None:
    known = (*SELECTORS, SUMO)
    guarded = tuple(name + GUARDED for name in SELECTORS if name != "lane")
    for name in selectors:
        if name not in known + guarded:
            raise InputError(
                f"--selectors {name}: there is none of that name; use {', '.join(known)}, or greedy{GUARDED}"
            )
        if name.removesuffix(GUARDED) in ("greedy", "sampled"):
            PolicySelector(bundle, 0, sample=False)  # raises where the bundle has none
    for agents in settings.agents:
        if not 1 <= agents <= MOST_AGENTS:
            raise InputError(f"--agents {agents}: give numbers from 1 to {MOST_AGENTS}")
    for name in ("episodes", "steps", "seeds", "workers"):
        if getattr(settings, name) < 1:
            raise InputError(f"--{name} {getattr(settings, name)}: give a whole number, 1 or more")
    if not 0 <= settings.seed < 2**31:
        raise InputError(f"--seed {settings.seed}: give a whole number from 0 to 2147483647")


def _episodes(settings: EvaluationSettings, selectors: Sequence[str]) -> list[Episode]:
    """In the order in which they are played: all cells of the table grow together."""
    return list(
        dict.fromkeys(
            Episode(selector, agents, seed, number)
            for seed in range(settings.seed, settings.seed + settings.seeds)
            for number in range(settings.episodes)
            for selector in selectors
            for agents in ((0,) if selector == SUMO else settings.agents)
        )
    )


def _recorded(settings: EvaluationSettings) -> dict[Episode, Outcome]:
    if settings.recording is None:
        return {}
    recording = load_trajectories(settings.recording)
    outcomes = recorded(recording, settings.steps)
    return {Episode("recorded", 0, settings.seed, number): outcome for number, outcome in enumerate(outcomes)}


def _record(played: Played) -> dict[str, Any]:
    episode = played.episode
    return {
        "selector": episode.selector,
        "agents": episode.agents,
        "seed": episode.seed,
        "number": episode.number,
        "reason": played.reason,
    }
