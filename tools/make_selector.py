"""The recipe of the shipped selectors: the policy of a bundle, trained by imitation and PPO.

    python tools/make_selector.py intersection --out slrl_sumo/bundles/intersection
    python tools/make_selector.py shared-space --out slrl_sumo/bundles/shared-space
    python tools/make_selector.py intersection-paper --out slrl_sumo/bundles/intersection-paper
    python tools/make_selector.py shared-space-paper --hc PATH/TO/hc --out slrl_sumo/bundles/shared-space-paper

The first two know their routes (preset `extended`). The bundle's models (tools/make_*_bundle.py) stay as they are.
Settings: tools/selectors/. Checkpoints and logs lie in --work; --resume goes on from there. `intersection` takes a
quarter of an hour on 16 cores; the others ten minutes each on two free cores.
"""

import argparse
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from slrl_sumo.cli.train_display import train_with_progress
from slrl_sumo.formats.importers.hc import read_hc
from slrl_sumo.learning.rl.train import TrainRequest
from slrl_sumo.learning.rl.training_settings import read_settings
from slrl_sumo.models.bundle import load_bundle


@dataclass(frozen=True)
class Recipe:
    """How a selector is trained; its settings are in tools/selectors/NAME.toml."""

    families: str
    steps: int
    workers: int = 2


RECIPES = {
    "intersection": Recipe("town,town,random,roundabout,intersection,shared-space,motorway", 20_000_000, 32),
    "shared-space": Recipe("shared-space", 1_000_000),
    "intersection-paper": Recipe("intersection,random", 1_500_000),
    "shared-space-paper": Recipe("shared-space", 1_500_000),
}


def main() -> None:
    """Train, then put the selector into the bundle's folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=RECIPES)
    parser.add_argument("--out", type=Path, required=True, help="bundle folder to write")
    parser.add_argument("--work", type=Path, default=Path(".work/selectors"), help="where checkpoints and logs go")
    parser.add_argument("--hc", type=Path, help="folder with D1.csv, for shared-space-paper")
    parser.add_argument("--steps", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--resume", action="store_true")
    arguments = parser.parse_args()
    name = arguments.name
    recordings: tuple[Path, ...] = ()
    with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder:
        if name == "shared-space-paper":
            if arguments.hc is None:
                parser.error("shared-space-paper imitates HC D1: give --hc PATH/TO/hc")
            recordings = (Path(folder) / "D1.npz",)
            read_hc(arguments.hc / "D1.csv").save(recordings[0])
        recipe, out = RECIPES[name], arguments.work / name
        settings = read_settings(Path(__file__).parent / "selectors" / f"{name}.toml")
        request = TrainRequest(
            recipe.families,
            name,
            out,
            arguments.steps or recipe.steps,
            workers=recipe.workers,
            seed=arguments.seed,
            recordings=recordings,
        )
        if code := train_with_progress(request, settings, resume=arguments.resume):
            raise SystemExit(code)
    made = load_bundle(str(out))
    replace(made, name=name).save(arguments.out)


if __name__ == "__main__":
    main()
