"""Time of decisions of two checkouts that alternate decision by decision, for machines with a varying load:

    python benchmarks/alternate_decisions.py CHECKOUT OTHER SCENARIO AGENTS STEPS [MIX [SELECTOR]]

AGENTS: a number, or shares of the scenario's own road users that are taken over, such as car=1,bicycle=1,pedestrian=1.
Both hold the same run; while one decides the other waits. Prints the processor time of a decision of each (median, ms),
and the median and the quartiles of the ratios of single decisions, CHECKOUT to OTHER. Needs nothing of the package that
old checkouts do not have. Ratios mean something where both take the same decisions, see compare_decisions.py.
"""

import os
import statistics
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import sys
from time import process_time
from slrl_sumo.simulation.run import run
try:
    from slrl_sumo.simulation.settings import RunSettings
except ImportError:  # checkouts until 2026-11-21
    from slrl_sumo.simulation.events import RunSettings
scenario, mix, selector = sys.argv[1], *(word or None for word in sys.argv[4:6])
learned = {"takeover": sys.argv[2]} if "=" in sys.argv[2] else {"agents": int(sys.argv[2])}
events = run(RunSettings(scenario=scenario, steps=int(sys.argv[3]), mix=mix, selector=selector, **learned))
next(events)
for _ in sys.stdin:
    begin = process_time()
    next(events)
    print(process_time() - begin, flush=True)
"""
WARM_UP = 10
MEMORY = "glibc.malloc.mmap_threshold=33554432:glibc.malloc.trim_threshold=268435456"
"""As jobs.process sets them in runs: else arrays are returned and zeroed in each decision."""


def main() -> None:
    """Let both decide by turns, print three lines."""
    checkouts, (scenario, agents, steps, *rest) = sys.argv[1:3], sys.argv[3:]
    words = [scenario, agents, str(WARM_UP + int(steps)), *rest, *[""] * (2 - len(rest))]
    both = [_started(checkout, words) for checkout in checkouts]
    taken = [[_decide(process) for process in both] for _ in range(WARM_UP + int(steps))][WARM_UP:]
    for process in both:
        process.communicate()
    for checkout, times in zip(checkouts, zip(*taken, strict=True), strict=True):
        print(f"{checkout}: {1e3 * statistics.median(times):.2f} ms")
    low, median, high = statistics.quantiles([one / other for one, other in taken], n=4)
    print(f"{median:.3f} ({low:.3f} to {high:.3f})")


def _started(checkout: str, words: list[str]) -> subprocess.Popen[str]:
    """A run that decides once for each line that it reads."""
    return subprocess.Popen(
        # -P: else both import the package of the folder in which this is run.
        [sys.executable, "-P", "-c", PROGRAM, *words],
        env={**os.environ, "PYTHONPATH": str(Path(checkout).resolve()), "GLIBC_TUNABLES": MEMORY},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def _decide(process: "subprocess.Popen[str]") -> float:
    """Processor time of the next decision, s."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write("\n")
    process.stdin.flush()
    return float(process.stdout.readline())


if __name__ == "__main__":
    main()
