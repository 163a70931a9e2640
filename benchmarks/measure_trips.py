"""Selectors in the trips of the training, on networks that were not trained on: return, trips, contacts, decisions.

    python -m benchmarks.measure_trips --bundle B --selectors rule,greedy --networks 30 --out trips.json

Every network is played by each selector from the same start, `--decisions` long. Differences to the first selector are
of pairs, with 95 % intervals over networks: in all, by type, and in each of SITUATIONS. `greedy:black` sees black
images, `greedy:swapped` those of another road user. The file of --out is continued where it exists. Settings as in the
TOML file of the training: --config.
"""

import argparse
import json
import math
import statistics
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.make_driver import make_selector
from slrl_sumo.agent.selection import Selector
from slrl_sumo.jobs.pool import Backend, portable_name, run_jobs
from slrl_sumo.learning.environments.trip_arena import TripArena
from slrl_sumo.learning.rl.training_settings import TrainSettings, read_settings
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import shipped_bundles
from slrl_sumo.models.threads import one_thread
from slrl_sumo.netgen.families import generate
from slrl_sumo.perception.observation import Observation
from slrl_sumo.perception.presets import vector_for
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import STANDING_SPEED, TYPE_NAMES, RoadUserType
from slrl_sumo.sumo.scenario import find_scenario

FIRST_SEED = 70_000
"""Far from the seeds that trainings draw."""
SUMS = (
    "steps",
    "reward",
    "gone",
    "reached",
    "clean",
    "contacts",
    "at_fault",
    "off_surface",
    "red",
    "standing",
    "as_rule",
)
SITUATIONS = ("starting", "free", "following", "stopping", "in a junction", "beside the path", "in company")
"""Of vehicles: at a stand with nothing near, in motion with nothing ahead, behind a leader, before a line, in a
junction, OFFSET and more beside the path; of pedestrians: behind another road user. One that is in several counts in
each."""
GROUPS = (*TYPE_NAMES, *SITUATIONS)
IN_GROUP = ("steps", "progress", "speed", "contacts", "at_fault", "reached", "clean", "reward", "as_rule", "faster")
RATES = (
    ("reward", "steps", 1.0),
    ("speed", "steps", 1.0),
    ("progress", "steps", 1.0),
    ("contacts", "steps", 1000.0),
    ("at_fault", "steps", 1000.0),
    ("clean", "reached", 1.0),
    ("as_rule", "steps", 1.0),
    ("faster", "steps", 1.0),
)
"""Figures of each group: a sum, its divisor (also a sum), and a factor. `contacts`: all contacts; `at_fault`: contacts
by own fault (learning.rewards.fault); `faster`: speed (m/s) of the chosen mode after 2 s minus the speed of the mode of
`rule`."""
NEAR, AHEAD, OFFSET = 15.0, 40.0, 0.4
"""m."""


@dataclass(frozen=True, order=True)
class Play:
    """One network, played by one selector."""

    family: str
    seed: int
    selector: str


def play(bundle_name: str, settings: TrainSettings, decisions: int, job: Play) -> dict[str, float]:
    """Sums over all decisions: see SUMS, and in each group IN_GROUP."""
    bundle = load_bundle(bundle_name)
    name, _, spoilt = job.selector.partition(":")
    selector, rule = make_selector(name, bundle, job.seed), make_selector("rule", bundle, job.seed)
    sums = dict.fromkeys(SUMS, 0.0)
    sums |= {f"{what}_{name}": 0.0 for name in GROUPS for what in IN_GROUP}
    with one_thread(), opened(bundle, settings, job.family, job.seed, selector) as arena:
        for _ in range(decisions):
            situation = arena.situation
            modes = by_rule = np.zeros(0, np.int64)
            faster, groups = np.zeros(0), dict.fromkeys(SITUATIONS, np.zeros(0, np.bool_))
            if situation is not None:
                masks, ids = list(situation.masks.values()), arena.simulation.population.world.ids
                seen = spoil(situation.observation, spoilt)
                modes = selector.choose(seen, situation.rollouts, ids, masks)[-1]
                by_rule = rule.choose(situation.observation, situation.rollouts, ids, masks)[-1]
                assert situation.rollouts is not None
                assert situation.context is not None
                rows, speed = np.arange(len(modes)), situation.rollouts.speed
                faster = speed[rows, modes] - speed[rows, by_rule]
                groups = situations(situation.context, arena.simulation.population.world)
            outcome = arena.step(modes)
            none = np.zeros(len(modes))
            values = {
                "steps": none + 1.0,
                "reward": outcome.reward,
                "gone": outcome.gone,
                "reached": outcome.reached,
                "clean": outcome.clean,
                "contacts": outcome.contact,
                "at_fault": -outcome.terms.get("contact", none),
                "off_surface": -outcome.terms.get("off_surface", none),
                "red": -outcome.terms.get("red", none),
                "standing": outcome.speed < 0.1,
                "as_rule": modes == by_rule,
                "speed": outcome.speed,
                "progress": outcome.terms.get("progress", none),
                "faster": faster,
            }
            groups |= {name: outcome.type == number for number, name in enumerate(TYPE_NAMES)}
            for name in SUMS:
                sums[name] += float(values[name].sum())
            for name, mask in groups.items():
                for what in IN_GROUP:
                    sums[f"{what}_{name}"] += float(values[what][mask].sum())
    return sums


@contextmanager
def opened(
    bundle: ModelBundle, settings: TrainSettings, family: str, seed: int, selector: Selector
) -> Iterator[TripArena]:
    """The arena of one network as the selector perceives it."""
    seen = replace(settings.arena, preset=selector.preset, state=vector_for(bundle.config.preset, selector.preset))
    trips = replace(seen, image=selector.needs_image, weights=settings.reward, trips=True)
    with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder:
        scenario = find_scenario(str(generate(family, seed, Path(folder) / "made")))
        with TripArena(scenario, bundle, trips, seed) as arena:
            yield arena


def situations(context: RouteContext, users: WorldState) -> dict[str, NDArray[np.bool_]]:
    """Which of n road users are in each of SITUATIONS, (n,) each."""
    route, walks = context.route, users.type == RoadUserType.PEDESTRIAN
    drives, inside = route.known & ~walks, np.isfinite(route.junction_entry_time)
    nearest = np.minimum(context.leader_gap, context.stop_distance)
    moves = users.speed > STANDING_SPEED
    masks = (
        drives & ~moves & (nearest > NEAR),
        drives & moves & (nearest > AHEAD) & ~inside,
        drives & moves & (context.leader_gap < np.minimum(AHEAD, context.stop_distance)) & ~inside,
        drives & moves & (context.stop_distance < np.minimum(AHEAD, context.leader_gap)) & ~inside,
        drives & inside,
        drives & moves & (np.abs(context.lateral_offset) > OFFSET),
        walks & route.known & (context.leader_gap < NEAR),
    )
    return dict(zip(SITUATIONS, masks, strict=True))


def spoil(seen: Observation, how: str) -> Observation:
    """An observation with `black` or `swapped` images; else as it is."""
    if seen.image is None or not how:
        return seen
    return replace(seen, image=np.zeros_like(seen.image) if how == "black" else np.roll(seen.image, 1, 0))


def figures(sums: dict[str, float]) -> dict[str, float]:
    """The figures of one play."""
    steps = max(1.0, sums["steps"])
    by_group = {
        f"{what}_{name}": factor * sums[f"{what}_{name}"] / sums[f"{among}_{name}"]
        for name in GROUPS
        for what, among, factor in RATES
        if sums[f"{among}_{name}"]
    }
    return {
        "reward per step": sums["reward"] / steps,
        "reached": sums["reached"],
        "contacts per 1,000 steps": 1000.0 * sums["contacts"] / steps,
        "at fault per 1,000 steps": 1000.0 * sums["at_fault"] / steps,
        "off surface per 1,000 steps": 1000.0 * sums["off_surface"] / steps,
        "red per 1,000 steps": 1000.0 * sums["red"] / steps,
        "clean of the reached": sums["clean"] / sums["reached"] if sums["reached"] else math.nan,
        "standing": sums["standing"] / steps,
        "mode as rule": sums["as_rule"] / steps,
        **by_group,
    }


def compared(plays: dict[Play, dict[str, float]], selectors: list[str]) -> list[dict[str, Any]]:
    """Mean of each figure per selector, and its difference to the first selector with half the 95 % interval."""
    networks = sorted({(job.family, job.seed) for job in plays})
    every = {
        name: [figures(plays[Play(*network, name)]) for network in networks if _complete(plays, network, selectors)]
        for name in selectors
    }
    rows = []
    for name in selectors:
        for figure in figures(dict.fromkeys(plays[next(iter(plays))], 1.0)):
            pairs = [
                (mine[figure], first[figure])
                for mine, first in zip(every[name], every[selectors[0]], strict=True)
                if not math.isnan(mine.get(figure, math.nan)) and not math.isnan(first.get(figure, math.nan))
            ]
            if not pairs:
                continue
            differences = [a - b for a, b in pairs]
            spread = statistics.stdev(differences) if len(differences) > 1 else math.nan
            rows.append(
                {
                    "selector": name,
                    "figure": figure,
                    "networks": len(pairs),
                    "mean": statistics.mean(a for a, _ in pairs),
                    "difference": statistics.mean(differences),
                    "half_interval": 1.96 * spread / math.sqrt(len(differences)),
                }
            )
    return rows


def _complete(plays: dict[Play, dict[str, float]], network: tuple[str, int], selectors: list[str]) -> bool:
    return all(Play(*network, name) in plays for name in selectors)


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bundle", default="intersection")
    parser.add_argument("--config", type=Path, help="settings of the training")
    parser.add_argument("--selectors", default="rule,greedy")
    parser.add_argument("--families", default="town,random,roundabout", help="in turn")
    parser.add_argument("--networks", type=int, default=30)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED, help="of the networks")
    parser.add_argument("--decisions", type=int, default=300)
    parser.add_argument(
        "--agents", type=int, help="learned at a time; those beyond are SUMO's, whose persons see no_users"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    selectors, families = options.selectors.split(","), options.families.split(",")
    done: dict[Play, dict[str, float]] = {}
    if options.out.exists():
        done = {Play(*line[:3]): line[3] for line in json.loads(options.out.read_text())["plays"]}
    jobs = [
        Play(families[k % len(families)], options.first_seed + k, name)
        for k in range(options.networks)
        for name in selectors
    ]
    settings = read_settings(options.config)
    if options.agents:
        settings = replace(settings, arena=replace(settings.arena, agents=options.agents))
    work = partial(play, portable_name(options.bundle, shipped_bundles()), settings, options.decisions)
    with closing(run_jobs(work, [job for job in jobs if job not in done], Backend(options.workers))) as results:
        for finished in results:
            print(*asdict(finished.job).values(), finished.reason or "done", flush=True)
            if finished.record is not None:
                done[finished.job] = finished.record
                rows = compared(done, selectors)
                lines = [[*asdict(job).values(), sums] for job, sums in sorted(done.items(), key=lambda item: item[0])]
                options.out.write_text(json.dumps({"rows": rows, "plays": lines}, indent=1) + "\n")
    for row in compared(done, selectors):
        print(
            f"{row['selector']:8} {row['figure']:28} {row['networks']:3} {row['mean']:9.4f}  "
            f"{row['difference']:+.4f} ± {row['half_interval']:.4f}"
        )


if __name__ == "__main__":
    main()
