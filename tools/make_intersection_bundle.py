"""The recipe of the shipped bundle `intersection`: SUMO traffic on generated networks, then a supervised fit.

    python tools/make_intersection_bundle.py --out slrl_sumo/bundles/intersection

Takes two minutes on two cores. Recordings are kept in --work, so that an interrupted run goes on where it was.
None of the shipped scenarios is among the networks: those are for evaluation.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from rich.progress import track

from netgen.families import generate
from slrl_sumo.learning.fit import fit
from slrl_sumo.records.trajectories import Trajectories, load_trajectories
from slrl_sumo.simulation.record import record
from slrl_sumo.sumo.scenario import find_scenario

NETWORKS = (("intersection", range(1000, 1024)), ("random", range(2000, 2008)), ("shared-space", range(3000, 3008)))
SECONDS = 600.0
SOURCE = (
    "SUMO 1.28 traffic on 40 networks drawn by netgen (24 intersections, 8 street nets, 8 shared spaces), 600 s each"
)
LICENCE = "MIT: made by slrl_sumo itself, without recorded data of anybody"


def main() -> None:
    """Generate, record and fit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="bundle folder to write")
    parser.add_argument("--work", type=Path, default=Path(".work/intersection-bundle"), help="networks and recordings")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    wanted = [(family, seed) for family, seeds in NETWORKS for seed in seeds]
    recordings = [_recording(family, seed, arguments.work) for family, seed in track(wanted, "recording")]
    # In SUMO's traffic, where everybody has much the same speed, relative modes predict no better than the paper's.
    bundle = fit(recordings, name=arguments.out.name, seed=arguments.seed, modes="kmeans")
    bundle.save(arguments.out)
    print((arguments.out / "MODEL_CARD.md").read_text(encoding="utf-8"))


def _recording(family: str, seed: int, work: Path) -> Trajectories:
    file = work / f"{family}-{seed}.npz"
    if not file.exists():
        config = generate(family, seed, work / f"{family}-{seed}")
        *_, trajectories = record(find_scenario(str(config)), seconds=SECONDS, seed=seed)
        assert isinstance(trajectories, Trajectories)
        trajectories.save(file)
    return replace(load_trajectories(file), source=SOURCE, licence=LICENCE)


if __name__ == "__main__":
    main()
