"""Wall time, real-time factor and memory of `slrl-sumo run` with 16, 64 and 256 learned road users.

    python benchmarks/measure_runs.py [--repeat 3] [--steps 150]

Each run is a process of its own and writes an XML trace and a summary, as a user's run would. Prints a Markdown table
of medians; docs/measurements/archive/performance.md holds the last results.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SCENARIOS = ("intersection", "shared-space", "district")
AGENTS = (16, 64, 256)
MIX = "car=0.3,bicycle=0.3,pedestrian=0.4"
"""With the usual half of cars, 256 road users do not fit into the two small scenarios."""


def main() -> None:
    """Run, read the summaries, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=3, help="runs of each kind; the median counts")
    parser.add_argument("--steps", type=int, default=150, help="decisions per run")
    arguments = parser.parse_args()
    print("| scenario | agents | whole command (s) | loop (s) | real-time factor | agent-steps/s | peak memory (MiB) |")
    print("|---|---|---|---|---|---|---|")
    for scenario in SCENARIOS:
        for agents in AGENTS:
            runs = [run for run in (_run(scenario, agents, arguments.steps) for _ in range(arguments.repeat)) if run]
            if not runs:
                print(f"| {scenario} | {agents} | does not fit | | | | |")
                continue
            keys = ("command_s", "wall_s", "real_time_factor", "agent_steps_per_s", "peak_memory_mib")
            middle = {key: statistics.median(run[key] for run in runs) for key in keys}
            print(
                f"| {scenario} | {agents} | {middle['command_s']:.2f} | {middle['wall_s']:.2f} "
                f"| {middle['real_time_factor']:.0f} | {middle['agent_steps_per_s']:.0f} "
                f"| {middle['peak_memory_mib']} |",
                flush=True,
            )


def _run(scenario: str, agents: int, steps: int) -> dict[str, float] | None:
    with tempfile.TemporaryDirectory() as folder:
        summary = Path(folder) / "summary.json"
        command = [sys.executable, "-m", "slrl_sumo", "run", scenario, "--agents", str(agents), "--mix", MIX]
        command += ["--quiet", "--steps", str(steps), "--fcd", str(Path(folder) / "fcd.xml"), "--summary", str(summary)]
        begin = time.perf_counter()
        if subprocess.run(command, check=False).returncode:
            return None
        return {**json.loads(summary.read_text()), "command_s": time.perf_counter() - begin}


if __name__ == "__main__":
    main()
