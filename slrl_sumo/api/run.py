"""A run in a process of its own, with the outputs that it writes: trace, summary, report."""

import logging
import resource
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from slrl_sumo.api.result import REPORT_FILES, RunResult
from slrl_sumo.api.summary import RunSummary
from slrl_sumo.errors import DefectError, InputError, SlrlError, SumoError, check_type
from slrl_sumo.extras import require
from slrl_sumo.formats.fcd.columns import check_fcd_path
from slrl_sumo.formats.fcd.trace import TraceWriter, trace_files
from slrl_sumo.formats.output_files import Output, claimed, write_json
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.formats.trajectory_file import load_trajectories
from slrl_sumo.jobs.interrupt import interruptible, interruptible_to_the_end
from slrl_sumo.jobs.memory import peak_memory_mib
from slrl_sumo.jobs.progress import progress as progress_bar
from slrl_sumo.metrics.counters import RunCounters
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE, find_bundle
from slrl_sumo.report.recorder import RunRecord, RunRecorder
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.simulation.events import MOST_DECISIONS, Decision, Event, Started
from slrl_sumo.simulation.excluded import Excluded, parse_excluded
from slrl_sumo.simulation.isolated_run import run_isolated
from slrl_sumo.simulation.settings import RunSettings, constraint_names
from slrl_sumo.simulation.shares import Shares
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.command import sumo_step_length
from slrl_sumo.sumo.scenario.options import named_files

if TYPE_CHECKING:
    from slrl_sumo.simulation.region import RegionSpec  # scipy takes its time

LOG_EVERY = 150
"""Decisions (60 s) between two lines of the log."""
VIEWS_AT = frozenset({10, 40, 80, 140})
"""Decisions before which the ego images of some road users are kept for the report."""


_log = logging.getLogger(__name__)


def run(
    scenario: str | Path | Scenario,
    *,
    agents: int | None = None,
    mix: Shares | None = None,
    takeover: Shares | None = None,
    region: "str | RegionSpec | None" = None,
    exclude: Excluded = (),
    bundle: str | Path = DEFAULT_BUNDLE,
    selector: str | None = None,
    guard: bool = False,
    without: Sequence[str] = (),
    steps: int | None = None,
    until: float | None = None,
    seed: int = 1,
    step_length: float | None = None,
    background_yields: bool = True,
    threads: int = 1,
    sumo_outputs: bool = False,
    sumo_options: str = "",
    gui: bool = False,
    fcd: str | Path | None = None,
    summary: str | Path | None = None,
    report: str | Path | None = None,
    recording: str | Path | None = None,
    keep_trajectories: bool = True,
    progress: bool = False,
) -> RunResult:
    """Run learned road users in a scenario. SUMO runs in a process of its own: where it dies, this one goes on.

        result = slrl_sumo.run("district", agents=64, steps=150)
        result = slrl_sumo.run("my.sumocfg", takeover={"car": 0.3, "bicycle": 1}, region="junction:C,radius=80")

    `scenario`: shipped name, folder, .sumocfg file or Scenario. `agents`: road users to add, shared out among the types
    by `mix`. `takeover`: share of each type of the scenario's own road users that become learned, inside `region`
    (text as on the command line, or a JunctionRegion, EdgesRegion or BoxRegion). `exclude`: ids of road users that are
    left alone, neither taken over nor held for learned ones. `bundle`: shipped name or folder. `selector`: prior, rule,
    greedy, sampled or lane. `guard`: modes that run into a conflict are not chosen where others are left. `without`:
    names of constraints to switch off (see agent.constraints).
    `steps`: decisions of 0.4 s; `until`: simulation time in s; without both the run goes to the
    scenario's end, or, where it has none, until its road users have left.
    `step_length`: SUMO's step in s. `background_yields`: whether SUMO's vehicles and persons stop for learned ones.
    `threads`: over which the road users of a decision are distributed; the results are the same for any number.
    `sumo_outputs`: whether the scenario writes its own outputs. `sumo_options`: options for SUMO itself.
    `gui`: whether SUMO opens the window of sumo-gui.

    Files to write: `fcd` (.xml, .xml.gz, .csv, .parquet), `summary` (JSON), `report` (a folder, compared with the
    trajectories file `recording`). `keep_trajectories`: whether the result holds trajectories (at most a million
    positions). `progress`: a progress bar and notices on stderr.

    Raises InputError where an argument is wrong or an output cannot be written, SumoError where SUMO dies, DefectError
    where this package fails, and KeyboardInterrupt; outputs are complete up to the last whole step.
    """
    for name, path in (("fcd", fcd), ("summary", summary), ("report", report), ("recording", recording)):
        check_type(name, path, (str, Path, type(None)), "a path")
    settings = RunSettings(
        scenario,
        agents=agents,
        mix=mix,
        takeover=takeover,
        region=region,
        exclude=exclude,
        bundle=bundle,
        selector=selector,
        guard=guard,
        without=constraint_names(without),
        steps=steps,
        until=until,
        seed=seed,
        step_length=step_length,
        background_yields=background_yields,
        threads=threads,
        sumo_outputs=sumo_outputs,
        sumo_options=sumo_options,
        gui=gui,
    )
    result = write_run(
        settings,
        fcd=None if fcd is None else Path(fcd),
        summary=None if summary is None else Path(summary),
        report=None if report is None else Path(report),
        recording=None if recording is None else Path(recording),
        keep=keep_trajectories,
        quiet=not progress,
    )
    result.raise_failures()
    return result


def write_run(
    settings: RunSettings,
    *,
    fcd: Path | None = None,
    summary: Path | None = None,
    report: Path | None = None,
    recording: Path | None = None,
    keep: bool = False,
    quiet: bool = True,
) -> RunResult:
    """Run `settings` and write the outputs that are named.

    `recording`: trajectories that the report compares with, instead of SUMO's own road users in the run. With `keep`
    the result holds what trajectories, report and replay are made from. Unless `quiet`, a progress bar and notices go
    to stderr.

    Outputs are claimed before SUMO starts (see `claimed`), and none is touched before all road users are at their
    starting places. An interrupt (SIGINT, SIGTERM, SIGHUP), a full disk, the death of SUMO or a defect ends the run
    after a whole step; the outputs that can still be written are, the summary says what ended the run, and the result
    lists the failures. Raises InputError where the settings are
    wrong, SumoError where SUMO dies while it loads, and KeyboardInterrupt with the number of the signal where one came
    before the start.
    """
    if fcd is not None:
        check_fcd_path(fcd)
    if recording is not None and report is None:
        raise InputError("the report compares with it; add `report=DIR`", argument="recording", value=str(recording))
    if report is not None:
        require("matplotlib", f"`report={report}`")
    outputs = [
        *([Output("fcd", file) for file in trace_files(fcd)] if fcd is not None else ()),
        *([Output("summary", summary)] if summary is not None else ()),
        *([Output("report", report, REPORT_FILES)] if report is not None else ()),
    ]
    # What needs no SUMO is checked here: the process that has it takes seconds to start.
    scenario = settings.found()
    sumo_step_length(scenario, settings.step_length)
    inputs = [*named_files(scenario), find_bundle(settings.bundle), *([recording] if recording is not None else ())]
    reference = None if recording is None else _loaded(recording)
    _log.info("scenario %s, bundle %s", scenario.config, find_bundle(settings.bundle))
    with claimed(outputs, inputs), interruptible(tolerated=1) as caught:
        played = _play(settings, fcd, keep or report is not None, quiet, caught)
        failures = played.failures
        ended_by = str(failures[0]) if failures else signal.Signals(caught[0]).name if caught else None
        notices = _notices(played)
        _tell(notices, quiet)
        figures = RunSummary.of(
            settings,
            played.started,
            played.counters,
            end_s=played.end,
            ended_by=ended_by,
            wall_s=played.wall_s,
            peak_memory_mib=_peak_memory_mib(),
            outputs={"fcd": fcd, "summary": summary, "report": report, "recording": recording},
            notices=notices,
        )
        result = RunResult(settings, figures, played.record, fcd)
        written = [fcd] if fcd is not None and not any(isinstance(each, InputError) for each in failures) else []
        for path, write in (
            (summary, lambda path: write_json(path, figures.to_dict())),
            (report, lambda path: result.write_report(path, reference)),
        ):
            with _collected(failures):
                if path is not None:
                    _log.info("writing %s", path)
                    write(path)
                    written.append(path)
        if failures and isinstance(failures[0], SumoError):
            complete = f"complete up to there: {', '.join(map(str, written))}" if written else "no output was written"
            failures[0] = SumoError(f"{failures[0]}; {complete}")
    return replace(result, failures=tuple(failures), interrupted_by=caught[0] if caught else 0)


@dataclass(frozen=True)
class _Played:
    """A run that is over, as far as it came."""

    started: Started
    counters: RunCounters
    record: RunRecord | None
    end: float
    """Time of its last step, s."""
    wall_s: float
    failures: list[SlrlError]
    """What ended it before its time."""


def _play(settings: RunSettings, fcd: Path | None, keep: bool, quiet: bool, caught: list[int]) -> _Played:
    """Play the run in its process and write its trace `fcd`. A signal, added to `caught`, ends it after a decision.

    Raises SumoError where SUMO dies while it loads, and KeyboardInterrupt where a signal came before the start.
    """
    failures: list[SlrlError] = []
    with ExitStack() as stack:
        bar = stack.enter_context(progress_bar("{task.fields[factor]:.1f}x real time", quiet=quiet))
        views_at = VIEWS_AT if keep else frozenset[int]()
        events = stack.enter_context(
            closing(run_isolated(settings, views_at, with_surfaces=keep, traced=fcd is not None))
        )
        try:
            with interruptible_to_the_end():  # nothing is written yet
                started = next(events)
        except SumoError as error:
            raise SumoError(f"{error}; no output was written") from None
        assert isinstance(started, Started)
        begin = time.perf_counter()
        _log.info(
            "SUMO runs in steps of %g s from %g s on; selector %s; %s decisions; %d learned of %d road users",
            *(started.step_length, started.begin, started.selector, started.decisions or "any number of"),
            *(int(started.step.world.learned.sum()), len(started.step.world)),
        )
        task = bar.add_task(started.scenario, total=started.decisions, factor=0.0)
        _tell((*started.notices, *((started.compiling,) if started.compiling else ())), quiet)
        counters = RunCounters(started.step.world, started.surfaces.levels, parse_excluded(settings.exclude))
        recorder = RunRecorder(started) if keep else None
        end = started.step.time
        elevated = started.step.places.heights is not None
        writer = TraceWriter(fcd, elevated=elevated) if fcd is not None else None
        if writer is not None:
            stack.enter_context(writer)
        with _collected(failures), suppress(KeyboardInterrupt):
            if writer is not None:
                writer.write(started.step.time, started.step.world, started.step.places)
                writer.write_signals(started.step.time, started.signals)
            for event in _until_interrupted(events, caught):
                if isinstance(event, Decision):
                    if writer is not None:
                        for step in event.steps:
                            writer.write(step.time, step.world, step.places, event.modes)
                        writer.write_signals(event.steps[-1].time, event.signals)
                    counters.add(event)
                    end = event.steps[-1].time
                    if counters.decisions % LOG_EVERY == 0:
                        world = event.steps[-1].world
                        _log.info("%g s: %d learned of %d road users", end, int(world.learned.sum()), len(world))
                    elapsed = time.perf_counter() - begin
                    bar.update(task, advance=1, factor=counters.decisions * DECISION_INTERVAL / max(elapsed, 1e-9))
                if recorder is not None:
                    recorder.add(event)
        wall = time.perf_counter() - begin
        with _collected(failures):
            if writer is not None:
                writer.close()
    return _Played(started, counters, None if recorder is None else recorder.build(), end, wall, failures)


def _until_interrupted(events: Iterator[Event], caught: list[int]) -> Iterator[Event]:
    """The events up to a signal, which is added to `caught`. It does not wait for an event that is being computed, nor
    does it come while one is counted and written: what is finished is whole."""
    while not caught:
        try:
            with interruptible_to_the_end():
                event = next(events, None)
        except KeyboardInterrupt as interrupt:
            caught.append(interrupt.args[0])
            return
        if event is None:
            return
        yield event


def _notices(played: _Played) -> list[str]:
    """What there is to say at the end."""
    notices = []
    if played.started.decisions is None and played.counters.decisions == MOST_DECISIONS:
        notices.append(
            f"ended after {MOST_DECISIONS * DECISION_INTERVAL / 3600:g} h: the scenario has no end and still has road "
            "users; --until sets a later end"
        )
    return notices + played.counters.notices()


def _tell(notices: Sequence[str], quiet: bool) -> None:
    for notice in () if quiet else notices:
        with suppress(OSError):  # stderr may be closed: that is no reason to stop
            print(f"note: {notice}", file=sys.stderr)


@contextmanager
def _collected(failures: list[SlrlError]) -> Iterator[None]:
    """Errors are kept for the end: an output that cannot be written is no reason to lose the others."""
    try:
        yield
    except SlrlError as error:
        failures.append(error)
    except Exception as error:  # a defect here is none either
        failures.append(DefectError.of(error))


def _loaded(file: Path) -> Trajectories:
    recording = load_trajectories(file)
    if abs(recording.dt - DECISION_INTERVAL) > 1e-6:
        raise InputError(
            f"its interval is {recording.dt:g} s, not {DECISION_INTERVAL:g} s; "
            "make it with `slrl-sumo import` or `slrl-sumo record`",
            argument="recording",
            value=str(file),
        )
    return recording


def _peak_memory_mib() -> int:
    """Sum of the peak memory of this process and of the largest child process (with SUMO) that has ended."""
    return round(peak_memory_mib() + resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)
