"""Whether two checkouts take the same decisions: runs of all shipped scenarios, bundles, selectors and presets.

    python benchmarks/compare_decisions.py CHECKOUT OTHER --out FOLDER

Each run is a process with PYTHONPATH at the checkout; traces that are in FOLDER already are not made again. Prints, for
each run, the share of equal modes and the largest distance between positions (m). Exit code 1 where anything differs by
more than 1e-4 m. Takes some 5 minutes for each checkout.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet

TOLERANCE = 1e-4
ALL = "car=1,bicycle=1,pedestrian=1"
SOME = "car=0.5,bicycle=1,pedestrian=1"
RUNS: dict[str, str] = {
    **{
        f"{scenario}-{bundle}-{selector}": f"{scenario} --bundle {bundle} --selector {selector} {words}"
        for scenario, bundles, words in (
            ("intersection", ("intersection", "intersection-paper"), "--agents 40 --steps 120"),
            ("signalised", ("intersection", "intersection-paper"), f"--takeover {SOME} --steps 150"),
            ("shared-space", ("shared-space", "shared-space-paper"), "--agents 40 --steps 120"),
        )
        for bundle in bundles
        for selector in ("prior", "rule", "greedy", "sampled")
    },
    "district": "district --agents 64 --steps 150",
    "district-guard": "district --agents 64 --guard --steps 150",
    "district-takeover-guard": "district --takeover car=0.6,bicycle=1,pedestrian=1 --guard --steps 200",
    "district-prior-guard": "district --selector prior --agents 40 --guard --steps 100",
    "district-lane": "district --selector lane --takeover car=1,pedestrian=1 --steps 150",
    "region-guard": f"signalised --takeover {ALL} --region junction:centre,radius=60 --guard --steps 150",
    "paper-guard": "signalised --bundle intersection-paper --agents 30 --guard --step-length 0.2 --steps 100",
    "lane-no-yield": "signalised --selector lane --takeover car=1 --no-yield --steps 150",
    "both": "intersection --agents 20 --takeover car=0.5 --steps 120 --selector sampled",
}


def main() -> int:
    """Run what is missing, print a line for each run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkouts", type=Path, nargs=2)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    worst = 0.0
    for name, words in RUNS.items():
        one, other = (_trace(checkout, given.out / str(k), name, words) for k, checkout in enumerate(given.checkouts))
        a, b = (pyarrow.parquet.read_table(trace).to_pandas() for trace in (one, other))
        if len(a) != len(b) or (a.vehicle_id != b.vehicle_id).any():
            print(f"{name}: other road users ({len(a)} and {len(b)} rows)")
            worst = np.inf
            continue
        modes = float((a["mode"].fillna(-1) == b["mode"].fillna(-1)).mean())
        apart = float(np.hypot(a.vehicle_x - b.vehicle_x, a.vehicle_y - b.vehicle_y).max())
        print(f"{name}: {len(a)} rows, {100 * modes:.3f} % equal modes, {apart:.2g} m")
        worst = max(worst, apart, 0.0 if modes == 1.0 else np.inf)
    return int(worst > TOLERANCE)


def _trace(checkout: Path, folder: Path, name: str, words: str) -> Path:
    """The trace of a run of `checkout`."""
    folder.mkdir(parents=True, exist_ok=True)
    trace = folder / f"{name}.parquet"
    if not trace.exists():
        root = checkout.resolve()
        module = "slrl_sumo" if (root / "slrl_sumo" / "__main__.py").exists() else "slrl_sumo.cli"
        command = [sys.executable, "-m", module, "run", *words.split(), "--seed", "3", "--quiet", "--fcd", str(trace)]
        subprocess.run(command, env={**os.environ, "PYTHONPATH": str(root)}, cwd=folder, check=True)
    return trace


if __name__ == "__main__":
    sys.exit(main())
