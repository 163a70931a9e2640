"""Memory of a study against the number of finished simulations, with simulations that take no time.

    python benchmarks/measure_study_memory.py [COUNT] [FOLDER]

evaluates COUNT episodes (default 1,000,000) with made-up outcomes; worker processes, episodes.jsonl and tables are
those of `slrl-sumo evaluate`. The same command continues an interrupted study.
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from slrl_sumo.jobs import pool
from slrl_sumo.metrics.outcomes import TypeOutcome
from slrl_sumo.studies.episodes import evaluate as scenario_evaluation
from slrl_sumo.studies.episodes.episode import Episode, EpisodeSettings
from slrl_sumo.studies.episodes.evaluate import EvaluationSettings, evaluate_scenario

EVERY = 50_000


def made_up(settings: EpisodeSettings, episode: Episode) -> tuple[TypeOutcome, ...]:
    """An outcome as large as that of a real episode with 32 road users, drawn by the episode."""
    random = np.random.default_rng((episode.seed, episode.number))
    parts = []
    for kind, count in (("car", 16), ("bicycle", 6), ("pedestrian", 10)):
        present = (settings.steps,) * count
        survived = tuple(random.integers(0, settings.steps + 1, count).tolist())
        speed = float(random.lognormal(2.0, 0.5)) * settings.steps * count
        hits = int(random.integers(0, 5))
        parts.append(TypeOutcome(kind, present, survived, count - hits, speed, speed, *[hits] * 5))
    return tuple(parts)


def main() -> None:
    """Print a line for every EVERY finished episodes."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(tempfile.mkdtemp(prefix="million_"))
    scenario_evaluation.run_episode = made_up  # type: ignore[attr-defined]
    pool.MAX_REQUESTS = 10**9  # type: ignore[attr-defined]  # nothing leaks here, and new processes would take most of the time
    settings = EvaluationSettings(
        "intersection", "intersection", selectors=("prior",), episodes=64, seeds=-(-count // 64), steps=128
    )
    begin, last = time.perf_counter(), 0

    def progress(done: int, total: int, rate: float) -> None:
        nonlocal last
        if done >= last + EVERY or done == total:
            last = done
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            memory = pages * resource.getpagesize() / 2**20
            size = (folder / "episodes.jsonl").stat().st_size / 2**20
            print(
                f"{done:9,} of {total:,}: {memory:.0f} MiB here, {size:.0f} MiB on disk, {rate:.0f} episodes/s, "
                f"{time.perf_counter() - begin:.0f} s",
                flush=True,
            )

    (row, *_) = evaluate_scenario(settings, folder, progress=progress)["rows"]
    print(row)


if __name__ == "__main__":
    main()
