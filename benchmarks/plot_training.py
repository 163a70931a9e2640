"""The curves of trainings: what a road user earns in a decision, and how trips end, against decisions.

    python -m benchmarks.plot_training OUT-training ... --out curve.png

Reads log.csv of each training's folder. Updates are averaged over --every slot-steps.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

CURVES = {
    "reward/total": "reward of a decision",
    "trips/clean": "arrivals without contact, on the own surface",
    "loss/clipfrac": "share of clipped ratios",
    "loss/explained_variance": "explained variance of the values",
}


def curve(file: Path, column: str, every: float) -> tuple[list[float], list[float]]:
    """Million slot-steps and means of `column` over `every` slot-steps; updates without a figure do not count."""
    with file.open(encoding="utf-8", newline="") as stream:
        rows = [(float(row["agent_steps"]), float(row[column])) for row in csv.DictReader(stream)]
    parts: dict[int, list[tuple[float, float]]] = {}
    for steps, value in rows:
        if np.isfinite(value):
            parts.setdefault(int(steps // every), []).append((steps, value))
    means = [np.mean(part, axis=0) for _, part in sorted(parts.items())]
    return [float(mean[0]) / 1e6 for mean in means], [float(mean[1]) for mean in means]


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--every", type=float, default=5e5)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    for place, (column, title) in zip(figure.subplots(2, 2).flat, CURVES.items(), strict=True):
        for folder in options.folders:
            place.plot(*curve(folder / "log.csv", column, options.every), label=folder.name)
        place.set_title(title, fontsize=10)
        place.set_xlabel("million slot-steps")
        place.grid(alpha=0.3)
    figure.axes[0].legend(fontsize=8)
    figure.savefig(options.out, dpi=120)
    print(options.out)


if __name__ == "__main__":
    main()
