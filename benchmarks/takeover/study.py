"""Takeover runs of learned road users against SUMO's own models, on the same demand.

    python -m benchmarks.takeover.study --scenarios signalised cross --selectors sumo,lane,greedy --seeds 1 2 3 \
        --log study.jsonl --markdown --pictures pictures
    python -m benchmarks.takeover.study --log study.jsonl --markdown --scenarios signalised        # only its tables

All eligible road users are taken over, everywhere or in --region, until --seconds; then all are handed back, and the
run continues for --tail s to follow them. In `sumo`, no road user is taken over; road users that match the takeover are
followed. Runs that are already in --log are not repeated, except failed runs.

Definitions:

- Left on their own route: arrived at their own destination, or, with a region, handed back outside it with their
original   route or destination, before --seconds. The share refers to road users that have left by then, in any way,
and road   users that were taken over at least 120 s before --seconds. A road user that SUMO had to put back onto its
route has not   left on its own route, even if it left the network at its own destination (counted separately, within 30
m of it). Nor   has a road user that was still learned at --seconds: `unfinished`; of these, `arrived later` arrived in
the tail, driven   by SUMO. The run should last longer than a trip.
- Time in the region: of road users that left on their own route, from the takeover to leaving or arriving; the ratio to
  `sumo` is over road users that left in both runs.
- Signals: slrl_sumo/metrics/traffic/signal_crossings.py. Overlaps: slrl_sumo/metrics/driving_stats.py, every 0.4 s.
- Off surface, speeds, braking (below -4.5 m/s²): of all steps (0.4 s) of road users while learned, or followed.
- Cars on their lanes: lane_keeping.py; changes of side beyond 0.15 m. After the hand-back: hand_back.py.
- Agent-steps per s: learned road users times decisions over the wall time of the loop, SUMO's steps included.

The signals of the SUMO wheel's games wait for a player; they are switched every 30 s. Pictures: ten cars, first seed.
"""

import argparse
import sys
from contextlib import closing
from dataclasses import asdict
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from benchmarks.takeover.run import Case, run_case
from benchmarks.takeover.tables import TABLES, add_time_ratios, aligned, markdown, table
from slrl_sumo.agent.make_driver import SELECTORS
from slrl_sumo.jobs.pool import Backend, run_jobs
from slrl_sumo.studies.log import StudyLog

Row = dict[str, Any]


def cases_of(options: argparse.Namespace) -> list[Case]:
    """All requested runs, in the order of the tables."""
    cases = []
    for scenario, selector, seed in product(options.scenarios, options.selectors, options.seeds):
        # SUMO and the lane follower have neither models nor a guard: their runs serve for all bundles.
        modelled = selector not in ("sumo", "lane")
        usual = "shared-space" if scenario == "shared-space" else "intersection"
        bundle = options.bundle if modelled and options.bundle != "auto" else usual
        rest = options.seconds, options.tail, options.region, bundle, options.guard and modelled, options.step_length
        cases.append(Case(scenario, selector, seed, *rest))
    return cases


def case_of(row: Row) -> Case:
    """The case of a row of the log."""
    return Case(**{name: row[name] for name in Case.__dataclass_fields__})


def study(options: argparse.Namespace) -> list[Row]:
    """Make the missing runs, and return the rows of all requested runs."""
    log = StudyLog(options.log, {}, "runs")
    rows = {case_of(row): row for row in log.read(lambda row: row)}
    cases = cases_of(options)
    missing = [case for case in cases if "failed" in rows.get(case, {"failed": ""})]
    # Pictures are of the first seed alone.
    for seed in dict.fromkeys(case.seed for case in missing):
        work = partial(run_case, options.pictures if seed == options.seeds[0] else None)
        todo = [case for case in missing if case.seed == seed]
        with closing(run_jobs(work, todo, Backend(options.workers))) as results:
            for finished in results:
                record = {"failed": finished.reason} if finished.record is None else finished.record
                row = rows[finished.job] = asdict(finished.job) | record
                log.add(row)
                name = f"{row['scenario']} {row['selector']} seed {row['seed']}"
                print(f"{name}: {f'failed: {finished.reason}' if 'failed' in row else 'done'}", file=sys.stderr)
    return [rows[case] for case in cases]


def main() -> None:
    """Read the command line, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenarios", nargs="+", default=["intersection", "signalised", "district", "shared-space"])
    parser.add_argument("--bundle", default="auto", help="auto: shared-space in that scenario, else intersection")
    parser.add_argument("--selectors", nargs="+", default=["sumo,prior,greedy,lane"], help="with spaces or commas")
    parser.add_argument("--guard", action="store_true", help="with the lookahead guard")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--seconds", type=float, default=600.0, help="end of the takeover")
    parser.add_argument("--tail", type=float, default=300.0, help="s during which road users handed back are followed")
    parser.add_argument("--region", help="as for slrl-sumo run, or auto: the largest junction, radius 60")
    parser.add_argument("--step-length", type=float, help="SUMO step, s; default: the scenario's")
    parser.add_argument("--log", type=Path, required=True, help="file of the finished runs, which are not repeated")
    parser.add_argument("--markdown", action="store_true", help="tables as Markdown")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each scenario and selector")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    options.selectors = [name for group in options.selectors for name in group.split(",") if name]
    unknown = [selector for selector in options.selectors if selector not in ("sumo", *SELECTORS)]
    if unknown:
        parser.error(f"--selectors {unknown[0]}: unknown; use sumo, {', '.join(SELECTORS)}")
    rows = study(options)
    add_time_ratios(rows)
    for name in TABLES:
        lines = table(name, rows)
        print(f"\n### {name}\n\n{markdown(lines)}" if options.markdown else f"\n{name}\n{aligned(lines)}")


if __name__ == "__main__":
    main()
