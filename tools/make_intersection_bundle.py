"""The recipe of the shipped bundle `intersection`: SUMO traffic on generated networks, then a supervised fit.

    python tools/make_intersection_bundle.py --out slrl_sumo/bundles/intersection
    python tools/make_intersection_bundle.py --paper --out slrl_sumo/bundles/intersection-paper

With --paper: the paper's modes (K-Means of positions), and neither roundabouts nor motorways; the models that ship in
`intersection-paper` were made before epochs drew the same number of windows of each mode (see
learning/supervised/network_training.py).

Takes three minutes on two cores. Recordings are kept in --work, so that an interrupted run goes on where it was.
None of the shipped scenarios is among the networks: those are for evaluation.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from rich.progress import track

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.formats.trajectory_file import load_trajectories
from slrl_sumo.learning.supervised.fit import fit
from slrl_sumo.netgen.families import generate
from slrl_sumo.simulation.record import record
from slrl_sumo.sumo.scenario import find_scenario

NETWORKS = (
    ("intersection", range(1000, 1024)),
    ("random", range(2000, 2008)),
    ("shared-space", range(3000, 3008)),
    ("roundabout", range(4000, 4008)),
    ("motorway", range(5020, 5026)),
)
AFTER_PAPER = ("roundabout", "motorway")
SECONDS = {"motorway": 200.0}
"""s that are recorded of a network, else 600: the bounds of the models are percentiles of all windows, and long
straight drives would narrow those of braking and turning."""
WORDS = {"intersection": "intersections", "random": "street nets", "shared-space": "shared spaces"}
LICENCE = "MIT: made by slrl_sumo itself, without recorded data of anybody"


def main() -> None:
    """Generate, record and fit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="bundle folder to write")
    parser.add_argument("--work", type=Path, default=Path(".work/intersection-bundle"), help="networks and recordings")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--paper", action="store_true", help="the paper's modes")
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    networks = [(family, seeds) for family, seeds in NETWORKS if not (arguments.paper and family in AFTER_PAPER)]
    drawn = ", ".join(f"{len(seeds)} {WORDS.get(family, family + 's')}" for family, seeds in networks)
    count = sum(len(seeds) for _, seeds in networks)
    also = "" if arguments.paper else ", motorways 200 s"
    source = f"SUMO 1.28 traffic on {count} networks drawn by netgen ({drawn}), 600 s each{also}"
    wanted = [(family, seed) for family, seeds in networks for seed in seeds]
    recordings = [_recording(family, seed, arguments.work, source) for family, seed in track(wanted, "recording")]
    name, seed = arguments.out.name, arguments.seed
    if arguments.paper:
        bundle = fit(recordings, name=name, seed=seed, modes="kmeans", preset="paper")
    else:
        # Selectors that follow routes need modes that slow down, keep their speed and speed up in any turn.
        bundle = fit(recordings, name=name, seed=seed, modes="accelerations", preset="paper", mirror=True, forget=0.5)
    bundle.save(arguments.out)
    print((arguments.out / "MODEL_CARD.md").read_text(encoding="utf-8"))


def _recording(family: str, seed: int, work: Path, source: str) -> Trajectories:
    file = work / f"{family}-{seed}.npz"
    if not file.exists():
        config = generate(family, seed, work / f"{family}-{seed}")
        *_, trajectories = record(find_scenario(str(config)), seconds=SECONDS.get(family, 600.0), seed=seed)
        assert isinstance(trajectories, Trajectories)
        trajectories.save(file)
    return replace(load_trajectories(file), source=source, licence=LICENCE)


if __name__ == "__main__":
    main()
