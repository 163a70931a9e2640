"""Takeover runs of learned road users against SUMO's own models, on the same demand.

    python tools/takeover_study.py --scenarios signalised cross --selectors sumo lane greedy --seeds 1 2 3 \
        --json study.json --markdown --pictures pictures
    python tools/takeover_study.py --json study.json --markdown --scenarios signalised        # only the tables of it

Everybody eligible is taken over, everywhere or in --region, until --seconds; then all are handed back, and the run goes
on for --tail s to see what becomes of them. In `sumo` nobody is taken, and those that a takeover would have taken are
followed. Every run is a process of its own, because SUMO can take its process along: such a run is reported as died.
Runs that are in --json already are not made again (those that died are). --selectors and --seeds are lists.

How things are counted:

- Left on their own route: arrived at the own destination, or, with a region, given back outside of it with the route or
  destination that they came with, before --seconds. The share is of those that have left by then, whatever way, and
  those that were taken at least 120 s before --seconds. Who strayed (SUMO had to put it back onto its route) has not
  left on its own route, even if it went off the network at its own destination (counted apart, within 30 m of it); nor
  has who was still learned at --seconds: `unfinished`, of whom `home later` arrived in the
  tail, driven by SUMO. Give the run more than a trip's time.
- Time in the region: of those that left on their own route, from takeover to leaving or arriving; the ratio to `sumo`
  is over those that left in both runs.
- Signals: see slrl_sumo/metrics/signal_crossings.py. Overlaps: slrl_sumo/metrics/driving_stats.py,
  every 0.4 s.
- Off surface, speeds, braking (below -4.5 m/s²): of all steps (0.4 s) of road users while learned, or followed.
- Cars on their lanes: slrl_sumo/metrics/lane_keeping.py; changes of side beyond 0.15 m.
- Agent-steps per s: learned road users times decisions over the wall time of the loop, SUMO's steps included.

The signals of the wheel's scenarios wait for a player; they are switched every 30 s. Pictures: ten cars, first seed.
"""

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from slrl_sumo.agent.driver import SELECTORS, Driver, make_driver
from slrl_sumo.metrics.driving_stats import DrivingStats
from slrl_sumo.metrics.signal_crossings import Passage, Passages
from slrl_sumo.metrics.trip_outcomes import Journey, Journeys, outcome
from slrl_sumo.report.paths_picture import choose_paths, draw_paths
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.cosimulation import HYSTERESIS, CoSimulation, Takeover
from slrl_sumo.simulation.events import Decision
from slrl_sumo.simulation.region import Region, parse_region
from slrl_sumo.studies.takeover_tables import TABLES, add_time_ratios, aligned, markdown, table
from slrl_sumo.sumo.scenario import Scenario, find_scenario, shipped_scenarios
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.taken_over import TakenOverControl

GREEN = 30.0
"""s after which a signal that waits for a player is switched."""
ENDLESS = 1000.0
"""s; a phase this long waits for a player."""
TIME_TO_LEAVE = 120.0
CASE = ("scenario", "selector", "seed", "seconds", "tail", "region", "bundle", "guard")
"""What a run is known by."""


@dataclass(frozen=True)
class TimedRegion(Region):
    """A region that ends at a time: from then on nobody is inside, so that everybody is handed back."""

    clock: Callable[[], float] = lambda: 0.0
    """s."""
    until: float = 0.0

    def inside(self, x: Floats, y: Floats, margin: float = 0.0) -> np.ndarray:
        """See Region."""
        return super().inside(x, y, margin) & (self.clock() < self.until)


def driver_of(case: dict[str, Any], session: SumoSession) -> Driver:
    """Who moves the learned road users; in `sumo` there are none."""
    import torch

    from slrl_sumo.models.bundle import load_bundle

    torch.set_num_threads(1)
    selector = "lane" if case["selector"] == "sumo" else case["selector"]
    keywords: dict[str, Any] = {"guard": True} if case["guard"] else {}
    bundle = load_bundle(case["bundle"])
    return make_driver(selector, bundle, session.api, session.network, case["seed"], **keywords)


def scenario_of(name: str) -> Scenario:
    """A shipped scenario, a file or folder, or a game that came with the SUMO wheel."""
    if name in shipped_scenarios() or Path(name).exists():
        return find_scenario(name)
    import sumo

    return find_scenario(str(Path(sumo.SUMO_HOME) / "tools" / "game" / f"{name}.sumocfg"))


def auto_region(api: Any) -> str:
    """The junction where most lanes meet, with a radius of 60 m."""
    junctions = [j for j in api.junction.getIDList() if not j.startswith(":")]
    return f"junction:{max(junctions, key=lambda j: len(api.junction.getIncomingEdges(j)))},radius=60"


class Signals:
    """Switches the signals that wait for a player."""

    def __init__(self, api: Any, begin: float) -> None:
        self._light = api.trafficlight
        # Not at the moment when everybody is handed back.
        self._last = begin + 0.5 * GREEN

    def play(self, now: float) -> None:
        """Switch them if it is time to."""
        if now - self._last < GREEN:
            return
        self._last = now
        for signal in self._light.getIDList():
            if self._light.getPhaseDuration(signal) >= ENDLESS:
                program = self._light.getProgram(signal)
                logics = self._light.getAllProgramLogics(signal)
                phases = next(len(logic.phases) for logic in logics if logic.programID == program)
                self._light.setPhase(signal, (self._light.getPhase(signal) + 1) % phases)


class Followed:
    """In `sumo`: the road users that a takeover would have taken, while they are in the region."""

    def __init__(self, session: SumoSession, region: Region, journeys: Journeys) -> None:
        self.ids: frozenset[str] = frozenset()
        self._loans = TakenOverControl(session.api, session.network)
        self._region, self._journeys = region, journeys

    def renew(self, world: WorldState, now: float) -> None:
        """Who leaves and who comes, as `CoSimulation` has it."""
        inside = self._region.inside(world.x, world.y)
        near = self._region.inside(world.x, world.y, HYSTERESIS)
        kept = {world.ids[i] for i in np.flatnonzero(near).tolist() if world.ids[i] in self.ids}
        for road_user in self.ids.intersection(world.ids) - kept:
            self._journeys.give_back(road_user, now, strayed=False, inside=False)
        rows = [i for i in np.flatnonzero(inside).tolist() if world.ids[i] not in kept]
        walking = world.type[rows] == RoadUserType.PEDESTRIAN
        able = self._loans.eligible([world.ids[i] for i in rows], walking)
        for row in [row for row, may in zip(rows, able.tolist(), strict=True) if may]:
            self._journeys.take(world.ids[row], RoadUserType(world.type[row]), now)
            kept.add(world.ids[row])
        self.ids = frozenset(kept)


def run(case: dict[str, Any], picture: Path | None) -> dict[str, Any]:
    """One run, here in this process."""
    plain = case["selector"] == "sumo"
    with SumoSession(scenario_of(case["scenario"]), seed=case["seed"]) as session:
        api, begin = session.api, session.time
        end = begin + case["seconds"]
        text = auto_region(api) if case["region"] == "auto" else case["region"]
        region = parse_region(text, session.network)
        timed = TimedRegion(**vars(region), clock=lambda: session.time, until=end)
        rule = None if plain else Takeover(np.ones(len(TYPE_NAMES)), timed, case["seed"])
        loop = CoSimulation(session, driver_of(case, session), takeover=rule, yielding=not plain)
        journeys, passages = Journeys(api, session.step_length), Passages(api, session.network)
        signals, conduct = Signals(api, begin), DrivingStats(loop.roadmap, session.network)
        followed = Followed(session, region, journeys)
        seen: list[Passage] = []
        costs: list[float] = []
        learned: list[int] = []
        handed_back = 0

        def take() -> frozenset[str]:
            """Note who is learned from now on."""
            if plain:
                followed.renew(loop.world, session.time)
                return followed.ids
            world = loop.population.world
            for row in [i for i, road_user in enumerate(world.ids) if road_user not in own]:
                journeys.take(world.ids[row], RoadUserType(world.type[row]), session.time)
            return frozenset(world.ids)

        own: frozenset[str] = frozenset()
        loop.start()
        own = take()
        while session.time < end:
            signals.play(session.time)
            learned.append(len(own))
            cost, decision = 0.0, None
            while decision is None:
                clock = time.perf_counter()
                step, decision = loop.step()
                cost += time.perf_counter() - clock
                journeys.look(step.world, session.time)
                seen += passages.look(step.world, own)
            costs.append(cost)
            lost = {step.world.ids[row] for row in np.flatnonzero(decision.lost)}
            conduct.add(step.world, own.difference(decision.arrived, lost))
            if session.time >= end:
                journeys.close()
            handed_back += len(decision.handed_back)
            _note_returned(journeys, decision, loop.world, timed, session.time)
            own = take() if session.time < end else own
        while session.time < end + case["tail"] and journeys.under_way:
            signals.play(session.time)
            decision = None
            while decision is None:
                step, decision = loop.step()
                journeys.look(step.world, session.time)
            handed_back += len(decision.handed_back)
        not_returned = len(loop.population.world)
        if picture is not None:
            title = f"{case['scenario']}, {case['selector']}, seed {case['seed']}"
            draw_paths(session.network, choose_paths(conduct.paths, case["seed"]), title, picture)
    kinds = {name: [j for j in journeys.all.values() if j.type == kind] for kind, name in enumerate(TYPE_NAMES)}
    under_way = Counter(journeys.all[road_user].type for road_user in journeys.under_way)
    steps, wall = sum(learned), sum(costs)
    return {
        "region_used": text,
        "handed_back": handed_back,
        "not_handed_back": not_returned,
        "journeys": {
            **{
                name: asdict(outcome(kinds[name], end, TIME_TO_LEAVE, under_way[RoadUserType(kind)]))
                for kind, name in enumerate(TYPE_NAMES)
            },
            "all": asdict(outcome(journeys.all.values(), end, TIME_TO_LEAVE, under_way.total())),
        },
        "passages": {name: _signals(seen, RoadUserType(kind)) for kind, name in enumerate(TYPE_NAMES)},
        "red_runs": [[round(p.time, 2), p.road_user, p.lane] for p in seen if p.aspect == "red"],
        "conduct": conduct.record(),
        "throughput": {
            "decisions": len(costs),
            "wall_s": round(wall, 3),
            "agent_steps_per_s": round(steps / wall, 1) if wall else None,
            "ms_per_decision": round(1e3 * float(np.median(costs)), 3) if costs else None,
            "mean_learned": round(steps / max(len(learned), 1), 2),
        },
        "users": {road_user: _user(journey) for road_user, journey in journeys.all.items()},
    }


def _note_returned(journeys: Journeys, decision: Decision, world: WorldState, region: Region, now: float) -> None:
    back = [(i, road_user) for i, road_user in enumerate(world.ids) if road_user in set(decision.handed_back)]
    rows = np.array([i for i, _ in back], np.intp)
    inside = region.inside(world.x[rows], world.y[rows], HYSTERESIS).tolist()
    for (_, road_user), near in zip(back, inside, strict=True):
        journeys.give_back(road_user, now, strayed=road_user in decision.strayed, inside=near)


def _signals(seen: list[Passage], kind: RoadUserType) -> dict[str, int]:
    aspects = Counter(passage.aspect for passage in seen if passage.type == kind)
    return {"passages": aspects.total(), "red": aspects["red"], "yellow": aspects["yellow"]}


def _user(journey: Journey) -> dict[str, Any]:
    return {
        "type": TYPE_NAMES[journey.type],
        "fate": journey.fate,
        "after": journey.after,
        "left": journey.fate in ("left", "home"),
        "inside_s": round(journey.inside_s, 2),
    }


def child(case: dict[str, Any], picture: Path | None, most: float) -> dict[str, Any]:
    """One run in a process of its own; a row with `died` where that did not end well."""
    command = [sys.executable, "-X", "faulthandler", __file__, "--case", json.dumps(case)]
    command += ["--pictures", str(picture)] if picture is not None else []
    # Each run has one core; more threads would only wait for each other.
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=most, env=environment)
    except subprocess.TimeoutExpired:
        return {**case, "died": f"not done after {most:g} s"}
    results = [line for line in done.stdout.splitlines() if line.startswith("RESULT ")]
    if done.returncode or not results:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        print(f"{_name(case)}: died\n{chr(10).join(lines[-30:])}", file=sys.stderr, flush=True)
        return {**case, "died": f"exit code {done.returncode}: {lines[-1] if lines else 'no message'}"}
    return {**case, **json.loads(results[0].removeprefix("RESULT "))}


def _name(case: dict[str, Any]) -> str:
    return f"{case['scenario']} {case['selector']} seed {case['seed']}"


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(row[name] for name in CASE)


def cases_of(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Every run that is wanted, in the order of the tables."""
    cases = []
    for scenario, selector, seed in product(options.scenarios, options.selectors, options.seeds):
        # Neither SUMO nor the lane follower has models, or a guard of ours: those runs serve for all bundles.
        modelled = selector not in ("sumo", "lane")
        usual = "shared-space" if scenario == "shared-space" else "intersection"
        cases.append(
            {
                "scenario": scenario,
                "selector": selector,
                "seed": seed,
                "seconds": options.seconds,
                "tail": options.tail,
                "region": options.region,
                "bundle": options.bundle if modelled and options.bundle != "auto" else usual,
                "guard": options.guard and modelled,
            }
        )
    return cases


def study(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Make the runs that are not there yet, and return the rows of all that are wanted."""
    stored = json.loads(options.json.read_text())["rows"] if options.json and options.json.exists() else []
    rows = {_key(row): row for row in stored}
    cases = cases_of(options)
    todo = [case for case in cases if _key(case) not in rows or "died" in rows[_key(case)]]
    lock = threading.Lock()

    def play(case: dict[str, Any]) -> dict[str, Any]:
        picture = None
        if options.pictures and case["seed"] == options.seeds[0]:
            guard = "-guard" if case["guard"] else ""
            picture = options.pictures / f"{Path(case['scenario']).stem}-{case['selector']}{guard}.png"
        row = child(case, picture, options.most)
        with lock:
            rows[_key(row)] = row
            if options.json:
                part = options.json.with_suffix(".part")
                part.write_text(json.dumps({"rows": list(rows.values())}) + "\n")
                part.replace(options.json)
        return row

    with ThreadPoolExecutor(options.workers) as pool:
        for number, job in enumerate(as_completed([pool.submit(play, case) for case in todo]), 1):
            row = job.result()
            print(f"{number}/{len(todo)} {_name(row)}: {row.get('died', 'done')}", file=sys.stderr, flush=True)
    return [rows[_key(case)] for case in cases]


def words(text: str) -> list[str]:
    """Names with commas between them."""
    return [word for word in text.split(",") if word]


def main() -> None:
    """Read the command line, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenarios", nargs="+", default=["intersection", "signalised", "district", "shared-space"])
    parser.add_argument("--bundle", default="auto", help="auto: shared-space in that scenario, else intersection")
    parser.add_argument("--selectors", nargs="+", type=words, default=[["sumo", "prior", "greedy", "lane"]])
    parser.add_argument("--guard", action="store_true", help="with the lookahead guard")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--seconds", type=float, default=600.0, help="takeover until then")
    parser.add_argument("--tail", type=float, default=300.0, help="s to see what becomes of those taken")
    parser.add_argument("--region", help="as for slrl-sumo run, or auto: the largest junction, radius 60")
    parser.add_argument("--json", type=Path, help="rows are kept here, and not made again")
    parser.add_argument("--markdown", action="store_true", help="tables as Markdown")
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each scenario and selector")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--most", type=float, default=3600.0, help="wall time of a run, s; then it counts as died")
    parser.add_argument("--case", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.case:
        print("\nRESULT " + json.dumps(run(options.case, options.pictures)), flush=True)
        return
    options.selectors = [selector for group in options.selectors for selector in group]
    unknown = [selector for selector in options.selectors if selector not in ("sumo", *SELECTORS)]
    if unknown:
        parser.error(f"--selectors {unknown[0]}: there is none of that name; use sumo, {', '.join(SELECTORS)}")
    rows = study(options)
    add_time_ratios(rows)
    for name in TABLES:
        lines = table(name, rows)
        print(f"\n### {name}\n\n{markdown(lines)}" if options.markdown else f"\n{name}\n{aligned(lines)}")


if __name__ == "__main__":
    main()
