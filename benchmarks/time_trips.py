"""Time of decisions in training with trips, and what was decided, to compare two checkouts by turns:

    PYTHONPATH=CHECKOUT python benchmarks/time_trips.py FAMILY SEED DECISIONS

Plays a generated network (as `slrl-sumo generate FAMILY --seed SEED`) with the settings of tools/selectors and the
greedy policy. Prints a digest of all modes, rewards, routes and positions, and processor time: equal digests are equal
decisions.
"""

import hashlib
import statistics
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

from slrl_sumo.agent.make_driver import make_selector
from slrl_sumo.learning.environments.trip_arena import TripArena
from slrl_sumo.learning.rl.training_settings import read_settings
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.threads import one_thread
from slrl_sumo.netgen.families import generate
from slrl_sumo.sumo.scenario import find_scenario

WARM_UP = 20
SETTINGS = Path(__file__).parents[1] / "tools" / "selectors" / "intersection.toml"


def main() -> None:
    """Play, print one line."""
    family, seed, decisions = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    given, bundle = read_settings(SETTINGS), load_bundle("intersection")
    selector = make_selector("greedy", bundle, seed)
    settings = replace(given.arena, weights=given.reward, preset="extended", trips=True, image=selector.needs_image)
    digest, times, users = hashlib.sha256(), [], 0
    with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder, one_thread():
        scenario = find_scenario(str(generate(family, seed, Path(folder) / "made")))
        with TripArena(scenario, bundle, settings, seed) as arena:
            for number in range(WARM_UP + decisions):
                begin = process_time()
                situation, modes = arena.situation, np.zeros(0, np.int64)
                if situation is not None:
                    masks, ids = list(situation.masks.values()), arena.simulation.population.world.ids
                    modes = selector.choose(situation.observation, situation.rollouts, ids, masks)[-1]
                outcome = arena.step(modes)
                if number >= WARM_UP:
                    times.append(process_time() - begin)
                    users += len(modes)
                route = None if situation is None else situation.scene.route
                world = arena.simulation.world
                parts = [modes, outcome.reward, outcome.terminated, world.x, world.y, world.heading]
                parts += (
                    []
                    if route is None
                    else [route.stop, route.line, route.desired_speed, route.remaining_distance, route.x, route.y]
                )
                for part in parts:
                    digest.update(np.ascontiguousarray(part).tobytes())
    print(
        f"{family} {seed}: {digest.hexdigest()[:16]}, {users / decisions:.1f} road users, "
        f"{1e3 * statistics.median(times):.2f} ms of processor time a decision, {users / sum(times):.0f} decisions of "
        "road users a second"
    )


if __name__ == "__main__":
    main()
