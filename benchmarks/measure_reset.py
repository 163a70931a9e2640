"""What a reset costs: a new process, SUMO's load, its saved states, and a new start in the running simulation.

    python benchmarks/measure_reset.py [--repeat 5] [--agents 16]

Prints a Markdown table of medians in ms, and whether a loaded state goes on as the simulation that it was saved from;
docs/measurements/performance.md holds the last results.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch

from slrl_sumo.learning.environments.arena import Arena, ArenaSettings
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.perception.observation import observe
from slrl_sumo.perception.scene import Scene
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.scenario.options import with_options
from slrl_sumo.sumo.session import SumoSession

ROOT = Path(__file__).parent.parent
FULL_STATE = ("--save-state.rng", "--save-state.transportables", "--save-state.precision=12")
SCENARIOS = ("intersection", "shared-space")
WARM_UP = ArenaSettings().warm_up
FRESH = "from benchmarks.measure_reset import open_arena; open_arena({scenario!r}, {agents}, 0)"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5, help="times each is measured")
    parser.add_argument("--agents", type=int, default=16, help="learned road users")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    print("| scenario | what starts anew | ms (median) | ms (least to most) |")
    print("|---|---|---|---|")
    for scenario in SCENARIOS:
        for what, times in _times(scenario, arguments.agents, arguments.repeat).items():
            middle = statistics.median(times)
            print(f"| {scenario} | {what} | {middle:.1f} | {min(times):.1f} to {max(times):.1f} |", flush=True)
        print(f"\n{_what_states_are_worth(scenario)}\n", flush=True)


def open_arena(scenario: str, agents: int, seed: int) -> None:
    """Load, warm up, add the learned road users and look once; then close."""
    with Arena(find_scenario(scenario), load_bundle("intersection"), ArenaSettings(agents=agents), seed):
        pass


def _times(scenario: str, agents: int, repeat: int) -> dict[str, list[float]]:
    """ms of each way to start anew, `repeat` times."""
    bundle, found = load_bundle("intersection"), find_scenario(scenario)
    command = [sys.executable, "-c", FRESH.format(scenario=scenario, agents=agents)]
    times: dict[str, list[float]] = {}

    def measure(what: str, do: Callable[[], object]) -> None:
        begin = time.perf_counter()
        do()
        times.setdefault(what, []).append((time.perf_counter() - begin) * 1e3)

    for seed in range(repeat):
        measure("process: imports, models and an arena", partial(subprocess.run, command, cwd=ROOT, check=True))
        arena = Arena(found, bundle, ArenaSettings(agents=agents), seed)
        measure("arena: load, warm-up, learned road users, first look", arena.__enter__)
        arena.__exit__(None, None, None)
        session = SumoSession(found, seed=seed, keep_outputs=True)  # else the state goes where outputs go
        measure("of it: SUMO's load and our reading of the network", session.__enter__)
        measure(f"of it: warm-up, {WARM_UP:g} s", partial(_play, session, WARM_UP))
        with tempfile.TemporaryDirectory() as folder:
            file, api = str(Path(folder) / "state.xml"), cast(Any, session.api)
            measure("saveState after the warm-up", partial(api.simulation.saveState, file))
            measure("loadState of it, without learned road users", partial(api.simulation.loadState, file))
        session.close()

    with Arena(found, bundle, ArenaSettings(agents=agents), 1) as arena:
        row, random = np.zeros(1, np.intp), np.random.default_rng(1)

        def anew() -> None:
            arena.simulation.start_anew(row, bundle.max_speed, random)
            observe(Scene(arena.world, row, arena.simulation.road_map))

        modes = np.zeros(agents, np.int64)
        for _ in range(5 * repeat):
            measure("one road user in the running simulation", anew)
            measure("(for scale: one decision of all)", partial(arena.step, modes))
    return times


def _what_states_are_worth(scenario: str) -> str:
    """Whether SUMO goes on from a loaded state as it did from the moment when it was saved."""
    words = []
    for options, name in (((), ""), (FULL_STATE, " with all that --save-state has")):
        asked = with_options(find_scenario(scenario), options)
        with SumoSession(asked, seed=1, keep_outputs=True) as session, tempfile.TemporaryDirectory() as folder:
            _play(session, WARM_UP)
            file, api = str(Path(folder) / "state.xml"), cast(Any, session.api)
            api.simulation.saveState(file)
            unbroken = _traffic(session)
            loaded = []
            for _ in range(2):
                api.simulation.loadState(file)
                loaded.append(_traffic(session))
        as_unbroken = "the same" if loaded[0] == unbroken else "other"
        each_other = "the same" if loaded[0] == loaded[1] else "other"
        words.append(f"{as_unbroken} traffic as without loading{name}, {each_other} when loaded once more")
    return f"{scenario}: 20 s from a loaded state are {'; '.join(words)}."


def _traffic(session: SumoSession) -> list[tuple[str, tuple[float, float]]]:
    """Positions of all road users after 20 s."""
    _play(session, session.time + 20.0)
    # Not by our reader: a loaded state forgets its subscriptions.
    domains = (session.api.vehicle, session.api.person)
    return sorted((name, domain.getPosition(name)) for domain in domains for name in domain.getIDList())


def _play(session: SumoSession, until: float) -> None:
    while session.time < until:
        session.step()


if __name__ == "__main__":
    main()
