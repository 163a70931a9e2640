"""How long a supervised fit takes and how much memory it needs at its peak.

    python benchmarks/measure_fit.py .work/intersection-bundle/*.npz

fits Trajectories files (here those that make_intersection_bundle.py keeps: a million windows) and prints windows,
seconds and the peak of resident memory. The bundle is thrown away.
"""

import argparse
import resource
import time
from pathlib import Path

from slrl_sumo.formats.trajectory_file import load_trajectories
from slrl_sumo.learning.supervised.fit import fit
from slrl_sumo.learning.supervised.goals import MODES_BY
from slrl_sumo.perception.features import STATES


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+", help="Trajectories files, .npz")
    parser.add_argument("--modes", choices=MODES_BY, default="paths")
    parser.add_argument("--preset", choices=STATES, default="history")
    arguments = parser.parse_args()
    begin = time.perf_counter()
    recordings = [load_trajectories(file) for file in arguments.files]
    bundle = fit(recordings, name="measured", seed=1, modes=arguments.modes, preset=arguments.preset)
    seconds = time.perf_counter() - begin
    count = sum(kind["windows"] for kind in bundle.training["types"].values())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # Linux counts in KiB
    print(f"{count} windows: {seconds:.0f} s, peak of resident memory {peak:.0f} MiB")


if __name__ == "__main__":
    main()
