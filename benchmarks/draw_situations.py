"""What the trained selector does otherwise than `rule`, in five situations: pictures, and what it earns by that.

    python -m benchmarks.draw_situations --bundle intersection --config tools/selectors/intersection.toml --out five.png

On networks that no training drew, `rule` drives all road users. Where the trained selector would take another mode, one
road user is driven by it for the next SECONDS, in a second run that is equal until then: what differs later follows
from its choices alone. Of --examples such moments of each situation, the one with the median gain is drawn; the gain of
all of them, with a 95 % interval, is its title.
"""

import argparse
import math
import statistics
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.measure_trips import opened, situations
from slrl_sumo.agent.make_driver import make_selector
from slrl_sumo.agent.selection import Selector
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.learning.environments.trip_arena import TripArena
from slrl_sumo.learning.rl.training_settings import TrainSettings, read_settings
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.threads import one_thread
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL

FIRST_SEED = 90_000
"""Far from the seeds that trainings and benchmarks.measure_trips draw."""
FAMILIES = ("signals", "town", "random")
SITUATIONS = ("starting", "following", "stopping", "in a junction", "in company")
SECONDS = 10.0
DECISIONS = round(SECONDS / DECISION_INTERVAL)
EARLIEST, LATEST = 10, 120
"""Decisions of a play among which a moment is chosen."""
VIEW = 25.0
"""m to each side of where the road user is at first."""
COLOURS = {"rule": "tab:orange", "greedy": "tab:blue"}
GROUND = {Surface.ROAD: 0.75, Surface.CYCLEWAY: 0.7, Surface.SIDEWALK: 0.88, Surface.CROSSING: 0.82}


@dataclass(frozen=True)
class Moment:
    """Where both selectors choose differently for one road user."""

    seed: int
    decision: int
    road_user: str
    situation: str


@dataclass
class Drive:
    """One road user from a moment on, until it is gone."""

    x: list[float] = field(default_factory=list)
    y: list[float] = field(default_factory=list)
    speed: list[float] = field(default_factory=list)
    reward: list[float] = field(default_factory=list)
    first: WorldState | None = None
    """All road users at the moment."""
    ground: RoadMap | None = None


def family_of(seed: int) -> str:
    """They take turns."""
    return FAMILIES[seed % len(FAMILIES)]


def chosen(selector: Selector, arena: TripArena) -> NDArray[np.int64]:
    """The modes that a selector takes now, of all learned road users."""
    situation = arena.situation
    if situation is None:
        return np.zeros(0, np.int64)
    ids = arena.simulation.population.world.ids
    return selector.choose(situation.observation, situation.rollouts, ids, list(situation.masks.values()))[-1]


def moments(bundle: ModelBundle, settings: TrainSettings, seed: int) -> list[Moment]:
    """One moment of each situation, drawn at random among those of a network."""
    found: dict[str, list[Moment]] = {name: [] for name in SITUATIONS}
    rule, trained = (make_selector(name, bundle, seed) for name in ("rule", "greedy"))
    with opened(bundle, settings, family_of(seed), seed, trained) as arena:
        for decision in range(LATEST):
            modes = chosen(rule, arena)
            if decision >= EARLIEST and arena.situation is not None and arena.situation.context is not None:
                differs, users = chosen(trained, arena) != modes, arena.simulation.population.world
                masks = situations(arena.situation.context, users)
                for name in SITUATIONS:
                    rows = np.flatnonzero(masks[name] & differs).tolist()
                    found[name] += [Moment(seed, decision, users.ids[row], name) for row in rows]
            arena.step(modes)
    rng = np.random.default_rng(seed)
    return [several[rng.integers(len(several))] for several in found.values() if several]


def drive(bundle: ModelBundle, settings: TrainSettings, moment: Moment, name: str) -> Drive:
    """The road user of a moment by the selector `name` from then on, all others by `rule`."""
    rule, other = (make_selector(one, bundle, moment.seed) for one in ("rule", name))
    found = Drive()
    with opened(bundle, settings, family_of(moment.seed), moment.seed, other) as arena:
        found.ground = arena.simulation.road_map
        for decision in range(moment.decision + DECISIONS):
            modes, ids = chosen(rule, arena), arena.simulation.population.world.ids
            if decision < moment.decision:
                arena.step(modes)
                continue
            if moment.road_user not in ids:
                break
            row = ids.index(moment.road_user)
            modes[row] = chosen(other, arena)[row]
            world = arena.simulation.world
            found.x.append(world.x.item(row))
            found.y.append(world.y.item(row))
            found.first = found.first or world
            outcome = arena.step(modes)
            found.speed.append(outcome.speed.item(row))
            found.reward.append(outcome.reward.item(row))
    return found


def gain(drives: dict[str, Drive]) -> float:
    """What the trained selector earned more than `rule`."""
    return sum(drives["greedy"].reward) - sum(drives["rule"].reward)


def draw(axes: Any, title: str, drives: dict[str, Drive], moment: Moment) -> None:
    """Paths on the ground, speeds, and what was earned so far."""
    place, speeds, earned = axes
    first = drives["rule"]
    middle = first.x[0], first.y[0]
    draw_ground(place, first, middle)
    assert first.first is not None
    for row, name in enumerate(first.first.ids):
        draw_box(place, first.first, row, "black" if name == moment.road_user else "dimgray")
    for name, one in drives.items():
        place.plot(one.x, one.y, color=COLOURS[name], lw=2, label=name, alpha=0.8)
        times = DECISION_INTERVAL * np.arange(1, len(one.speed) + 1)
        speeds.plot(times, one.speed, color=COLOURS[name])
        earned.plot(times, np.cumsum(one.reward), color=COLOURS[name])
    place.set(xlim=(middle[0] - VIEW, middle[0] + VIEW), ylim=(middle[1] - VIEW, middle[1] + VIEW), aspect="equal")
    place.set_xticks([])
    place.set_yticks([])
    place.set_title(title, fontsize=9, loc="left")
    place.legend(fontsize=7, loc="upper right")
    for one, label in ((speeds, "speed, m/s"), (earned, "reward so far")):
        one.set_ylabel(label, fontsize=8)
        one.set_xlabel("s", fontsize=8)
        one.tick_params(labelsize=7)
        one.grid(alpha=0.3)


def draw_ground(place: Axes, one: Drive, middle: tuple[float, float]) -> None:
    """The surfaces around a place (m)."""
    assert one.ground is not None
    steps = np.arange(-VIEW, VIEW, 0.4) + 0.2
    x, y = (grid.ravel() for grid in np.meshgrid(middle[0] + steps, middle[1] + steps))
    shades = np.ones(max(Surface) + 1)
    for surface, shade in GROUND.items():
        shades[surface] = shade
    picture = shades[one.ground.surface_at(x, y)].reshape(len(steps), len(steps))
    extent = (middle[0] - VIEW, middle[0] + VIEW, middle[1] - VIEW, middle[1] + VIEW)
    place.imshow(picture, origin="lower", extent=extent, cmap="gray", vmin=0.0, vmax=1.0)


def draw_box(place: Axes, world: WorldState, row: int, colour: str) -> None:
    """The outline of a road user."""
    c, s = math.cos(world.heading.item(row)), math.sin(world.heading.item(row))
    length, width = 0.5 * world.length.item(row), 0.5 * world.width.item(row)
    corners = [(length, width), (length, -width), (-length, -width), (-length, width), (length, width)]
    x, y = zip(*((world.x[row] + c * a - s * b, world.y[row] + s * a + c * b) for a, b in corners), strict=True)
    place.fill(x, y, facecolor=colour, alpha=0.7, lw=0)


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bundle", default="intersection")
    parser.add_argument("--config", type=Path, help="settings of the training")
    parser.add_argument("--examples", type=int, default=12)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    bundle, settings = load_bundle(options.bundle), read_settings(options.config)
    every: dict[str, list[tuple[Moment, dict[str, Drive]]]] = {name: [] for name in SITUATIONS}
    with one_thread():
        seed = FIRST_SEED
        while any(len(several) < options.examples for several in every.values()) and seed < FIRST_SEED + 100:
            for moment in moments(bundle, settings, seed):
                if len(every[moment.situation]) < options.examples:
                    both = {name: drive(bundle, settings, moment, name) for name in COLOURS}
                    every[moment.situation].append((moment, both))
                    print(*vars(moment).values(), f"{gain(both):+.2f}", flush=True)
            seed += 1
    figure = Figure(figsize=(11.0, 16.0), layout="constrained")
    places = figure.subplots(len(SITUATIONS), 3, width_ratios=(1.2, 1.0, 1.0))
    for name, axes in zip(SITUATIONS, places, strict=True):
        gains = [gain(both) for _, both in every[name]]
        half = 1.96 * statistics.stdev(gains) / math.sqrt(len(gains))
        moment, both = sorted(every[name], key=lambda one: gain(one[1]))[len(gains) // 2]
        title = f"{name}: {gain(both):+.1f} here, {statistics.mean(gains):+.1f} ± {half:.1f} in {len(gains)}"
        print(title)
        draw(axes, title, both, moment)
    figure.savefig(options.out, dpi=80)
    print(options.out)


if __name__ == "__main__":
    main()
