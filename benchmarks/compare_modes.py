"""Which way to find modes predicts held-out recordings best: fits with each of them and several seeds, and a table.

    slrl-sumo import hc PATH/TO/hc --out hc
    python benchmarks/compare_modes.py --train hc/D1.npz --test hc/D2.npz hc/D3.npz

Errors after 6.4 s are relative to those of constant velocity, as means over the seeds with the least and the greatest.
"""

import argparse
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from slrl_sumo.formats.trajectory_file import load_trajectories
from slrl_sumo.learning.supervised.fit import fit
from slrl_sumo.learning.supervised.goals import MODES_BY
from slrl_sumo.studies.prediction.evaluate import evaluate
from slrl_sumo.studies.prediction.rollout import STEPS

FIGURES = ("step oracle", "prior", "best of 20", "prior in bends")


def main() -> None:
    """Fit, evaluate, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--train", type=Path, nargs="+", required=True, help="Trajectories files, .npz")
    parser.add_argument("--test", type=Path, nargs="+", required=True, help="Trajectories files, .npz")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    arguments = parser.parse_args()
    train, tests = ([load_trajectories(file) for file in files] for files in (arguments.train, arguments.test))
    found: dict[tuple[str, str, str, str], list[float]] = defaultdict(list)
    count: dict[tuple[str, str], int] = {}
    for modes in MODES_BY:
        for seed in arguments.seeds:
            bundle = fit(train, name=modes, seed=seed, modes=modes, preset="paper", tests=tests)
            for test in tests:
                result = evaluate(test, bundle)
                rows = {(row["selector"], row["type"]): row for row in result["rows"] if row["step"] == STEPS}
                bends = {(row["selector"], row["type"]): row for row in result["bends"]}
                for kind in [kind for selector, kind in rows if selector == "prior"]:
                    still, prior, oracle = (rows[name, kind] for name in ("constant-velocity", "prior", "step-oracle"))
                    count[test.source, kind] = still["n"]
                    key = (test.source, kind, modes)
                    found[*key, "step oracle"].append(oracle["fde_m"] / still["fde_m"])
                    found[*key, "prior"].append(prior["fde_m"] / still["fde_m"])
                    found[*key, "best of 20"].append(prior["min_ade_m"] / still["ade_m"])
                    if ("prior", kind) in bends:
                        straight = bends["constant-velocity", kind]["fde_m"]
                        found[*key, "prior in bends"].append(bends["prior", kind]["fde_m"] / straight)
    print(f"| recording | type | n | modes | {' | '.join(FIGURES)} |")
    print("|" + "---|" * (4 + len(FIGURES)))
    for (source, kind), n in count.items():
        for modes in MODES_BY:
            cells = " | ".join(_cell(found[source, kind, modes, figure]) for figure in FIGURES)
            print(f"| {source} | {kind} | {n} | {modes} | {cells} |")


def _cell(values: Sequence[float]) -> str:
    return f"{np.mean(values):.2f} ({min(values):.2f} to {max(values):.2f})" if values else "-"


if __name__ == "__main__":
    main()
