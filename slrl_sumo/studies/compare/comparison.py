"""A scenario with equal seeds, with SUMO's models and with learned road users: all runs and their result."""

import math
import shlex
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from slrl_sumo.agent.make_driver import SELECTORS, TRAINED, make_selector, usual_selector
from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.jobs.interrupt import interruptible
from slrl_sumo.jobs.pool import Backend, Finished, portable_name, run_jobs
from slrl_sumo.jobs.progress import progress as progress_bar
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import shipped_bundles
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.simulation.excluded import Excluded, parse_excluded, unseen_notices
from slrl_sumo.simulation.shares import parse_shares, served_shares
from slrl_sumo.studies.compare.report import print_comparison, write_comparison
from slrl_sumo.studies.compare.run import ARMS, ComparedScenario, Record, Run, run_comparison
from slrl_sumo.studies.compare.tables import distances, rows
from slrl_sumo.studies.log import StudyLog, inputs_header
from slrl_sumo.sumo.scenario import Scenario, find_scenario
from slrl_sumo.sumo.scenario.command import sumo_step_length

USUAL_SECONDS = 600.0
"""Length of the runs of a scenario without an end, s."""


@dataclass(frozen=True)
class ComparisonSettings:
    """Settings of a comparison, named as the options of `slrl-sumo compare`."""

    scenario: str
    bundle: str
    takeover: str = "car=1,bicycle=1,pedestrian=1"
    region: str | None = None
    exclude: Excluded = ()
    selector: str | None = None
    guard: bool = False
    steps: int | None = None
    """Decisions of 0.4 s; None: `seconds`, or to the scenario's end."""
    seconds: float | None = None
    seed: int = 1
    seeds: int = 5
    """Number of seeds, from `seed` on."""
    step_length: float | None = None
    backend: Backend = field(default_factory=Backend)
    """Processes of the runs."""


def compare(
    settings: ComparisonSettings,
    folder: Path,
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[dict[str, Any], dict[Run, Record]]:
    """Do all runs that `folder`/runs.jsonl does not contain yet. Returns the result, ready for JSON, and all runs.

    `rows`: see `tables.rows`; `distances`: between the distributions of motion; `left_out`: runs that failed. The
    figures do not depend on which processes do the runs. `progress` receives the number of finished runs and the
    number of all runs. Raises InputError where settings or files are wrong, SumoError where no seed has both its runs.
    """
    bundle, scenario = load_bundle(settings.bundle), find_scenario(settings.scenario)
    common = _common(settings, bundle, scenario)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); name another --out") from None
    wanted = [Run(seed, arm) for seed in range(settings.seed, settings.seed + settings.seeds) for arm in ARMS]
    log = StudyLog(folder / "runs.jsonl", _header(common, scenario, bundle), "runs")
    done: dict[Run, Record] = dict(log.read(lambda line: (Run(line["seed"], line["arm"]), line["record"])))
    missing = [run for run in wanted if run not in done]
    left_out: list[Finished[Run, Record]] = []
    progress(len(wanted) - len(missing), len(wanted))
    with closing(run_jobs(partial(run_comparison, common), missing, settings.backend)) as results:
        for number, finished in enumerate(results, start=1):
            if finished.record is None:
                left_out.append(finished)
            else:
                done[finished.job] = finished.record
                log.add(asdict(finished.job) | {"record": finished.record})
            progress(len(wanted) - len(missing) + number, len(wanted))
    runs = {run: done[run] for run in wanted if run in done}
    seeds = sorted({run.seed for run in runs if all(Run(run.seed, arm) in runs for arm in ARMS)})
    if not seeds:
        raise SumoError(f"no seed has both its runs: {left_out[-1].reason}")
    result = {
        "scenario": scenario.name,
        "bundle": bundle.name,
        **{name: getattr(common, name) for name in ("selector", "guard", "takeover", "region", "exclude")},
        "seconds": round(common.decisions * DECISION_INTERVAL, 3),
        "seeds": seeds,
        "notices": _notices(runs, seeds[0], common.exclude),
        "rows": rows({run: runs[run] for run in runs if run.seed in seeds}),
        "distances": distances({run: runs[run] for run in runs if run.seed in seeds}),
        "left_out": [
            {"seed": one.job.seed, "arm": one.job.arm, "reason": one.reason, "command": _command(common, one.job)}
            for one in sorted(left_out, key=lambda one: one.job)
        ],
    }
    return result, runs


def write_compared(settings: ComparisonSettings, folder: Path) -> int:
    """Compare with a progress bar; write and print the result. Returns 0, or the number of
    the signal that interrupted it; the runs finished by then are in `folder`/runs.jsonl."""
    begin = time.perf_counter()
    with interruptible() as caught, progress_bar("{task.completed:.0f} of {task.total} runs") as bar:
        task = bar.add_task(settings.scenario, total=2 * settings.seeds)
        try:
            result, runs = compare(
                settings, folder, progress=lambda done, total: bar.update(task, completed=done, total=total)
            )
        except KeyboardInterrupt:
            bar.stop()
            print("interrupted: the same command continues after the finished runs", file=sys.stderr)
            return caught[0]
    write_comparison(result, runs, folder)
    print_comparison(result, folder, time.perf_counter() - begin)
    return 0


def _command(common: ComparedScenario, run: Run) -> str:
    """The command that repeats only the two runs of a seed."""
    words: list[Any] = ["slrl-sumo", "compare", common.scenario, "--bundle", common.bundle]
    words += ["--takeover", common.takeover, "--selector", common.selector, "--steps", common.decisions]
    words += [*(["--region", common.region] if common.region else []), *(["--guard"] if common.guard else [])]
    words += ["--exclude", common.exclude] if common.exclude else []
    words += ["--step-length", common.step_length] if common.step_length else []
    return shlex.join([*map(str, words), "--seed", str(run.seed), "--seeds", "1", "--out", "repeated"])


def _notices(runs: dict[Run, Record], seed: int, exclude: str) -> list[str]:
    unseen = set(parse_excluded(exclude)).difference(*(record["trips"] for record in runs.values()))
    lines = [*runs[Run(seed, ARMS[0])]["notices"], *unseen_notices(unseen)]
    unknown = sorted({name for record in runs.values() for name in record["emissions"]["unknown"]})
    if unknown:
        lines.append(f"no emissions of {', '.join(unknown)}: this SUMO has no data for them")
    return lines


def _header(common: ComparedScenario, scenario: Scenario, bundle: ModelBundle) -> dict[str, Any]:
    """All settings on which a run depends, except the Run itself."""
    own = {name: value for name, value in asdict(common).items() if name not in ("scenario", "bundle")}
    return inputs_header(scenario, bundle) | own


def _common(settings: ComparisonSettings, bundle: ModelBundle, scenario: Scenario) -> ComparedScenario:
    """Checked settings. Raises InputError."""
    selector = settings.selector or usual_selector(bundle)
    if selector not in SELECTORS:
        raise InputError(f"--selector {selector}: there is none of that name; use {' or '.join(SELECTORS)}")
    if selector in TRAINED:
        make_selector(selector, bundle, 0)  # raises where the bundle has none
    if settings.guard and selector == "lane":
        raise InputError("--guard: --selector lane chooses no modes; leave the guard out, or take another selector")
    if not 1 <= settings.seeds <= 10_000:
        raise InputError(f"--seeds {settings.seeds}: give a whole number from 1 to 10000")
    if not 0 <= settings.seed < 2**31 - settings.seeds:
        raise InputError(f"--seed {settings.seed}: give a whole number from 0 to 2147473647")
    if settings.steps is not None and settings.seconds is not None:
        raise InputError("--steps and --seconds were both given; give one of them")
    if settings.steps is not None and settings.steps < 1:
        raise InputError(f"--steps {settings.steps}: at least one decision is needed")
    if settings.seconds is not None and not 0 < settings.seconds < 1e7:
        raise InputError(f"--seconds {settings.seconds:g}: give a number above 0")
    _ = parse_shares(settings.takeover) if selector == "lane" else served_shares(settings.takeover, bundle)
    sumo_step_length(scenario, settings.step_length)
    return ComparedScenario(
        scenario=portable_name(settings.scenario),
        bundle=portable_name(settings.bundle, shipped_bundles()),
        decisions=_decisions(settings, scenario),
        takeover=settings.takeover,
        region=settings.region,
        exclude=",".join(parse_excluded(settings.exclude)),
        selector=selector,
        guard=settings.guard,
        step_length=settings.step_length,
    )


def _decisions(settings: ComparisonSettings, scenario: Scenario) -> int:
    if settings.steps is not None:
        return settings.steps
    seconds = settings.seconds
    if seconds is None:
        begin, end = scenario.seconds("begin") or 0.0, scenario.seconds("end")
        seconds = end - begin if end is not None and end > begin else USUAL_SECONDS
    return max(1, math.ceil(seconds / DECISION_INTERVAL - 1e-9))
