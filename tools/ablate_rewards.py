"""What each term of the reward is good for: short trainings with one term left out each, beside one with all of them.

    python tools/ablate_rewards.py --out out/ablation [--steps 300000] [--scenarios intersection,random]
    python tools/ablate_rewards.py --out out/routes --config tools/selectors/ablation-routes.toml

All variants have the same seed, networks and number of steps, and are taught by the same imitation first; one has no
imitation. The table shows means over the last quarter of each training, modes drawn from the policy. Trainings that are
there already are not repeated, so the command can be taken up again.
"""

import argparse
import csv
import math
from dataclasses import replace
from pathlib import Path

from slrl_sumo.cli.train_display import train_with_progress
from slrl_sumo.learning.rewards.terms import TERMS
from slrl_sumo.learning.rl.train import TrainRequest
from slrl_sumo.learning.rl.training_settings import TrainSettings, read_settings
from slrl_sumo.scene.types import TYPE_NAMES

COLUMNS = {
    "contacts": "reward/contact",
    "lost": "reward/lost",
    "off surface": "reward/off_surface",
    "wrong way": "reward/wrong_way",
    "discomfort": "reward/comfort",
    "improbable": "reward/realism",
}
"""Terms that the table shows as what they count, per 1,000 steps."""
ON_ROUTES = {
    "contacts": "reward/contact",
    "off surface": "reward/off_surface",
    "off path": "reward/off_path",
    "over a closed line": "reward/red",
    "went first": "reward/priority",
    "lost way": "reward/progress",
    "discomfort": "reward/comfort",
}
"""The same for the preset `extended`."""


ROUTE_TERMS = ("progress", "off_path", "red", "priority")
"""Always 0 without routes."""


def variants(usual: TrainSettings) -> dict[str, TrainSettings]:
    """The settings of each variant by name."""
    named = {"all terms": usual}
    on_routes = usual.policy.preset == "extended"
    for term in TERMS:
        if getattr(usual.reward, term) and (on_routes or term not in ROUTE_TERMS):
            named[f"without {term}"] = replace(usual, reward=replace(usual.reward, **{term: 0.0}))
    paper = dict.fromkeys(TERMS, 0.0) | {"close": 1.0, "off_surface": 1.0, "moving": 1.0}
    named["the paper's three"] = replace(usual, reward=replace(usual.reward, **paper))
    named["without imitation"] = replace(usual, imitation=replace(usual.imitation, epochs=0))
    return named


def main() -> None:
    """Train all variants and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder for the trainings")
    parser.add_argument("--scenarios", default="intersection,random")
    parser.add_argument("--bundle", default="intersection")
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--only", help="names of variants, separated by commas")
    parser.add_argument("--config", type=Path, default=Path(__file__).parent / "selectors" / "ablation.toml")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    names = arguments.only.split(",") if arguments.only else None
    usual = read_settings(arguments.config)
    columns = ON_ROUTES if usual.policy.preset == "extended" else COLUMNS
    print("| variant |", " | ".join(columns), "|", " | ".join(f"{t} m/s | {t} standing" for t in TYPE_NAMES), "|")
    for name, settings in variants(usual).items():
        if names is not None and name not in names:
            continue
        request = TrainRequest(
            arguments.scenarios, arguments.bundle, arguments.out / name.replace(" ", "-"), arguments.steps
        )
        if not (request.out / "selector.json").exists() and not train_with_progress(request, settings, resume=True):
            raise SystemExit(130)
        print(_row(name, request.folder / "log.csv", columns), flush=True)


def _row(name: str, log: Path, columns: dict[str, str]) -> str:
    with log.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    last = rows[-max(1, len(rows) // 4) :]

    def mean(key: str) -> float:
        values = [float(row[key]) for row in last if not math.isnan(float(row[key]))]
        return sum(values) / len(values)

    # Progress is 1 where nothing is lost.
    cells = [f"{1000 * ((key == 'reward/progress') - mean(key)):.1f}" for key in columns.values()]
    for kind in TYPE_NAMES:
        cells += [f"{mean(f'motion/mean_speed_{kind}_mps'):.2f}", f"{mean(f'motion/standing_{kind}'):.1%}"]
    return f"| {name} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
