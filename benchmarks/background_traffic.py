"""Hard braking, standing and overlaps of background vehicles, with a part of the traffic learned and in plain SUMO.

    python -m benchmarks.background_traffic TOWN.sumocfg ... [--takeover car=0.3] [--selectors greedy,lane] [--seeds 1]
        [--until 600] [--step-length 0.4] [--without] [--json FILE]

Per scenario and seed: plain SUMO, and each selector with yielding; with `--without` also without it. How things are
counted, after every SUMO step, of background vehicles that were background vehicles in the step before as well:

- Hard brakes: begins of braking above 4.65 m/s² (SUMO's passenger cars brake by 4.5 m/s² as a rule). `held`: those of
  vehicles that yielding held then. `free`: those with no other road user within 40 m ahead, 2 m beside the heading.
- Held standing: vehicles that stood for over 60 s while yielding held them; the longest; and the share of the steps of
  held standing vehicles in which no learned road user was within 30 m ahead of the centre, in any direction of the
  front half plane.
- Overlaps: collisions of background vehicles with learned road users, see slrl_sumo/metrics/encounters.py.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from slrl_sumo.jobs.pool import Backend, run_jobs
from slrl_sumo.metrics.encounters import ALL, EncounterCounts
from slrl_sumo.models.threads import one_thread
from slrl_sumo.scene.geometry import Floats, to_ego
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.background_state import background_world
from slrl_sumo.simulation.events import Decision
from slrl_sumo.simulation.preparation import add_learned, load_models
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.sumo.session import SumoSession

HARD_BRAKING = 4.65
"""m/s²."""
FREE_AHEAD, FREE_BESIDE = 40.0, 2.0
"""m."""
CAUSE_WITHIN = 30.0
"""m."""
STANDING = 0.1
"""m/s."""
LONG = 60.0
"""s."""


@dataclass(frozen=True)
class Case:
    """One run; `selector` `sumo`: no road user is learned."""

    scenario: str
    selector: str
    yields: bool
    seed: int
    takeover: str
    until: float
    step_length: float


@dataclass(frozen=True)
class Moment:
    """All road users after one SUMO step."""

    world: WorldState
    held: frozenset[str]
    """Vehicles that yielding holds."""


class BackgroundTraffic:
    """Counts of background vehicles; call `add` after every SUMO step."""

    def __init__(self, step_length: float) -> None:
        self.brakes: list[tuple[float, str, bool, bool]] = []
        """Time (s), vehicle, whether it was held, and whether the road was free ahead of it."""
        self.vehicle_seconds = 0.0
        self.held_seconds = 0.0
        self.standing: Counter[str] = Counter()
        """Steps that each vehicle has been standing now while held."""
        self.without_cause = 0
        """Steps of vehicles that had been standing for over LONG while held, without a learned road user ahead."""
        self.long: dict[str, float] = {}
        """Of vehicles that stood for over LONG while held: for how long, s."""
        self._dt = step_length
        self._last: dict[str, tuple[float, bool]] = {}
        """Speed of each background vehicle after the last step, and whether it braked hard in it."""

    def add(self, moment: Moment) -> None:
        """Count one step."""
        world, held = moment.world, moment.held
        before, self._last = self._last, {}
        background = ~world.learned & (world.type != RoadUserType.PEDESTRIAN)
        for row in np.flatnonzero(background).tolist():
            vehicle, speed = world.ids[row], world.speed.item(row)
            hard = False
            if vehicle in before:
                self.vehicle_seconds += self._dt
                last, was_hard = before[vehicle]
                hard = (last - speed) / self._dt > HARD_BRAKING
                if hard and not was_hard:
                    self.brakes.append((world.time, vehicle, vehicle in held, self._free_ahead(world, row)))
            self._last[vehicle] = speed, hard
            self.held_seconds += self._dt * (vehicle in held)
            if vehicle in held and speed < STANDING:
                self.standing[vehicle] += 1
                stood = self.standing[vehicle] * self._dt
                if stood > LONG:
                    self.long[vehicle] = max(stood, self.long.get(vehicle, 0.0))
                    self.without_cause += not self._learned_ahead(world, row)
            else:
                del self.standing[vehicle]

    def record(self) -> dict[str, Any]:
        """The counts as the columns of the table."""
        hours = self.vehicle_seconds / 3600.0
        return {
            "vehicle_hours": round(hours, 2),
            "hard_brakes": len(self.brakes),
            "hard_brakes_per_vehicle_hour": round(len(self.brakes) / hours, 3) if hours else None,
            "hard_brakes_held": sum(held for _, _, held, _ in self.brakes),
            "hard_brakes_free": sum(free for *_, free in self.brakes),
            "held_share": round(self.held_seconds / self.vehicle_seconds, 4) if hours else None,
            "held_standing": len(self.long),
            "longest_s": round(max(self.long.values(), default=0.0), 1),
            "without_cause_s": round(self.without_cause * self._dt, 1),
        }

    def _free_ahead(self, world: WorldState, row: int) -> bool:
        along, aside = _ahead(world, row)
        near = (along > 0.0) & (along < FREE_AHEAD + 0.5 * world.length[row]) & (abs(aside) < FREE_BESIDE)
        return int(near.sum()) == 0

    def _learned_ahead(self, world: WorldState, row: int) -> bool:
        along, aside = _ahead(world, row)
        return bool((world.learned & (along > 0.0) & (np.hypot(along, aside) < CAUSE_WITHIN)).any())


def _ahead(world: WorldState, row: int) -> tuple[Floats, Floats]:
    """All road users from a vehicle: m ahead of its centre and to the left; the vehicle itself is at 0."""
    along, aside = to_ego(world.x - world.x[row], world.y - world.y[row], world.heading[row])
    along[row] = 0.0
    return along, aside


def moments(case: Case) -> Iterator[tuple[Moment, Decision | None]]:
    """All SUMO steps of a run; with the last step of each decision interval comes the Decision."""
    settings = RunSettings(
        case.scenario,
        takeover=case.takeover,
        selector=None if case.selector == "sumo" else case.selector,
        seed=case.seed,
        step_length=case.step_length,
        background_yields=case.yields,
    )
    with SumoSession(settings.found(), seed=case.seed, step_length=case.step_length) as session:
        if case.selector == "sumo":
            while session.time < case.until:
                session.step()
                yield Moment(background_world(session.reader.read(), session.time, frozenset()), frozenset()), None
            return
        cosimulation = add_learned(session, settings, load_models(settings), case.scenario).cosimulation
        cosimulation.start()
        while session.time < case.until:
            with one_thread():
                step, decision = cosimulation.step()
            yield Moment(step.world, cosimulation.held), decision


def run_case(case: Case) -> dict[str, Any]:
    """One run in this process."""
    traffic, encounters = BackgroundTraffic(case.step_length), EncounterCounts()
    seen: dict[str, float] = {}
    interventions, learned = 0, 0.0
    for moment, decision in moments(case):
        world = moment.world
        traffic.add(moment)
        seen.update(dict.fromkeys(world.ids, world.time))
        learned += case.step_length * int(world.learned.sum())
        if decision is not None:
            encounters.add(world, world.learned)
            interventions += decision.interventions
    return traffic.record() | {
        "overlaps": int(encounters.with_background[ALL]),
        "overlaps_learned": int(encounters.collisions[ALL] - encounters.with_background[ALL]),
        "interventions": interventions,
        "finished": sum(time < case.until - 1.0 for time in seen.values()),
        "learned_hours": round(learned / 3600.0, 2),
    }


def cases_of(options: argparse.Namespace) -> list[Case]:
    """All requested runs, in the order of the table."""
    cases = []
    for scenario, seed in product(options.scenarios, options.seeds):
        rest = seed, options.takeover, options.until, options.step_length
        cases.append(Case(scenario, "sumo", False, *rest))
        for selector in options.selectors.split(","):
            cases += [Case(scenario, selector, yields, *rest) for yields in (False, True) if yields or options.without]
    return cases


def markdown(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The table: one line per run, and the sums of each selector."""
    columns = {
        "scenario": "scenario", "selector": "selector", "yields": "yielding", "seed": "seed",
        "vehicle_hours": "background vehicle-hours", "hard_brakes": "hard brakes",
        "hard_brakes_per_vehicle_hour": "per vehicle-hour", "hard_brakes_held": "held", "hard_brakes_free": "free",
        "held_share": "held share of time", "held_standing": "held standing > 60 s", "longest_s": "longest (s)",
        "without_cause_s": "without cause (s)", "overlaps": "overlaps with learned", "finished": "finished",
    }  # fmt: skip
    lines = ["| " + " | ".join(columns.values()) + " |", "|---" * len(columns) + "|"]
    return lines + ["| " + " | ".join(str(row[name]) for name in columns) + " |" for row in [*rows, *sums(rows)]]


def sums(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The sums over scenarios and seeds, by selector and yielding."""
    together = []
    for selector, yields in dict.fromkeys((row["selector"], row["yields"]) for row in rows):
        some = [row for row in rows if (row["selector"], row["yields"]) == (selector, yields)]
        hours = sum(row["vehicle_hours"] for row in some)
        total = {name: sum(row[name] for row in some) for name in some[0] if isinstance(some[0][name], int | float)}
        together.append(
            total
            | {
                "scenario": "all", "selector": selector, "yields": yields, "seed": "",
                "vehicle_hours": round(hours, 2), "longest_s": max(row["longest_s"] for row in some),
                "hard_brakes_per_vehicle_hour": round(total["hard_brakes"] / hours, 3),
                "held_share": round(sum(row["held_share"] * row["vehicle_hours"] for row in some) / hours, 4),
                "without_cause_s": round(total["without_cause_s"], 1),
            }
        )  # fmt: skip
    return together


def main() -> None:
    """Read the command line, run, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="+")
    parser.add_argument("--takeover", default="car=0.3", help="as for slrl-sumo run")
    parser.add_argument("--selectors", default="greedy", help="with commas")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--until", type=float, default=600.0, help="s")
    parser.add_argument("--step-length", type=float, default=0.4, help="s")
    parser.add_argument("--without", action="store_true", help="also without yielding")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path, help="also write all rows to this file")
    options = parser.parse_args()
    rows: dict[Case, dict[str, Any]] = {}
    cases = cases_of(options)
    with closing(run_jobs(run_case, cases, Backend(options.workers))) as results:
        for finished in results:
            if finished.record is None:
                print(f"{finished.job}: failed: {finished.reason}", file=sys.stderr)
            else:
                rows[finished.job] = asdict(finished.job) | finished.record
    done = [rows[case] for case in cases if case in rows]
    print("\n".join(markdown(done)))
    if options.json is not None:
        options.json.write_text(json.dumps(done, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
