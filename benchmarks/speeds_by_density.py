"""Speeds of added learned road users beside those of SUMO's own at the same density:

    python -m benchmarks.speeds_by_density intersection 32 [--steps 128] [--seeds 3] [--scales 1,1.5,2,3]

Each SCALE multiplies the scenario's demand (SUMO's option --scale), without a learned road user; then AGENTS learned
ones are added to the demand of the scenario. Prints a Markdown table: for each type the mean number present, mean speed
and the share of time below 0.1 m/s of all seeds. The first 60 s of SUMO's own are left out, while it fills the network.
"""

import argparse

import numpy as np
from numpy.typing import NDArray

import slrl_sumo
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.types import DECISION_INTERVAL, STANDING_SPEED, TYPE_NAMES
from slrl_sumo.simulation.record import record
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.scenario.options import with_options

FILLING = 60.0


def main() -> None:
    """Record, then print a line for each demand."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario")
    parser.add_argument("agents", type=int)
    parser.add_argument("--bundle", default="intersection")
    parser.add_argument("--selector", help="default: the bundle's usual one")
    parser.add_argument("--steps", type=int, default=128, help="decisions with learned road users")
    parser.add_argument("--seconds", type=float, default=600.0, help="of SUMO alone")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1, help="the first one")
    parser.add_argument("--scales", default="1,1.5,2,3")
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.seeds)
    print("| | " + " | ".join(f"{name}s | m/s | standing" for name in TYPE_NAMES) + " |")
    print("|---" * (1 + 3 * len(TYPE_NAMES)) + "|")
    for scale in arguments.scales.split(","):
        own = [sumo_alone(arguments.scenario, scale, arguments.seconds, seed) for seed in seeds]
        print(f"| SUMO, demand x {scale} | {cells(own, int(FILLING / DECISION_INTERVAL))} |", flush=True)
    added = [with_learned(arguments, seed) for seed in seeds]
    print(f"| {arguments.agents} learned added: they alone | {cells(added, 0, learned=True)} |")
    print(f"| the same: all | {cells(added, 0)} |")


def sumo_alone(name: str, scale: str, seconds: float, seed: int) -> Trajectories:
    """SUMO's own road users at `scale` times the demand."""
    scenario = with_options(find_scenario(name), ["--scale", scale])
    return next(item for item in record(scenario, seconds=seconds, seed=seed) if isinstance(item, Trajectories))


def with_learned(arguments: argparse.Namespace, seed: int) -> Trajectories:
    """All road users of a run with learned ones added."""
    return slrl_sumo.run(
        arguments.scenario,
        agents=arguments.agents,
        bundle=arguments.bundle,
        selector=arguments.selector,
        steps=arguments.steps,
        seed=seed,
    ).trajectories


def cells(recordings: list[Trajectories], first: int, *, learned: bool = False) -> str:
    """Mean number, mean speed and share of standing ones of each type, from frame `first` of each recording on."""
    frames = sum(len(recording.frames) - first for recording in recordings)
    speeds = [_speeds(recording, first, learned) for recording in recordings]
    shown = []
    for kind in range(len(TYPE_NAMES)):
        v = np.concatenate([each[kind] for each in speeds])
        mean, standing = (v.mean(), (v < STANDING_SPEED).mean()) if len(v) else (np.nan, np.nan)
        shown.append(f"{len(v) / frames:.1f} | {mean:.2f} | {100 * standing:.0f} %")
    return " | ".join(shown)


def _speeds(recording: Trajectories, first: int, learned: bool) -> list[NDArray[np.floating]]:
    rows = recording.frame >= first
    if learned:
        rows &= recording.learned[recording.track]
    kind = recording.type[recording.track]
    return [recording.speed[rows & (kind == each)] for each in range(len(TYPE_NAMES))]


if __name__ == "__main__":
    main()
