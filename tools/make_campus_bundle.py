"""The recipe of the bundle `campus`: the Stanford Drone Dataset, then a supervised fit. Non-commercial use only.

    python tools/make_campus_bundle.py PATH/TO/sdd --out slrl_sumo/bundles/campus

PATH/TO/sdd holds estimated_scales.yaml and SCENE/VIDEO/annotations.txt. Learned from all videos but TESTS, on which
it is measured. Takes half a minute.
"""

import argparse
from pathlib import Path

from slrl_sumo.learning.fit import fit
from slrl_sumo.records.importers.sdd import read_sdd

TESTS = (("nexus", "video10"), ("gates", "video5"))

NOTICE = """**Non-commercial.** These weights are derived from the Stanford Drone Dataset, which is published under the
Creative Commons Attribution-NonCommercial-ShareAlike 3.0 License
(https://creativecommons.org/licenses/by-nc-sa/3.0/). They are under the same licence, unlike the rest of slrl_sumo:
not for commercial purposes, and what is built on them only under the same licence. Attribution: A. Robicquet,
A. Sadeghian, A. Alahi, S. Savarese, Learning Social Etiquette: Human Trajectory Prediction In Crowded Scenes,
European Conference on Computer Vision (ECCV), 2016. Changes: box centres were scaled to metres, smoothed and sampled
each 0.4 s, headings found from motion, and models fitted to that; no data of the set is in the bundle."""


def main() -> None:
    """Read and fit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder with estimated_scales.yaml and the scenes")
    parser.add_argument("--out", type=Path, required=True, help="bundle folder to write")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    videos = sorted(arguments.data.glob("*/video*/annotations.txt"))
    held_out = [arguments.data / scene / video / "annotations.txt" for scene, video in TESTS]
    train = [read_sdd(file) for file in videos if file not in held_out]
    tests = [read_sdd(file) for file in held_out]
    bundle = fit(train, name=arguments.out.name, seed=arguments.seed, tests=tests, notice=NOTICE)
    bundle.save(arguments.out)
    print((arguments.out / "MODEL_CARD.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
