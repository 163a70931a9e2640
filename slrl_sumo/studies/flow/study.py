"""The flow benchmark: all runs, and their result."""

import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from slrl_sumo.agent.make_driver import GUARDED, SELECTORS, TRAINED, make_selector, unknown_selector
from slrl_sumo.errors import InputError, SumoError, check_whole_number
from slrl_sumo.jobs.interrupt import interruptible
from slrl_sumo.jobs.pool import Backend, Finished, portable_name, run_jobs
from slrl_sumo.jobs.progress import progress as progress_bar
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import shipped_bundles
from slrl_sumo.studies.flow.report import print_flow, write_flow
from slrl_sumo.studies.flow.run import SUMO, Record, Run, run_case
from slrl_sumo.studies.flow.situations import SITUATIONS
from slrl_sumo.studies.flow.tables import rows
from slrl_sumo.studies.log import StudyLog, bundle_header


@dataclass(frozen=True)
class FlowSettings:
    """Settings of the flow benchmark, named as the options of `slrl-sumo bench --flow`."""

    only: tuple[str, ...] = ()
    """Names of SITUATIONS; empty: all except whole networks."""
    networks: bool = False
    """Instead of those the whole networks."""
    selectors: tuple[str, ...] = ()
    """Selectors, with the suffix GUARDED for runs with the guard; empty: all selectors of the bundle except
    `sampled`."""
    bundle: str = "intersection"
    share: float = 1.0
    """Of the road users of each type that are learned."""
    seed: int = 1
    seeds: int = 1
    """Number of seeds, from `seed` on."""
    backend: Backend = field(default_factory=Backend)
    """Processes of the runs."""


def measure_flow(
    settings: FlowSettings, folder: Path | None, *, progress: Callable[[int, int], None] = lambda done, total: None
) -> tuple[dict[str, Any], dict[Run, Record]]:
    """Do all runs that `folder`/runs.jsonl does not contain yet; returns the result and all runs.

    `rows`: see `tables.rows`; `left_out`: runs that failed. `progress` receives the number of finished runs and of all
    runs. Raises InputError where settings or files are wrong, SumoError where no run of SUMO's own models succeeds.
    """
    bundle = load_bundle(settings.bundle)
    situations, selectors = _checked(settings, bundle)
    wanted = [
        Run(situation, arm, seed)
        for situation in situations
        for seed in range(settings.seed, settings.seed + settings.seeds)
        for arm in (SUMO, *selectors)
    ]
    done: dict[Run, Record] = {}
    log = None
    if folder is not None:
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: cannot be made ({error.strerror}); name another --out") from None
        log = StudyLog(folder / "runs.jsonl", bundle_header(bundle) | {"share": settings.share}, "runs")
        done = dict(log.read(lambda line: (Run(line["situation"], line["arm"], line["seed"]), line["record"])))
    missing = [run for run in wanted if run not in done]
    left_out: list[Finished[Run, Record]] = []
    progress(len(wanted) - len(missing), len(wanted))
    work = partial(run_case, portable_name(settings.bundle, shipped_bundles()), settings.share)
    with closing(run_jobs(work, missing, settings.backend)) as results:
        for number, finished in enumerate(results, start=1):
            if finished.record is None:
                left_out.append(finished)
            else:
                done[finished.job] = finished.record
                if log is not None:
                    log.add(asdict(finished.job) | {"record": finished.record})
            progress(len(wanted) - len(missing) + number, len(wanted))
    runs = {run: done[run] for run in wanted if run in done}
    if not any(run.arm == SUMO for run in runs):
        raise SumoError(f"no run of SUMO's own models succeeded: {left_out[-1].reason}")
    result = {
        "bundle": bundle.name,
        "share": settings.share,
        "seeds": list(range(settings.seed, settings.seed + settings.seeds)),
        "selectors": list(selectors),
        "situations": {name: SITUATIONS[name].about for name in situations},
        "rows": rows(runs),
        "left_out": [asdict(one.job) | {"reason": one.reason} for one in sorted(left_out, key=lambda one: one.job)],
    }
    return result, runs


def write_measured_flow(settings: FlowSettings, folder: Path | None) -> int:
    """Measure with a progress bar; print the result, and write it into `folder`. Returns 0, or the number of the
    signal that interrupted it; the runs finished by then are in `folder`/runs.jsonl."""
    begin = time.perf_counter()
    with interruptible() as caught, progress_bar("{task.completed:.0f} of {task.total} runs") as bar:
        task = bar.add_task("flow", total=None)
        try:
            result, runs = measure_flow(
                settings, folder, progress=lambda done, total: bar.update(task, completed=done, total=total)
            )
        except KeyboardInterrupt:
            bar.stop()
            if folder is not None:
                print("interrupted: the same command continues after the finished runs", file=sys.stderr)
            return caught[0]
    if folder is not None:
        write_flow(result, runs, folder)
    print_flow(result, folder, time.perf_counter() - begin)
    return 0


def _checked(settings: FlowSettings, bundle: ModelBundle) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Situations and selectors. Raises InputError."""
    check_whole_number("seeds", settings.seeds, 1, 10_000)
    check_whole_number("seed", settings.seed, 0, 2**31 - 1 - settings.seeds)
    if not 0.0 < settings.share <= 1.0:
        raise InputError("give a share above 0 and up to 1", argument="share", value=settings.share)
    for name in settings.only:
        if name not in SITUATIONS:
            raise InputError(
                f"there is no situation of that name; use {', '.join(SITUATIONS)}", argument="only", value=name
            )
    if settings.only and settings.networks:
        raise InputError("--only and --networks were both given; --only names networks, too")
    for selector in settings.selectors:
        name = selector.removesuffix(GUARDED)
        if name not in SELECTORS:
            raise unknown_selector(name)
        if name == "lane" and selector != name:
            raise InputError("lane chooses no modes; name it without the guard", argument="selectors", value=selector)
        if name in TRAINED:
            make_selector(name, bundle, 0)  # raises where the bundle has none
    usual = tuple(one for one in SELECTORS if one not in TRAINED or (one == "greedy" and bundle.policy is not None))
    groups = tuple(name for name, situation in SITUATIONS.items() if situation.network == settings.networks)
    return settings.only or groups, settings.selectors or usual
