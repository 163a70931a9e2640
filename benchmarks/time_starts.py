"""Time of starts of several checkouts by turns:

    python benchmarks/time_starts.py ROUNDS CHECKOUT... [-- WORDS]

WORDS are those of `slrl-sumo run` (default: intersection --agents 16 --steps 1). Prints for each checkout the median
and the range of processor time (of all its processes) and of wall time, s. With FIRST=1 in the environment each run has
an empty NUMBA_CACHE_DIR, so that it compiles what slrl_sumo/machine_code lacks: everything with NUMBA_CPU_NAME=generic.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

WORDS = ["intersection", "--agents", "16", "--steps", "1"]


def main() -> None:
    """Run the checkouts by turns, print a line for each."""
    given = sys.argv[2:]
    split = given.index("--") if "--" in given else len(given)
    checkouts, words = given[:split], given[split + 1 :] or WORDS
    taken: dict[str, list[tuple[float, float]]] = {checkout: [] for checkout in checkouts}
    first = os.environ.get("FIRST") == "1"
    for _ in range(int(sys.argv[1]) + (not first)):
        for checkout in checkouts:
            taken[checkout].append(_started(checkout, words, first=first))
    for checkout, times in taken.items():
        # Without FIRST, the first run of each checkout may compile.
        cpu, wall = (sorted(column) for column in zip(*(times if first else times[1:]), strict=True))
        print(
            f"{checkout}: {statistics.median(cpu):.2f} s of processor time ({cpu[0]:.2f} to {cpu[-1]:.2f}), "
            f"{statistics.median(wall):.2f} s ({wall[0]:.2f} to {wall[-1]:.2f})"
        )


def _started(checkout: str, words: list[str], *, first: bool) -> tuple[float, float]:
    """Processor and wall time of a run, s."""
    module = "slrl_sumo" if (Path(checkout) / "slrl_sumo" / "__main__.py").exists() else "slrl_sumo.cli"
    command = [sys.executable, "-m", module, "run", *words, "--quiet"]
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "PYTHONPATH": str(Path(checkout).resolve())}
        environment |= {"NUMBA_CACHE_DIR": folder} if first else {}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # else Python compiles the modules in each start, for 0.3 s
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
        subprocess.run(command, env=environment, cwd=folder, check=True)
        wall, after = perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, wall


if __name__ == "__main__":
    main()
