"""Gives mutated files of every kind to the commands that read them, and judges what the commands do.

    python -m tools.malformed --inputs 300 --seed 1 --json malformed.json

Each input is a valid file with one mutation, in a folder of its own, read by `slrl-sumo` as a process. It must exit
with 0 (the mutation is harmless) or 1, then with one line on stderr that names a file, without a traceback, in under
10 s of processor time (300 s of wall time, which on a busy machine is longer) and 1 GiB. The exit code is 1 where any
input fails. The file of --json is written after every input, and one of the same seed is continued. `--only TEXT`
keeps the samples and mutations whose names hold the text.
"""

import argparse
import json
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

from tools.malformed.judge import Outcome, run
from tools.malformed.mutations import BY_KIND, COMMON, Mutation
from tools.malformed.samples import Sample, make_samples, make_studies


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m tools.malformed", description=__doc__.splitlines()[0])
    parser.add_argument("--inputs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="commands at the same time")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--only", default="", help="part of the name of a sample or mutation")
    options = parser.parse_args()
    results: list[dict[str, Any]] = []
    if options.json is not None and options.json.exists():
        before = json.loads(options.json.read_text())
        if before["seed"] != options.seed:
            sys.exit(f"{options.json} is of seed {before['seed']}: give --seed {before['seed']}, or another file")
        results = before["inputs"]
    done = {result["number"] for result in results}
    with tempfile.TemporaryDirectory(prefix="malformed_") as folder:
        for result in campaign(Path(folder), options.inputs, options.seed, options.jobs, options.only, done=done):
            results.append(result)
            if options.json is not None:
                record = {"seed": options.seed, "summary": summarise(results), "inputs": results}
                options.json.write_text(json.dumps(record, indent=1) + "\n")
    summary = summarise(results)
    print(json.dumps(summary, indent=1))
    sys.exit(1 if summary["failed"] else 0)


def campaign(
    base: Path,
    inputs: int,
    seed: int,
    jobs: int,
    only: str = "",
    studies: bool = True,
    done: Collection[int] = (),
) -> Iterator[dict[str, Any]]:
    """Judge `inputs` mutated files, without the numbers `done`; the same seed gives the same ones."""
    samples = make_samples(base)
    if studies and (not only or not any(only in sample.name for sample in samples)):
        samples += make_studies(base, run)
    plan = [case for case in plan_inputs(samples, inputs, seed, only) if case[0] not in done]
    with ThreadPoolExecutor(jobs) as pool:
        for result in pool.map(lambda case: judge(base / f"case{case[0]}", *case), plan):
            mark = "FAILED: " + ", ".join(result["faults"]) if result["faults"] else f"exit {result['code']}"
            print(
                f"{result['number']:4} {result['sample']:34} {result['mutation']:15} {result['cpu_s']:5.1f} s "
                f"{result['peak_mib']:5.0f} MiB  {mark}",
                flush=True,
            )
            yield result


def plan_inputs(
    samples: list[Sample], inputs: int, seed: int, only: str = ""
) -> list[tuple[int, Sample, Mutation, int]]:
    """Numbers, samples, mutations and seeds: every sample has a turn in each round, mutations are in random order."""
    random = Random(seed)
    decks: dict[str, list[Mutation]] = {}
    plan: list[tuple[int, Sample, Mutation, int]] = []
    kept = [(s, m) for s in samples for m in (*COMMON, *BY_KIND[s.kind]) if only in s.name or only in m.__name__]
    if not kept:
        return []
    for _ in count():
        for sample in samples:
            deck = decks.setdefault(sample.name, [])
            if not deck:
                deck += [m for s, m in kept if s == sample]
                random.shuffle(deck)
            if deck:
                plan.append((len(plan), sample, deck.pop(), random.randrange(2**31)))
            if len(plan) == inputs:
                return plan
    return plan


def judge(folder: Path, number: int, sample: Sample, mutation: Mutation, seed: int) -> dict[str, Any]:
    """Mutate a copy of the sample and run its command."""
    shutil.copytree(sample.folder, folder, symlinks=True)
    names = {path.name for path in folder.rglob("*")}
    what = mutation(folder / sample.target, Random(seed))
    outcome = run(sample.command, folder)
    faults = outcome.faults(names)
    shutil.rmtree(folder, ignore_errors=True)
    return _record(number, sample, mutation, what, outcome, faults)


def _record(
    number: int, sample: Sample, mutation: Mutation, what: str, outcome: Outcome, faults: list[str]
) -> dict[str, Any]:
    return {
        "number": number,
        "sample": sample.name,
        "mutation": mutation.__name__,
        "what": what,
        "command": " ".join(sample.command),
        "code": outcome.code,
        "wall_s": round(outcome.wall_s, 2),
        "cpu_s": round(outcome.cpu_s, 2),
        "peak_mib": round(outcome.peak_mib),
        "message": outcome.message[-2000:],
        "faults": faults,
    }


def summarise(results: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts and the highest measures."""
    return {
        "inputs": len(results),
        "failed": sum(bool(result["faults"]) for result in results),
        "tracebacks": sum("traceback" in result["faults"] or result["code"] == 4 for result in results),
        "codes": dict(sorted(Counter(str(result["code"]) for result in results).items())),
        "most_wall_s": max((result["wall_s"] for result in results), default=0.0),
        "most_cpu_s": max((result["cpu_s"] for result in results), default=0.0),
        "most_mib": max((result["peak_mib"] for result in results), default=0),
        "samples": len({result["sample"] for result in results}),
        "mutations": dict(sorted(Counter(result["mutation"] for result in results).items())),
    }


if __name__ == "__main__":
    main()
