"""The recipe of the bundle `campus`: the Stanford Drone Dataset, then a supervised fit. Non-commercial use only.

    python tools/make_campus_bundle.py PATH/TO/sdd --out campus

PATH/TO/sdd holds estimated_scales.yaml and SCENE/VIDEO/annotations.txt. Learned from all videos but TESTS, on which
it is measured, and MOVING, in which the camera moves. Takes half a minute.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from slrl_sumo.formats.importers.sdd import read_sdd
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.learning.supervised.fit import fit

TESTS = (("nexus", "video10"), ("gates", "video5"))

MOVING = (("nexus", "video3"), ("nexus", "video5"), ("deathCircle", "video2"))
"""Videos in which the camera moves: all walkers of nexus/video3 slide by 2 m/s at once, for instance. The importer
leaves out such times only where it can tell from cars (slrl_sumo.formats.importers.camera)."""

STARTS = {("nexus", "video4"): 13}
"""First frame (of 0.4 s) of a video that counts: before it the camera moves."""

NOTICE = """**Non-commercial.** These weights are derived from the Stanford Drone Dataset, which is published under the
Creative Commons Attribution-NonCommercial-ShareAlike 3.0 License
(https://creativecommons.org/licenses/by-nc-sa/3.0/). They are under the same licence, unlike the rest of slrl_sumo:
not for commercial purposes, and what is built on them only under the same licence. Attribution: A. Robicquet,
A. Sadeghian, A. Alahi, S. Savarese, Learning Social Etiquette: Human Trajectory Prediction In Crowded Scenes,
European Conference on Computer Vision (ECCV), 2016. Changes: box centres were scaled to metres, smoothed and sampled
each 0.4 s, headings found from motion, and models fitted to that; no data of the set is in the bundle.

Left out are nexus/video3, nexus/video5, deathCircle/video2 and the first 5 s of nexus/video4: the camera moves there.
Little is left of cars: 11 tracks, with half of the windows in nexus/video4."""


def main() -> None:
    """Read and fit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder with estimated_scales.yaml and the scenes")
    parser.add_argument("--out", type=Path, required=True, help="bundle folder to write")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    videos = sorted(arguments.data.glob("*/video*/annotations.txt"))
    names = {(file.parts[-3], file.parts[-2]): file for file in videos}
    train = [
        since(read_sdd(file), STARTS.get(name, 0)) for name, file in names.items() if name not in (*TESTS, *MOVING)
    ]
    tests = [read_sdd(names[name]) for name in TESTS]
    bundle = fit(train, name=arguments.out.name, seed=arguments.seed, tests=tests, notice=NOTICE)
    bundle.save(arguments.out)
    print((arguments.out / "MODEL_CARD.md").read_text(encoding="utf-8"))


def since(recording: Trajectories, frame: int) -> Trajectories:
    """The recording from a frame on."""
    rows = recording.frame >= frame
    kept = np.unique(recording.track[rows])
    return replace(
        recording,
        track=np.searchsorted(kept, recording.track[rows]),
        ids=tuple(recording.ids[track] for track in kept.tolist()),
        **{name: getattr(recording, name)[rows] for name in ("frame", "x", "y", "heading", "mode")},
        **{name: getattr(recording, name)[kept] for name in ("type", "length", "width", "parked", "learned")},
    )


if __name__ == "__main__":
    main()
