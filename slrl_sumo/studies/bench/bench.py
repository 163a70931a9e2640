"""`slrl-sumo bench`: throughput on this machine, compared with plain SUMO and the bare library calls."""

import os
import platform
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from rich.table import Table

from slrl_sumo.errors import check_whole_number
from slrl_sumo.formats.output_files import write_json
from slrl_sumo.jobs.interrupt import interruptible
from slrl_sumo.jobs.progress import progress
from slrl_sumo.jobs.tables import print_table
from slrl_sumo.studies.bench.measurement_process import DoesNotFit, Workload, measured

if TYPE_CHECKING:
    from slrl_sumo.studies.bench.learned import LearnedCost

BENCH_MIX = "car=0.2,bicycle=0.2,pedestrian=0.6"
"""With 50 % cars, the default of `run`, 256 road users do not fit into the small scenarios, nor 1,024 into `district`;
with this mix all fit, and none starts bumper to bumper."""


@dataclass(frozen=True)
class BenchSettings:
    """Settings of the measurement, named as in `slrl-sumo bench`."""

    scenarios: tuple[str, ...] = ("intersection", "shared-space", "district")
    agents: tuple[int, ...] = (16, 64, 256, 1024)
    cores: tuple[int, ...] = ()
    """Numbers of simulations side by side; empty: one, and the number of cores of the machine."""
    threads: tuple[int, ...] = (1,)
    """Numbers of threads of each decision."""
    steps: int = 60
    """Decisions in each measurement, after the warm-up."""
    bundle: str = "intersection"
    selector: str | None = None
    mix: str = BENCH_MIX
    seed: int = 1


def workloads(settings: BenchSettings) -> list[Workload]:
    """The measurements, in order. Raises InputError if the settings are wrong."""
    for value in settings.agents:
        check_whole_number("agents", value, 1, 1_000_000)
    for value in settings.cores:
        check_whole_number("cores", value, 1, 1024)
    for value in settings.threads:
        check_whole_number("threads", value, 1, 1024)
    check_whole_number("steps", settings.steps, 1, 1_000_000)
    check_whole_number("seed", settings.seed, 0, 2**31 - 1)
    from slrl_sumo.simulation.shares import parse_mix
    from slrl_sumo.sumo.scenario import find_scenario

    parse_mix(settings.mix)
    for scenario in settings.scenarios:
        find_scenario(scenario)
    cores = settings.cores or tuple(sorted({1, len(os.sched_getaffinity(0))}))
    return [
        Workload(
            scenario=scenario,
            agents=agents,
            cores=count,
            mix=settings.mix,
            bundle=settings.bundle,
            selector=settings.selector,
            steps=settings.steps,
            seed=settings.seed,
            threads=threads,
        )
        for scenario in settings.scenarios
        for agents in settings.agents
        for count in cores
        for threads in settings.threads
    ]


def measure(works: list[Workload]) -> Iterator[dict[str, Any] | str]:
    """A row of JSON values for each of `works`, or the reason for leaving it out; each runs in processes of its own.

    Raises InputError if bundle, selector or scenario cannot be used, SumoError if SUMO fails.
    """
    from slrl_sumo.studies.bench.learned import measure_learned
    from slrl_sumo.studies.bench.plain import measure_plain

    for work in works:
        try:
            learned = measured(measure_learned, work)
        except DoesNotFit as error:
            yield f"{work.scenario} with {work.agents}: left out ({error})"
            continue
        yield _row(work, learned, measured(measure_plain, work))


def _row(work: Workload, learned: "list[LearnedCost]", updates_per_s: list[float]) -> dict[str, Any]:
    """One row; for simulations side by side, times are means, rates and memory are sums."""
    parts = _means([cost.parts_s for cost in learned])
    floor = _means([cost.floor_s for cost in learned])
    decision, bare = sum(parts.values()), sum(floor.values())
    plain = learned[0].substeps / fmean(updates_per_s)
    return {
        "scenario": work.scenario,
        "agents": work.agents,
        "cores": work.cores,
        "threads": work.threads,
        "selector": learned[0].selector,
        "agent_steps_per_s": round(work.cores * work.agents / decision, 1),
        "ms_per_decision": round(1e3 * decision, 4),
        "parts_ms": _milliseconds(parts),
        "floor_ms": round(1e3 * bare, 4),
        "floor_parts_ms": _milliseconds(floor),
        "times_floor": round(decision / bare, 3),
        "sumo_updates_per_s": round(sum(updates_per_s), 1),
        "times_sumo": round(decision / work.agents / plain, 3),
        "peak_memory_mib": round(sum(cost.peak_memory_mib for cost in learned), 1),
    }


def _means(seconds: list[dict[str, float]]) -> dict[str, float]:
    return {part: fmean(each[part] for each in seconds) for part in seconds[0]}


def write_bench(settings: BenchSettings, file: Path | None) -> int:
    """Measure with a progress bar, print the table and write `file`. Returns 0, or the number of
    the signal that interrupted it; finished rows are written and printed in any case."""
    works = workloads(settings)
    rows: list[dict[str, Any]] = []
    left_out: dict[str, None] = {}
    interrupted_by = 0
    try:
        with interruptible() as caught, progress() as bar:
            task = bar.add_task("", total=len(works))
            try:
                results = measure(works)
                for work in works:
                    bar.update(task, description=f"{work.scenario}, {work.agents} road users, {work.cores} cores")
                    result = next(results)
                    if isinstance(result, str):
                        left_out[result] = None
                    else:
                        rows.append(result)
                    bar.advance(task)
            except KeyboardInterrupt:
                interrupted_by = caught[0]
    finally:
        # Finished measurements are kept, also if SUMO dies.
        if file is not None and (rows or not sys.exc_info()[0]):
            write_json(file, {"rows": rows, "left_out": list(left_out), **_circumstances(settings)})
        if rows:
            print_rows(rows)
    for reason in left_out:
        print(f"note: {reason}", file=sys.stderr)
    return interrupted_by


def _milliseconds(seconds: dict[str, float]) -> dict[str, float]:
    return {part: round(1e3 * value, 4) for part, value in seconds.items()}


def _circumstances(settings: BenchSettings) -> dict[str, Any]:
    """Settings, machine and versions of the measurement."""
    return {
        "bundle": settings.bundle,
        "mix": settings.mix,
        "steps": settings.steps,
        "seed": settings.seed,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": platform.machine(),
        "cores_of_machine": len(os.sched_getaffinity(0)),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in ("slrl-sumo", "libsumo", "torch", "numpy")},
    }


def print_rows(rows: list[dict[str, Any]]) -> None:
    """Print the table on stdout; times in ms are per decision of all road users."""
    parts = list(rows[0]["parts_ms"])
    table = Table(
        title="ms per decision (0.4 s) of all learned road users of a simulation; n cores: n simulations at once",
        title_justify="left",
    )
    table.add_column("scenario", no_wrap=True)
    for heading in ("agents", "cores", "threads", "agent-steps/s", "ms", *parts, "floor", "x floor", "x SUMO", "MiB"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(
            row["scenario"],
            str(row["agents"]),
            str(row["cores"]),
            str(row["threads"]),
            f"{row['agent_steps_per_s']:.0f}",
            f"{row['ms_per_decision']:.2f}",
            *(f"{row['parts_ms'][part]:.2f}" for part in parts),
            f"{row['floor_ms']:.2f}",
            f"{row['times_floor']:.2f}",
            f"{row['times_sumo']:.1f}",
            f"{row['peak_memory_mib']:.0f}",
        )
    print_table(table, 160)
