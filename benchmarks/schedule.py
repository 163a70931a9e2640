"""The schedule of a cluster, simulated event by event with the measured costs of docs/measurements/scaling.md.

python benchmarks/schedule.py study    [--cores 16,256,4096] [--jobs-per-core 64] [--mean S] [--sd S] [--driver-ms MS]
python benchmarks/schedule.py training [--cores 16,256,4096] [--rollout S] [--sd S] [--update S] [--gbit 10]

study     independent simulations: a free core takes the next; one process hands out jobs and writes down results, one
          after the other; more jobs than cores are handed out, so that no core waits (ray_workers.QUEUED_SHARE)
training  PPO: weights to all machines, rollouts side by side, all of them back, one update; and so on
"""

import argparse
import heapq
from collections import deque

import numpy as np
from numpy.typing import NDArray

AHEAD = 0.125
FREE, DONE, RESULT = range(3)
"""What happens: a core is free; a core is done with a job; the driver is done with its result."""


def study(durations: NDArray[np.float64], cores: int, driver: float, start: float, ahead: float) -> tuple[float, float]:
    """Seconds until the last result is written down, and the share of the cores' time, from the first job on, in which
    they waited. `driver`: s for each result and the job that follows it; `start`: s until a core takes its first."""
    jobs = deque(durations.tolist())
    waiting: deque[float] = deque()  # handed out, on no core yet
    events = [(start, FREE, core) for core in range(cores)]
    heapq.heapify(events)
    for _ in range(min(len(jobs), cores + int(np.ceil(ahead * cores)))):
        waiting.append(jobs.popleft())
    idle: list[int] = []
    busy = last = driver_free = 0.0
    while events:
        clock, kind, core = heapq.heappop(events)
        if kind == RESULT:  # the driver has written one down, and hands out another job
            last = clock
            if jobs:
                waiting.append(jobs.popleft())
                if idle:
                    heapq.heappush(events, (clock, FREE, idle.pop()))
            continue
        if kind == DONE:
            driver_free = max(driver_free, clock) + driver
            heapq.heappush(events, (driver_free, RESULT, -1))
        if waiting:
            duration = waiting.popleft()
            busy += duration
            heapq.heappush(events, (clock + duration, DONE, core))
        else:
            idle.append(core)
    return last, 1.0 - busy / (cores * (last - start))


def training(
    rollouts: NDArray[np.float64],
    update_per_worker: float,
    weights: float,
    rollout_bytes: float,
    bytes_per_s: float,
    load_bytes_per_s: float,
    cores_per_machine: int,
) -> dict[str, float]:
    """Seconds of one iteration by what they go to; `rollouts` (iterations, workers) s of each."""
    workers = rollouts.shape[1]
    return {
        "broadcast": weights * np.ceil(workers / cores_per_machine) / bytes_per_s,
        "rollout": float(rollouts.mean()),
        "slowest": float(rollouts.max(1).mean() - rollouts.mean()),
        "receive": workers * rollout_bytes * (1 / bytes_per_s + 1 / load_bytes_per_s),
        "update": workers * update_per_worker,
    }


def drawn(mean: float, sd: float, shape: int | tuple[int, int]) -> NDArray[np.float64]:
    """Durations, gamma distributed, always the same; their mean is `mean` itself."""
    if not sd:
        return np.full(shape, mean)
    values = np.random.default_rng(1).gamma((mean / sd) ** 2, sd**2 / mean, shape)
    return np.asarray(values * (mean / values.mean()))


def main() -> None:
    """Print one line for each number of cores."""
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("study", "training"))
    parser.add_argument("--cores", default="16,256,4096")
    parser.add_argument("--jobs", type=int, help="in all, instead of --jobs-per-core")
    parser.add_argument("--jobs-per-core", type=int, default=64)
    parser.add_argument("--mean", type=float, default=2.0)
    parser.add_argument("--sd", type=float, default=0.3)
    parser.add_argument("--driver-ms", type=float, default=1.0)
    parser.add_argument("--start", type=float, default=5.0)
    parser.add_argument("--ahead", type=float, default=AHEAD)
    parser.add_argument("--rollout", type=float, default=2.5)
    parser.add_argument("--update", type=float, default=1.0)
    parser.add_argument("--weights-mb", type=float, default=0.6)
    parser.add_argument("--rollout-mb", type=float, default=12.0)
    parser.add_argument("--gbit", type=float, default=10.0)
    parser.add_argument("--load-gb-per-s", type=float, default=1.0)
    parser.add_argument("--agent-steps", type=int, default=64 * 64, help="of a rollout")
    given = parser.parse_args()
    for cores in map(int, given.cores.split(",")):
        if given.what == "study":
            jobs = given.jobs or cores * given.jobs_per_core
            seconds, waiting = study(
                drawn(given.mean, given.sd, jobs), cores, given.driver_ms / 1e3, given.start, given.ahead
            )
            print(f"{cores} cores, {jobs} jobs: {seconds:.1f} s, {jobs / seconds:.2f} jobs/s, waiting {waiting:.1%}")
        else:
            parts = training(
                drawn(given.rollout, given.sd, (64, cores)),
                given.update,
                given.weights_mb * 1e6,
                given.rollout_mb * 1e6,
                given.gbit * 1e9 / 8,
                given.load_gb_per_s * 1e9,
                16,
            )
            total = sum(parts.values())
            shares = ", ".join(f"{name} {value:.2f} s" for name, value in parts.items())
            rate = cores * given.agent_steps / total
            print(f"{cores} cores: {rate:.0f} agent-steps/s, rollouts {parts['rollout'] / total:.0%} ({shares})")


if __name__ == "__main__":
    main()
