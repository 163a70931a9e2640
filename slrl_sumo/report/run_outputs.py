"""What a run leaves behind: trace, summary, report."""

import errno
import io
import os
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table

from slrl_sumo.errors import InputError, SlrlError
from slrl_sumo.formats.fcd.columns import check_fcd_path
from slrl_sumo.formats.fcd.write import open_fcd
from slrl_sumo.formats.output_files import check_writable, write_json
from slrl_sumo.formats.trajectories import Trajectories, load_trajectories
from slrl_sumo.jobs.interrupt import interruptible
from slrl_sumo.jobs.progress import progress
from slrl_sumo.metrics.counters import RunCounters
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES
from slrl_sumo.simulation.events import Decision, RunSettings, Started
from slrl_sumo.simulation.isolated_run import run_isolated

if TYPE_CHECKING:
    from slrl_sumo.report.report import ReportBuilder

VIEWS_AT = frozenset({10, 40, 80, 140})
"""Decisions before which the report takes a picture of what some road users see."""


def write_run(
    settings: RunSettings,
    *,
    fcd: Path | None,
    summary: Path | None,
    report: Path | None,
    quiet: bool,
    recording: Path | None = None,
) -> int:
    """Run `settings` and write what was asked for. Returns 0, or the number of the signal that interrupted the run.

    `recording`: trajectories that the report compares with, instead of SUMO's own road users in the run.

    Where to write is checked before SUMO starts, and nothing is touched until everybody stands at the start. An
    interrupt (SIGINT, SIGTERM), a full disk or the death of SUMO ends the run after a whole step; what can still be
    written is, then the error is raised: the first one, with what else went wrong behind it. A second interrupt does
    not wait for the end of a step. Where nobody reads the table that is an InputError too.
    """
    if fcd is not None:
        check_fcd_path(fcd)
    for path in (fcd, summary, report):
        if path is not None:
            check_writable(path, folder=path is report)
    if recording is not None and report is None:
        raise InputError(f"--recording {recording}: the report compares with it; add --report DIR")
    truth = None if recording is None else _recorded(recording)
    failures: list[SlrlError] = []
    with ExitStack() as stack:
        caught = stack.enter_context(interruptible(tolerated=1))
        bar = stack.enter_context(progress("{task.fields[factor]:.1f}x real time", quiet=quiet))
        pictured = report is not None
        views_at = VIEWS_AT if pictured else frozenset[int]()
        events = stack.enter_context(closing(run_isolated(settings, views_at, with_surfaces=pictured)))
        try:
            started = next(events)
        except KeyboardInterrupt:
            return caught[0]
        assert isinstance(started, Started)
        begin = time.perf_counter()
        task = bar.add_task(started.scenario, total=started.decisions, factor=0.0)
        notices = (*started.notices, *((started.compiling,) if started.compiling else ()))
        for notice in () if quiet else notices:
            with suppress(OSError):  # nobody reads stderr: that is no reason to stop
                print(f"note: {notice}", file=sys.stderr)
        tally = RunCounters(started.step.world)
        pictures = _pictures(started, truth) if report is not None else None
        writer = open_fcd(fcd) if fcd is not None else None
        if writer is not None:
            stack.enter_context(writer)
        with _collected(failures), suppress(KeyboardInterrupt):
            if writer is not None:
                writer.write(started.step.time, started.step.world, started.step.places)
            for event in events:
                if isinstance(event, Decision):
                    if writer is not None:
                        for step in event.steps:
                            writer.write(step.time, step.world, step.places, event.modes)
                    tally.add(event)
                    elapsed = time.perf_counter() - begin
                    bar.update(task, advance=1, factor=tally.decisions * DECISION_INTERVAL / max(elapsed, 1e-9))
                if pictures is not None:
                    pictures.add(event)
                if caught:
                    break
        wall = time.perf_counter() - begin
        with _collected(failures):
            if writer is not None:
                writer.close()
    result = _summary(settings, started, tally, wall)
    with _collected(failures):
        if summary is not None:
            write_json(summary, result)
    with _collected(failures):
        if report is not None and pictures is not None:
            pictures.write(report, result)
    with _collected(failures):
        if not quiet:
            _print_table(summary_table(result))
    if failures:
        raise type(failures[0])("; ".join(map(str, failures)))
    return caught[0] if caught else 0


@contextmanager
def _collected(failures: list[SlrlError]) -> Iterator[None]:
    """What fails is told in the end: one output that cannot be written is no reason to lose the others."""
    try:
        yield
    except SlrlError as error:
        failures.append(error)


def _recorded(file: Path) -> Trajectories:
    recording = load_trajectories(file)
    if abs(recording.dt - DECISION_INTERVAL) > 1e-6:
        raise InputError(
            f"--recording {file}: its interval is {recording.dt:g} s, not {DECISION_INTERVAL:g} s; "
            "make it with `slrl-sumo import` or `slrl-sumo record`"
        )
    return recording


def _pictures(started: Started, recording: Trajectories | None) -> "ReportBuilder":
    from slrl_sumo.report.report import ReportBuilder  # matplotlib takes its time

    return ReportBuilder(started, recording)


def _summary(settings: RunSettings, started: Started, tally: RunCounters, wall_s: float) -> dict[str, Any]:
    return {
        "scenario": started.scenario,
        "seed": settings.seed,
        "bundle": started.bundle,
        "selector": started.selector,
        "sumo_step_s": started.step_length,
        "begin_s": started.begin,
        **tally.summary(wall_s, DECISION_INTERVAL),
        "peak_memory_mib": _peak_memory_mib(),
        "notices": list(started.notices),
    }


def _peak_memory_mib() -> int:
    """Of this process and of the largest that it has waited for (the one that held SUMO), added up."""
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return round(sum(resource.getrusage(w).ru_maxrss for w in who) / 1024)


def summary_table(result: dict[str, Any]) -> Table:
    """The summary as a table for people."""
    table = Table(
        title=(
            f"{result['scenario']}: {result['agent_steps']} agent-steps in {result['wall_s']:.1f} s "
            f"({result['real_time_factor'] or 0:.1f}x real time), "
            f"{result['wrapped_around']} wrapped around, {result['lost']} lost"
        ),
        title_justify="left",
    )
    columns = {
        "count": "count",
        "mean speed (m/s)": "mean_speed_mps",
        "standing": "standing_share",
        "collisions": "collisions",
        "overlaps": "overlaps",
        "survival (steps)": "survival_steps",
        "success": "success_rate",
        "off surface": "off_surface_share",
    }
    table.add_column("type")
    for column in columns:
        table.add_column(column, justify="right")
    for name in TYPE_NAMES:
        row = result["per_type"][name]
        if row["count"]:
            table.add_row(name, *(_cell(key, row[key]) for key in columns.values()))
    return table


def _print_table(table: Table) -> None:
    # Rendered first: where nobody reads, rich would end the process on its own.
    terminal = Console().is_terminal
    text = io.StringIO()
    # Where nobody watches, a log should not be squeezed into rich's 80 columns.
    Console(file=text, width=Console().width if terminal else 120, force_terminal=terminal).print(table)
    try:
        if sys.stdout is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        sys.stdout.write(text.getvalue())
        sys.stdout.flush()
    except OSError as error:
        # What is left in the buffer would make Python complain once more when it ends.
        sys.stdout = None
        raise InputError(
            f"standard output: the table could not be printed ({error.strerror}); --quiet prints none"
        ) from None


def _cell(key: str, value: float | None) -> str:
    if value is None:  # the run ended before its first decision
        return "–"
    if key in ("standing_share", "success_rate", "off_surface_share"):
        return f"{100 * value:.1f} %"
    return f"{value:.2f}" if isinstance(value, float) else str(value)
