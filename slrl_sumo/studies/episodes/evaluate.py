"""Evaluation of selectors in a scenario: many episodes, one table (paper, section 4.1)."""

import shlex
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from slrl_sumo.agent.make_driver import GUARDED, SELECTORS, TRAINED, make_selector
from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.formats.trajectory_file import load_trajectories
from slrl_sumo.jobs.interrupt import interruptible
from slrl_sumo.jobs.pool import Backend, Finished, portable_name, run_jobs
from slrl_sumo.jobs.progress import progress as progress_bar
from slrl_sumo.metrics.outcomes import TypeOutcome
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import shipped_bundles
from slrl_sumo.simulation.settings import MOST_AGENTS
from slrl_sumo.studies.episodes.episode import SUMO, WARM_UP, Episode, EpisodeSettings, recorded, run_episode
from slrl_sumo.studies.episodes.plan import EpisodePlan
from slrl_sumo.studies.episodes.published import published_rows
from slrl_sumo.studies.episodes.report import print_episodes, write_episodes
from slrl_sumo.studies.episodes.tables import EpisodeTables
from slrl_sumo.studies.log import StudyLog, inputs_header
from slrl_sumo.sumo.scenario import find_scenario

Outcome = tuple[TypeOutcome, ...]

RECORDED = ("recorded", 0)
"""Selector and number of agents in the rows of recorded road users."""


@dataclass(frozen=True)
class EvaluationSettings:
    """Settings of an evaluation, named as the options of `slrl-sumo evaluate SCENARIO`."""

    scenario: str
    bundle: str
    selectors: tuple[str, ...] = ()
    """Selectors; empty: all selectors of the bundle, and SUMO's models."""
    agents: tuple[int, ...] = (32,)
    episodes: int = 64
    """Per selector, number of agents and seed."""
    steps: int = 128
    seed: int = 1
    seeds: int = 1
    """Number of seeds, from `seed` on."""
    first: int = 0
    """Number of the first episode of each seed, to repeat a failed episode."""
    backend: Backend = field(default_factory=Backend)
    """Processes of the episodes."""
    recording: Path | None = None
    """Trajectories of recorded road users, counted in the same way."""


def evaluate_scenario(
    settings: EvaluationSettings,
    folder: Path,
    *,
    progress: Callable[[int, int, float], None] = lambda done, total, per_s: None,
) -> dict[str, Any]:
    """Play all episodes that `folder`/episodes.jsonl does not contain yet, and make the tables, ready for JSON.

    `rows`: see `slrl_sumo.studies.episodes.tables`; `published`: rows of the paper; `left_out`: episodes that failed,
    each with the command that repeats it. The figures do not depend on which processes run the episodes. Memory grows
    by one byte for each episode. `progress` receives the numbers of finished and of all episodes, and the episodes per
    second. Raises InputError where settings or files are wrong, SumoError where no episode can be played.
    """
    bundle, scenario = load_bundle(settings.bundle), find_scenario(settings.scenario)
    selectors = settings.selectors or _selectors_of(bundle)
    _check(settings, selectors, bundle)
    truth = _recorded(settings)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); name another --out") from None
    models = portable_name(settings.bundle, shipped_bundles())
    common = EpisodeSettings(portable_name(settings.scenario), models, settings.steps)
    header = inputs_header(scenario, bundle) | {"steps": settings.steps, "warm_up_s": WARM_UP}
    log = StudyLog(folder / "episodes.jsonl", header, "episodes")
    plan = _plan(settings, selectors)
    tables = EpisodeTables((*plan.parties, RECORDED), settings.steps, settings.episodes)
    ended = bytearray(len(plan))

    def add(line: dict[str, Any]) -> None:
        episode, outcome = _parsed(line)
        index = plan.index(episode)
        if index is not None and not ended[index]:
            ended[index] = True
            tables.add(episode, outcome)

    for _ in log.read(add):
        pass
    done = already = sum(ended)
    missing = (episode for index, episode in enumerate(plan) if not ended[index])
    left_out: list[Finished[Episode, Outcome]] = []
    progress(done, len(plan), 0.0)
    begin = time.perf_counter()
    with closing(run_jobs(partial(run_episode, common), missing, settings.backend)) as results:
        for finished in results:
            if finished.record is None:
                left_out.append(finished)
                tables.leave_out(finished.job)
            else:
                log.add(asdict(finished.job) | {"outcome": [asdict(part) for part in finished.record]})
                tables.add(finished.job, finished.record)
            done += 1
            progress(done, len(plan), (done - already) / (time.perf_counter() - begin))
    if len(left_out) == len(plan):
        raise SumoError(f"no episode could be played: {left_out[-1].reason}")
    for episode, outcome in truth:
        tables.add(episode, outcome)
    return {
        "scenario": scenario.name,
        "bundle": bundle.name,
        "selectors": list(selectors),
        "episodes": settings.episodes,
        "steps": settings.steps,
        "seed": settings.seed,
        "seeds": settings.seeds,
        "first": settings.first,
        "warm_up_s": WARM_UP,
        "recording": str(settings.recording) if settings.recording else None,
        "rows": tables.rows(),
        "left_out": [_record(settings, failed) for failed in sorted(left_out, key=lambda failed: failed.job)],
        "published": published_rows(),
    }


def write_evaluation(settings: EvaluationSettings, folder: Path) -> int:
    """Evaluate with a progress bar; write and print the tables. Returns 0, or the number of
    the signal that interrupted it; the episodes finished by then are in `folder`/episodes.jsonl."""
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
            print("interrupted: the same command continues after the finished episodes", file=sys.stderr)
            return caught[0]
    write_episodes(result, folder)
    print_episodes(result)
    return 0


def _parsed(line: dict[str, Any]) -> tuple[Episode, Outcome]:
    """An episode of the log, and its outcome."""
    parts = line.pop("outcome")
    lives = ({name: tuple(part[name]) for name in ("present", "paper_survived")} for part in parts)
    return Episode(**line), tuple(TypeOutcome(**part | life) for part, life in zip(parts, lives, strict=True))


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
        if name.removesuffix(GUARDED) in TRAINED:
            make_selector(name.removesuffix(GUARDED), bundle, 0)  # raises where the bundle has none
    for agents in settings.agents:
        if not 1 <= agents <= MOST_AGENTS:
            raise InputError(f"--agents {agents}: give numbers from 1 to {MOST_AGENTS}")
    for name in ("episodes", "steps", "seeds"):
        if getattr(settings, name) < 1:
            raise InputError(f"--{name} {getattr(settings, name)}: give a whole number, 1 or more")
    if settings.first < 0:
        raise InputError(f"--first {settings.first}: give a whole number, 0 or more")
    if not 0 <= settings.seed < 2**31:
        raise InputError(f"--seed {settings.seed}: give a whole number from 0 to 2147483647")


def _plan(settings: EvaluationSettings, selectors: Sequence[str]) -> EpisodePlan:
    parties = ((name, agents) for name in selectors for agents in ((0,) if name == SUMO else settings.agents))
    seeds, numbers = (
        range(a, a + n) for a, n in ((settings.seed, settings.seeds), (settings.first, settings.episodes))
    )
    return EpisodePlan(tuple(dict.fromkeys(parties)), seeds, numbers)


def _recorded(settings: EvaluationSettings) -> list[tuple[Episode, Outcome]]:
    if settings.recording is None:
        return []
    recording = load_trajectories(settings.recording)
    outcomes = recorded(recording, settings.steps)
    return [(Episode(*RECORDED, settings.seed, number), outcome) for number, outcome in enumerate(outcomes)]


def _record(settings: EvaluationSettings, failed: Finished[Episode, Outcome]) -> dict[str, Any]:
    episode = failed.job
    words: list[Any] = ["slrl-sumo", "evaluate", settings.scenario, "--bundle", settings.bundle]
    words += ["--selectors", episode.selector, *(["--agents", episode.agents] if episode.agents else [])]
    words += ["--seed", episode.seed, "--first", episode.number, "--episodes", 1, "--steps", settings.steps]
    return {
        "selector": episode.selector,
        "agents": episode.agents,
        "seed": episode.seed,
        "number": episode.number,
        "reason": failed.reason,
        "command": shlex.join([*map(str, words), "--workers", "1", "--out", "repeated"]),
    }
