"""Generated towns: random street networks with signals, priority junctions and several lanes, and their demand."""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from math import atan2, cos, sin
from pathlib import Path
from random import Random

from lxml import etree

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.families import generate
from slrl_sumo.netgen.plan import Edge, Node, Plan, write_plan
from slrl_sumo.studies.flow.scenarios.scenario_files import write_config
from slrl_sumo.studies.flow.scenarios.wheel import games

REST = 300.0
"""s at the end of a run without departures, for the vehicles that are still under way."""
RADIUS, RING_SPEED = 16.0, 6.0
"""m and m/s: of roundabouts."""
ROUNDABOUTS = 0.2
"""Share of the junctions of three and more streets that become roundabouts in a mixed town."""
LONGEST_WALK = 400.0
"""m: longest walk, as the crow flies."""


def town(seed: int, *, streets: int, seconds: float, period: float, mixed: bool = False) -> Callable[[Path], Path]:
    """Builds a town from `seed`.

    `streets`: how often a street is added; `seconds`: length of the run; `period`: s between two departures of cars;
    `mixed`: with roundabouts, and a bicycle and a pedestrian for every five cars.
    """

    def build(folder: Path) -> Path:
        drawing = ["--rand", "--rand.iterations", str(streets), "--rand.max-distance", "220"]
        drawing += ["--rand.min-distance", "132", "--rand.min-angle", "50", "-L", "2", "--random-lanenumber"]
        dressing = ["--tls.guess", "--tls.guess.threshold", "50", "--sidewalks.guess", "--crossings.guess"]
        usual = ["--no-turnarounds.except-deadend", "--seed", str(seed), "--no-warnings"]
        net = ["--output-file", "flow.net.xml"]
        if mixed:
            run_program("netgenerate", [*drawing, *usual, "--plain-output-prefix", "drawn", *net], folder)
            plan = with_roundabouts(read_plan(folder / "drawn.nod.xml", folder / "drawn.edg.xml"), seed)
            run_program("netconvert", [*write_plan(plan, folder), *dressing, *usual, *net], folder)
        else:
            run_program("netgenerate", [*drawing, *dressing, *usual, *net], folder)
        if mixed:
            return write_config(folder, seconds, routes=_write_mixed(folder, seed, seconds - REST, period, 5.0))
        return write_config(folder, seconds, routes=_write_trips(folder, "flow", seed, seconds - REST, period))

    return build


def grid(seed: int, *, seconds: float, period: float) -> Callable[[Path], Path]:
    """Builds a grid of 16 signals with lanes for turns of 40 m; arguments as for `town`."""

    def build(folder: Path) -> Path:
        drawing = ["--grid", "--grid.number", "4", "--grid.length", "180", "--grid.attach-length", "150", "-L", "3"]
        turns = ["--turn-lanes", "1", "--turn-lanes.length", "40", "--no-turnarounds", "--seed", str(seed)]
        signals = ["--default-junction-type", "traffic_light", "--tls.default-type", "actuated"]
        run_program("netgenerate", [*drawing, *turns, *signals, "--output-file", "flow.net.xml"], folder)
        return write_config(folder, seconds, routes=_write_trips(folder, "flow", seed, seconds - REST, period))

    return build


def crossings(seed: int, *, seconds: float, period: float) -> Callable[[Path], Path]:
    """Builds a grid of signals with crossings, and a pedestrian for every car; arguments as for `town`."""

    def build(folder: Path) -> Path:
        drawing = ["--grid", "--grid.number", "4", "--grid.length", "120", "-L", "2", "--no-turnarounds"]
        dressing = ["--sidewalks.guess", "--crossings.guess", "--default-junction-type", "traffic_light"]
        run_program("netgenerate", [*drawing, *dressing, "--seed", str(seed), "--output-file", "flow.net.xml"], folder)
        return write_config(folder, seconds, routes=_write_mixed(folder, seed, seconds - REST, period, 1.0))

    return build


def crowd(seed: int) -> Callable[[Path], Path]:
    """Builds a junction of the generated family `signals`: short arms, small corners and crowds of pedestrians."""
    return lambda folder: generate("signals", seed, folder / "made")


def city(name: str, seconds: float, period: float) -> Callable[[Path], Path]:
    """Takes the network of the game `name` that comes with the SUMO wheel; arguments as for `town`."""

    def build(folder: Path) -> Path:
        (folder / "flow.net.xml").write_bytes((games() / name / "osm.net.xml").read_bytes())
        return write_config(folder, seconds, routes=_write_trips(folder, "flow", 1, seconds - REST, period))

    return build


def read_plan(nodes: Path, edges: Path) -> Plan:
    """The plan in SUMO's plain XML, with car lanes only."""
    places = {
        str(n.get("id")): Node(float(n.get("x", 0)), float(n.get("y", 0)), "priority")
        for n in etree.parse(nodes).iter("node")
    }
    roads = {
        str(e.get("id")): Edge(
            str(e.get("from")), str(e.get("to")), float(e.get("speed", 0)), ({},) * int(e.get("numLanes", 1))
        )
        for e in etree.parse(edges).iter("edge")
    }
    return Plan(places, roads)


def with_roundabouts(plan: Plan, seed: int) -> Plan:
    """`plan` with a ring instead of ROUNDABOUTS of its junctions with three and more streets, drawn by `seed`."""
    around: dict[str, set[str]] = {name: set() for name in plan.nodes}
    for edge in plan.edges.values():
        around[edge.start].add(edge.end)
        around[edge.end].add(edge.start)
    nodes, edges = dict(plan.nodes), dict(plan.edges)
    meeting = [name for name in sorted(nodes) if len(around[name]) >= 3]
    chosen: list[str] = []
    for name in Random(seed).sample(meeting, len(meeting)):
        if len(chosen) < ROUNDABOUTS * len(meeting) and around[name].isdisjoint(chosen):
            chosen.append(name)
    for name in chosen:
        middle = nodes.pop(name)
        bearing = {
            other: atan2(plan.nodes[other].y - middle.y, plan.nodes[other].x - middle.x) for other in around[name]
        }
        arms = sorted(bearing, key=bearing.__getitem__)
        for arm, following in zip(arms, [*arms[1:], arms[0]], strict=True):
            x, y = middle.x + RADIUS * cos(bearing[arm]), middle.y + RADIUS * sin(bearing[arm])
            nodes[f"{name}-{arm}"] = Node(x, y, "priority")
            edges[f"ring-{name}-{arm}"] = Edge(f"{name}-{arm}", f"{name}-{following}", RING_SPEED, ({},))
        for key, edge in list(edges.items()):
            if edge.end == name:
                edges[key] = Edge(edge.start, f"{name}-{edge.start}", edge.speed, edge.lanes)
            elif edge.start == name:
                edges[key] = Edge(f"{name}-{edge.end}", edge.end, edge.speed, edge.lanes)
    return Plan(nodes, edges)


def _write_mixed(folder: Path, seed: int, seconds: float, period: float, walkers: float) -> str:
    """Routes of cars, of a bicycle for every five cars, and of a pedestrian for so many cars; the names of the files.
    Arguments as for `_write_trips`."""
    bicycles = ["--vehicle-class", "bicycle", "--prefix", "bicycle", "--fringe-factor", "2"]
    walks = ["--pedestrians", "--prefix", "walker", "--max-distance", f"{LONGEST_WALK:g}"]
    files = [
        _write_trips(folder, "flow", seed, seconds, period),
        _write_trips(folder, "bicycles", seed, seconds, 5.0 * period, bicycles),
        _write_trips(folder, "walkers", seed, seconds, walkers * period, walks),
    ]
    return ",".join(files)


def _write_trips(
    folder: Path, name: str, seed: int, seconds: float, period: float, options: Sequence[str] = ("--fringe-factor", "5")
) -> str:
    """Routes in flow.net.xml by SUMO's randomTrips.py; returns the name of the file.

    `seconds`: in which road users depart, one every `period` s; `options`: as usual, five times as many trips begin and
    end at the rim. Raises NetgenError where it fails.
    """
    import sumo

    home = Path(sumo.SUMO_HOME)
    file = f"{name}.rou.xml"
    command = [sys.executable, str(home / "tools" / "randomTrips.py"), "-n", "flow.net.xml", "-e", f"{seconds:g}"]
    command += ["-p", f"{period:g}", "--seed", str(seed), "--validate", "-o", f"{name}.trips.xml", "-r", file]
    environment = {**os.environ, "SUMO_HOME": str(home)}
    done = subprocess.run(
        [*command, *options], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise NetgenError(f"randomTrips.py failed (exit code {done.returncode}): {done.stderr.strip()[-300:]}")
    return file
