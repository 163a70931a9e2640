"""Time of single decisions, to compare two checkouts by turns:

    PYTHONPATH=CHECKOUT python benchmarks/time_decisions.py SCENARIO AGENTS STEPS [MIX [SELECTOR]]

Prints wall and processor time of a decision without trace and summary, and agent-steps a second. `slrl-sumo bench` says
more about one checkout; this needs nothing of the package that old checkouts do not have.
"""

import statistics
import sys
from time import perf_counter, process_time

from slrl_sumo.simulation.run import run

try:
    from slrl_sumo.simulation.settings import RunSettings
except ImportError:  # checkouts until 2026-11-21
    from slrl_sumo.simulation.events import RunSettings  # type: ignore[attr-defined,no-redef]

WARM_UP = 10


def main() -> None:
    """Run in this process, print one line."""
    scenario, agents, steps = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    mix = sys.argv[4] if len(sys.argv) > 4 else None
    selector = sys.argv[5] if len(sys.argv) > 5 else None
    events = run(RunSettings(scenario=scenario, agents=agents, steps=WARM_UP + steps, mix=mix, selector=selector))
    for _ in range(1 + WARM_UP):
        next(events)
    times = []
    for _ in range(steps):
        begin, begin_cpu = perf_counter(), process_time()
        next(events)
        times.append((perf_counter() - begin, process_time() - begin_cpu))
    wall, cpu = (statistics.median(column) for column in zip(*times, strict=True))
    print(f"{scenario} {agents}: {1e3 * wall:.2f} ms, {1e3 * cpu:.2f} ms of processor time, {agents / wall:.0f}/s")


if __name__ == "__main__":
    main()
