"""Figures for the cost model of docs/measurements/scaling.md.

    setsid -w python -m benchmarks.measure_scaling episodes|jobs|rollouts [ROUNDS [STEPS]]

episodes   64 episodes with 1 and 2 local workers and 2 cores of a local Ray, interleaved, so that other load meets all
jobs       jobs that do nothing: what each costs the process that hands them out
rollouts   PPO's rollouts by 2 local workers and 2 actors of a local Ray: seconds and bytes

Start it with `setsid -w`: CPU time is that of all processes of the session. Where others use the machine it says more
than the clock, because Linux gives each session, not each process, its share.
"""

import json
import os
import pickle
import resource
import statistics
import sys
import time
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save

from slrl_sumo.jobs.pool import Backend, run_jobs
from slrl_sumo.learning.environments.source import ArenaSource
from slrl_sumo.learning.rl.actor import Agent
from slrl_sumo.learning.rl.batch import Batch
from slrl_sumo.learning.rl.ppo import update
from slrl_sumo.learning.rl.rollouts import WorkerRollouts
from slrl_sumo.learning.rl.training_settings import TrainSettings
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.studies.episodes.episode import Episode, EpisodeSettings, run_episode

SETTINGS = EpisodeSettings("intersection", "intersection", 64)
AGENTS, EPISODES = 32, 64
BACKENDS = {"1 local": Backend(1), "2 local": Backend(2), "2 on Ray": Backend(2, "local")}


def timed(settings: EpisodeSettings, episode: Episode) -> tuple[float, float, float]:
    """When an episode began and ended, and the CPU time it took."""
    begin, cpu = time.time(), time.process_time()
    run_episode(settings, episode)
    return begin, time.time(), time.process_time() - cpu


def cpu_s() -> float:
    """CPU time of all processes of this session that live, s."""
    ticks = 0
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):  # it has ended meanwhile
            values = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(values[3]) == os.getsid(0):
                ticks += int(values[11]) + int(values[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def nothing(job: int) -> int:
    """The job that does nothing."""
    return job


def episodes(rounds: int = 1, steps: int = 64) -> None:
    """Rates of 64 episodes, whole (with start and end of all processes) and between first begin and last end."""
    settings = replace(SETTINGS, steps=steps)
    found: dict[str, list[dict[str, float]]] = {name: [] for name in BACKENDS}
    for _ in range(rounds):
        for name, backend in BACKENDS.items():
            before = cpu_s()
            jobs = [Episode("greedy", AGENTS, 1, number) for number in range(EPISODES)]
            begin = time.time()
            with closing(run_jobs(partial(timed, settings), jobs, backend)) as results:
                records = [next(results).record for _ in jobs]
                cpu = cpu_s()
            whole = time.time() - begin
            spans = [record for record in records if record is not None]
            first, last = min(b for b, _, _ in spans), max(e for _, e, _ in spans)
            row = {
                "whole_s": whole,
                "busy_s": last - first,
                "start_s": first - begin,
                "end_s": begin + whole - last,
                "episode_s": statistics.mean(e - b for b, e, _ in spans),
                "episode_sd_s": statistics.stdev(e - b for b, e, _ in spans),
                "cpu_s": statistics.mean(c for _, _, c in spans),
                "all_cpu_s": (cpu - before) / EPISODES,
                "waiting": 1 - sum(e - b for b, e, _ in spans) / ((last - first) * (backend.workers or 1)),
                "load": os.getloadavg()[0],
            }
            found[name].append(row)
            print(name, json.dumps({key: round(value, 3) for key, value in row.items()}), flush=True)
    rates = {name: statistics.median(EPISODES / row["whole_s"] for row in rows) for name, rows in found.items()}
    print({name: round(rate, 3) for name, rate in rates.items()}, "episodes/s, medians")
    print(f"2 local / 1 local: {rates['2 local'] / rates['1 local']:.2f}")
    print(f"2 on Ray / 2 local: {rates['2 on Ray'] / rates['2 local']:.3f}")


def jobs(rounds: int = 1) -> None:
    """CPU time of this process for each job."""
    for name, backend in BACKENDS.items():
        with closing(run_jobs(nothing, range(200 + 2000 * rounds), backend)) as results:
            for _ in range(200):
                next(results)
            begin, cpu = time.perf_counter(), time.process_time()
            for _ in range(2000 * rounds):
                next(results)
            cpu, wall = time.process_time() - cpu, time.perf_counter() - begin
        print(f"{name}: {2000 * rounds / wall:.0f} jobs/s, {1e3 * cpu / 2000 / rounds:.3f} ms of this process per job")


def rollouts(rounds: int = 1) -> None:
    """Seconds and bytes of rollouts and updates with the usual settings, 64 road users in each of 2 simulations."""
    settings, bundle = TrainSettings(), load_bundle("intersection")
    torch.set_num_threads(1)
    torch.manual_seed(1)
    agent = Agent(Policy(settings.policy), bundle.prior, 0.03, 5e-4, torch.device("cpu"))
    arena = replace(settings.arena, weights=settings.reward, teacher=settings.teacher)
    source = ArenaSource(("intersection",), "intersection", arena)
    print(f"weights: {len(save(agent.policy.state_dict()))} bytes")
    for _ in range(rounds):
        for name, backend in BACKENDS.items():
            begin = time.perf_counter()
            env = WorkerRollouts(source, settings.policy, settings.ppo.explore, backend)
            try:
                env.reset(1)
                times: list[float] = []
                batch = None
                for number in range(3):
                    batch, _ = _timed(times, env, agent, settings.ppo.num_steps, number)
                    if number == 0:
                        started, cpu = time.perf_counter() - begin, cpu_s()
                cpu = (cpu_s() - cpu) / 2 / (backend.workers or 1)
            finally:
                env.close()
            assert batch is not None
            begin = time.process_time()
            update(agent, batch, settings.ppo, torch.Generator().manual_seed(1), kl_coef=0.5)
            updated = time.process_time() - begin
            size = len(pickle.dumps(batch)) / (backend.workers or 1)
            clocks = ", ".join(f"{seconds:.2f}" for seconds in times[1:])
            print(f"{name}: first {started:.1f} s, then rollouts {clocks} s, {cpu:.2f} s of CPU each,")
            print(f"  update {updated:.2f} s of CPU, {size / 1e6:.2f} MB, load {os.getloadavg()[0]:.1f}", flush=True)
    begin = time.perf_counter()
    data = pickle.dumps(batch)
    pickle.loads(data)
    print(f"pickled and back: {1e3 * (time.perf_counter() - begin):.0f} ms for {len(data) / 1e6:.1f} MB")


def _timed(times: list[float], env: WorkerRollouts, agent: Agent, steps: int, seed: int) -> tuple[Batch, Any]:
    begin = time.perf_counter()
    result = env.collect(agent, steps, seed)
    times.append(time.perf_counter() - begin)
    return result


def main() -> None:
    """Measure what the first word names, so often as the second says."""
    what = {"episodes": episodes, "jobs": jobs, "rollouts": rollouts}
    what[sys.argv[1]](*map(int, sys.argv[2:]))
    print(f"peak memory of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    # Worker processes find jobs by the name of their module, and they have another __main__.
    from benchmarks import measure_scaling

    measure_scaling.main()
