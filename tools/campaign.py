"""Campaign: random runs of `slrl-sumo` in odd networks with odd demand, each command in a process of its own.

    python -m tools.campaign --agent-steps 1000000 --runs 200 --seed 1 --json campaign.json
    python -m tools.campaign --seed 1 --only 17 --keep kept     # one run again

Run NUMBER of a seed is always the same: a scenario (two thirds random networks of netgenerate, see `odd_networks` and
`odd_demand`; the others shipped, of the SUMO wheel, or of `netgen`), `slrl-sumo run` with random options, and in half
of the runs `doctor` or another command (`odd_runs`). Few runs have no length; in a scenario that plain SUMO does not
end either, they end after 300 s. An agent-step is one learned road user in one decision of 0.4 s.
Failures: tracebacks, SUMO's death where plain SUMO lives (exit 3), crashes, hangs, outputs that do not fit the run,
road users that are lost. Refused input is no failure, but is listed with its line. Folders of failures are kept. The
file of --json is written after every run, and a campaign that finds one of the same seed continues it. Exit code 1 if
there was any failure.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

import sumo

from slrl_sumo.netgen.families import generate
from slrl_sumo.sumo.scenario import Scenario, find_scenario, shipped_scenarios
from tools.odd_demand import draw_demand
from tools.odd_networks import draw_network
from tools.odd_runs import FAILURES, draw_others, draw_run, execute

GAMES = ("cross", "fkk_in", "square", "A10KW", "ramp", "corridor", "grid6", "rail", "DRT", "hiking")
"""Scenarios of the SUMO wheel."""
FAMILIES = ("intersection", "roundabout", "shared-space", "random")


def draw_scenario(random: Random, folder: Path) -> tuple[Scenario, list[str]]:
    """A scenario, made in `folder` where it is a new one, and what it is."""
    kind = random.choice(("odd", "odd", "odd", "odd", "made", "ready"))
    if kind == "odd":
        odd = draw_network(random, folder / "odd.net.xml")
        return find_scenario(str(draw_demand(random, folder / "odd.net.xml"))), odd
    if kind == "made":
        family, seed = random.choice(FAMILIES), random.randrange(10**6)
        return find_scenario(str(generate(family, seed, folder / "made"))), [f"{family} {seed}"]
    name = random.choice((*shipped_scenarios(), *GAMES))
    if name in shipped_scenarios():
        return find_scenario(name), [name]
    games = Path(sumo.SUMO_HOME) / "tools" / "game"
    nested = games / name / f"{name}.sumocfg"
    return find_scenario(str(nested if nested.exists() else games / f"{name}.sumocfg")), [name]


def one(seed: int, number: int, keep: Path) -> dict[str, Any]:
    """Run `number` of a campaign; its folder stays in `keep` where a command fails."""
    random = Random(f"campaign-{seed}-{number}")
    folder = Path(tempfile.mkdtemp(prefix="campaign_"))
    kept = keep / f"{seed}-{number}"
    try:
        scenario, odd = draw_scenario(random, folder)
        out = folder / "out"
        out.mkdir()
        commands = [*draw_others(random, scenario, out), draw_run(random, scenario, out)]
        verdicts = [execute(words, scenario) for words in commands]
        if any(verdict.failed for verdict in verdicts):
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(folder, kept)
            for verdict in verdicts:
                verdict.words = [word.replace(str(folder), str(kept)) for word in verdict.words]
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    rows = [{**asdict(verdict), "command": verdict.command, "failed": verdict.failed} for verdict in verdicts]
    return {"number": number, "scenario": odd, "commands": rows}


def agent_steps(runs: list[dict[str, Any]]) -> int:
    """Of all runs."""
    return sum(row["figures"].get("agent_steps", 0) for run in runs for row in run["commands"])


def campaign(options: argparse.Namespace, runs: list[dict[str, Any]]) -> None:
    """Add runs to `runs` until they and their agent-steps are as many as wanted."""
    done = {run["number"] for run in runs}
    numbers = (number for number in count() if number not in done)
    with ThreadPoolExecutor(options.jobs) as pool:
        waiting: set[Future[dict[str, Any]]] = set()
        try:
            while True:
                missing = len(runs) < options.runs or agent_steps(runs) < options.agent_steps
                while missing and len(waiting) < options.jobs:
                    waiting.add(pool.submit(one, options.seed, next(numbers), options.keep))
                if not waiting:
                    return
                finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in finished:
                    runs.append(future.result())
                    report(runs)
                    if options.json:
                        options.json.write_text(json.dumps(record(options, runs), indent=1) + "\n")
        finally:
            for future in waiting:
                future.cancel()


def record(options: argparse.Namespace, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The content of the JSON file."""
    return {"seed": options.seed, "counts": counts(runs), "runs": sorted(runs, key=lambda run: run["number"])}


def counts(runs: list[dict[str, Any]]) -> dict[str, int]:
    """Sums over all runs."""
    rows = [row for run in runs for row in run["commands"]]
    outcomes = Counter(row["outcome"] for row in rows)
    total: Counter[str] = Counter()
    for row in rows:
        total.update(row["figures"])
    names = ("ok", "refused", "SUMO refuses", *FAILURES)
    calls = {"refused calls": total.pop("refused", 0)}
    return {
        "runs": len(runs),
        "commands": len(rows),
        **dict(total),
        **calls,
        **{name: outcomes[name] for name in names},
    }


def report(runs: list[dict[str, Any]]) -> None:
    """Print the last of `runs`: a line, and more where there is trouble."""
    run = runs[-1]
    outcomes = ", ".join(f"{row['words'][0]} {row['outcome']} {row['wall_s']:.0f} s" for row in run["commands"])
    print(
        f"{time.strftime('%H:%M:%S')} {len(runs):4d} {agent_steps(runs):8d}  #{run['number']}: {outcomes}", flush=True
    )
    for row in run["commands"]:
        if row["outcome"] != "ok":
            print(f"      {row['outcome']}: {row['detail']}")
        if row["failed"]:
            print(f"      in {' | '.join(run['scenario'])}\n      repeat it with: {row['command']}", flush=True)


def refusals(runs: list[dict[str, Any]]) -> Iterator[str]:
    """Each different refusal of a run that `doctor` passed, with its number."""
    for run in runs:
        passed = any(row["words"][0] == "doctor" and row["outcome"] == "ok" for row in run["commands"])
        for row in run["commands"]:
            if passed and row["outcome"] == "refused":
                yield f"#{run['number']} {row['words'][0]}: {row['detail']}"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--agent-steps", type=int, default=1_000_000, help="at least, in all")
    parser.add_argument("--runs", type=int, default=200, help="at least")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="runs at the same time")
    parser.add_argument("--json", type=Path, help="counts and all runs; continued where it exists")
    parser.add_argument("--keep", type=Path, default=Path("campaign-failures"), help="folder for failed runs")
    parser.add_argument("--only", type=int, help="just the run of this number")
    options = parser.parse_args()
    runs: list[dict[str, Any]] = []
    if options.only is not None:
        runs.append(one(options.seed, options.only, options.keep))
        report(runs)
    else:
        if options.json and options.json.exists():
            before = json.loads(options.json.read_text())
            if before["seed"] != options.seed:
                sys.exit(f"{options.json} is of seed {before['seed']}: give --seed {before['seed']}, or another file")
            runs = before["runs"]
        try:
            campaign(options, runs)
        except KeyboardInterrupt:
            print("interrupted: what was measured so far:")
    for line in refusals(runs):
        print(f"refused though doctor passes: {line}")
    found = counts(runs)
    print(", ".join(f"{name} {number}" for name, number in found.items()))
    if any(found[name] for name in FAILURES):
        sys.exit(1)


if __name__ == "__main__":
    main()
