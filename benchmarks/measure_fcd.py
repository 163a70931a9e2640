"""Rows a second that FCD files are written and read with, and the memory that this takes.

    python benchmarks/measure_fcd.py [--steps 1000] [--users 500] [--repeat 3]

Each measurement is a process of its own: `users` road users in `steps` time steps, a third of them persons. Prints a
Markdown table: medians of rows a second of wall time and of processor time, and how far the peak of memory rose while
writing or reading. docs/measurements/performance.md holds the last results.
"""

import argparse
import multiprocessing
import resource
import statistics
import tempfile
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from slrl_sumo.formats.fcd.columns import SUFFIXES, Places
from slrl_sumo.formats.fcd.read import read_fcd
from slrl_sumo.formats.fcd.write import open_fcd
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType


def write(file: str, steps: int, users: int) -> None:
    """A trace of road users that drive round."""
    rng = np.random.default_rng(1)
    kind = np.sort(rng.integers(0, 3, users)).astype(np.int8)
    person = kind == RoadUserType.PEDESTRIAN
    none = np.zeros(users)
    places = Places(tuple(f"type_{k}" for k in kind), ("edge_0",) * users, none, person)
    ids = tuple(f"road_user.{number}" for number in range(users))
    x, y, heading = rng.uniform(0.0, 1000.0, (3, users))
    with open_fcd(file) as writer:
        for step in range(steps):
            heading = np.mod(heading, 2.0 * np.pi) - np.pi
            world = WorldState(
                time=step * DECISION_INTERVAL,
                ids=ids,
                type=kind,
                x=x,
                y=y,
                heading=heading,
                speed=none + 5.0,
                acceleration=none,
                yaw_rate=none,
                length=none + 4.0,
                width=none + 1.8,
                learned=none == 0.0,
            )
            writer.write(world.time, world, places)
            x, y, heading = x + 2.0 * np.cos(heading), y + 2.0 * np.sin(heading), heading + np.pi + 0.1


def measured(what: str, file: str, steps: int, users: int) -> tuple[float, float, float]:
    """Seconds of wall and processor time, and MiB by which the peak of memory rose, of one process."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin, begin_cpu = perf_counter(), process_time()
    write(file, steps, users) if what == "write" else read_fcd(file)
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return perf_counter() - begin, process_time() - begin_cpu, (after - before) / 1024


def main() -> None:
    """Write, read, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--users", type=int, default=500)
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    print("| format | | rows/s | rows/s of processor time | peak memory (MiB more) |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for suffix in SUFFIXES:
            for what in ("write", "read"):
                runs = []
                for _ in range(arguments.repeat):
                    with multiprocessing.get_context("spawn").Pool(1) as pool:
                        file = str(Path(folder) / f"fcd{suffix}")
                        runs.append(pool.apply(measured, (what, file, arguments.steps, arguments.users)))
                wall, cpu, memory = (statistics.median(column) for column in zip(*runs, strict=True))
                rows = arguments.steps * arguments.users
                print(f"| {suffix} | {what} | {rows / wall:,.0f} | {rows / cpu:,.0f} | {memory:.0f} |", flush=True)


if __name__ == "__main__":
    main()
