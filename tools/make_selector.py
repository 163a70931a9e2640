"""The recipe of the shipped selectors: the policy of a bundle, trained by imitation and PPO.

    python tools/make_selector.py intersection --out slrl_sumo/bundles/intersection
    python tools/make_selector.py shared-space --out slrl_sumo/bundles/shared-space
    python tools/make_selector.py intersection-paper --out slrl_sumo/bundles/intersection-paper
    python tools/make_selector.py shared-space-paper --hc PATH/TO/hc --out slrl_sumo/bundles/shared-space-paper

The first two know their routes (preset `extended`). The bundle's models (tools/make_*_bundle.py) stay as they are.
Settings: tools/selectors/NAME.toml. Checkpoints and logs lie in OUT-training; --resume goes on from there. Takes ten
minutes for each on two free cores.
"""

import argparse
import json
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

from slrl_sumo.cli.train_display import train_with_progress
from slrl_sumo.formats.importers.hc import read_hc
from slrl_sumo.learning.rl.train import TrainRequest
from slrl_sumo.learning.rl.training_settings import read_settings
from slrl_sumo.models.bundle import load_bundle

FAMILIES = {
    "intersection": "town,town,random,roundabout,shared-space",
    "shared-space": "shared-space",
    "intersection-paper": "intersection,random",
    "shared-space-paper": "shared-space",
}
STEPS = {
    "intersection": (2_400_000,),
    "shared-space": (1_000_000,),
    "intersection-paper": (1_500_000,),
    "shared-space-paper": (1_500_000,),
}


def main() -> None:
    """Train, then put the selector into the bundle's folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=FAMILIES)
    parser.add_argument("--out", type=Path, required=True, help="bundle folder to write")
    parser.add_argument("--work", type=Path, help="where checkpoints and logs go; default: beside OUT")
    parser.add_argument("--hc", type=Path, help="folder with D1.csv, for shared-space-paper")
    parser.add_argument("--steps", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--resume", action="store_true")
    arguments = parser.parse_args()
    name = arguments.name
    out = (arguments.work or arguments.out.parent) / name
    settings = read_settings(Path(__file__).parent / "selectors" / f"{name}.toml")
    recordings: tuple[Path, ...] = ()
    with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder:
        if name == "shared-space-paper":
            if arguments.hc is None:
                parser.error("shared-space-paper imitates HC D1: give --hc PATH/TO/hc")
            recordings = (Path(folder) / "D1.npz",)
            read_hc(arguments.hc / "D1.csv").save(recordings[0])
        request = TrainRequest(FAMILIES[name], name, out, STEPS[name][0], seed=arguments.seed, recordings=recordings)
        begun = request.folder / "settings.json"
        asked = json.loads(begun.read_text(encoding="utf-8"))["steps"] if arguments.resume and begun.exists() else 0
        resume = arguments.resume
        for steps in (arguments.steps,) if arguments.steps else STEPS[name]:
            if steps < asked:
                continue
            if not train_with_progress(replace(request, steps=steps), settings, resume=resume):
                raise SystemExit(130)
            resume = True
    if out.resolve() != arguments.out.resolve():
        load_bundle(out).save(arguments.out)
        shutil.rmtree(out)


if __name__ == "__main__":
    main()
