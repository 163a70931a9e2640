"""Time-space diagrams of arterials, SUMO's own traffic beside learned road users on the same demand.

    python -m benchmarks.draw_time_space --situations city,turn-lanes,town-small --seed 1 --out time-space.png

An arterial is the straightest chain of edges around the edge on which SUMO's cars drive the most, up to LONGEST. Each
line is a car on any of its lanes, coloured by its speed: queues are dark, and their ends show how they discharge.
"""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.threads import one_thread
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.studies.flow.run import SUMO, RecordedRun, Run, simulate
from slrl_sumo.studies.flow.situations import SITUATIONS
from slrl_sumo.studies.flow.trace import OnLanes, on_lanes
from slrl_sumo.sumo.network.lanes import Lane

LONGEST = 700.0
"""m."""
STRAIGHT = math.radians(50.0)
"""Largest turn from an edge of an arterial to the next one."""
NEAR = 40.0
"""m between the end of an edge and the begin of the next one, across a junction, at most."""
FASTEST = 14.0
"""m/s, the brightest colour."""
ACROSS = 15.0
"""m that are left between two edges, for the junction."""
GAP = 8.0
"""s without a place on the arterial, as in a junction, after which a line is interrupted."""


def arterial(played: RecordedRun, on: OnLanes) -> list[Lane]:
    """A lane of each edge of the arterial, in the direction of driving."""
    edges: dict[str, Lane] = {}
    for lane in on.lanes:
        if not lane.internal:
            edges.setdefault(lane.edge, lane)
    driven = dict.fromkeys(edges, 0.0)
    speed = played.trace.speed[on.row]
    for number, lane in enumerate(on.lanes):
        if not lane.internal:
            driven[lane.edge] += float(speed[on.lane == number].sum())
    first = edges[max(driven, key=lambda name: driven[name])]
    chain, length = [first], first.length
    while length < LONGEST:
        ways = [(step, forward) for forward in (True, False) if (step := _next(chain, edges, driven, forward=forward))]
        if not ways:
            break
        step, forward = max(ways, key=lambda way: driven[way[0].edge])
        chain = [*chain, step] if forward else [step, *chain]
        length += step.length
    return chain


def _next(chain: Sequence[Lane], edges: dict[str, Lane], driven: dict[str, float], *, forward: bool) -> Lane | None:
    """The most driven edge straight on from the end of a chain, or straight before its begin."""
    here = chain[-1].shape if forward else chain[0].shape[::-1]
    known, found = {lane.edge for lane in chain}, []
    for lane in edges.values():
        there = lane.shape if forward else lane.shape[::-1]
        turn = abs(float(wrap_angle(_direction(there[:2]) - _direction(here[-2:]))))
        away = there[0] - here[-1]
        ahead = float(away @ (here[-1] - here[-2])) >= 0.0
        if lane.edge not in known and np.hypot(*away) < NEAR and turn < STRAIGHT and ahead:
            found.append(lane)
    return max(found, key=lambda lane: driven[lane.edge], default=None)


def _direction(piece: Floats) -> float:
    return math.atan2(*(piece[1] - piece[0])[::-1])


def draw(axes: Axes, played: RecordedRun, on: OnLanes, chain: Sequence[Lane]) -> None:
    """The cars on the edges of an arterial."""
    begins, offset = {}, 0.0
    for lane in chain:
        begins[lane.edge], offset = offset, offset + lane.length + ACROSS
        axes.axhline(offset - ACROSS, color="0.8", linewidth=0.5)
    start = np.array([math.nan if one.internal else begins.get(one.edge, math.nan) for one in on.lanes])[on.lane]
    on_it = ~np.isnan(start)
    row, place = on.row[on_it], start[on_it] + on.front[on_it]
    time, vehicle, speed = played.trace.time[row], played.trace.vehicle[row], played.trace.speed[row]
    follows = (np.diff(vehicle) == 0) & (np.diff(time) < GAP) & (np.diff(place) > -5.0)
    points = np.column_stack([time, place])
    pieces = np.stack([points[:-1], points[1:]], axis=1)[follows]
    lines = LineCollection(list(pieces), cmap="viridis", linewidths=0.6, clim=(0.0, FASTEST))
    lines.set_array(speed[:-1][follows])
    axes.add_collection(lines)
    axes.set_xlim(0.0, float(played.trace.time.max(initial=1.0)))
    axes.set_ylim(0.0, offset)


def played_by(name: str, arm: str, seed: int, bundle: ModelBundle) -> tuple[RecordedRun, OnLanes]:
    """A run of the situation `name`, and where its cars were."""
    with TemporaryDirectory(prefix="slrl_flow_") as folder, one_thread():
        config = SITUATIONS[name].build(Path(folder))
        played = simulate(config, bundle, 1.0, Run(name, arm, seed), SITUATIONS[name].seconds)
    return played, on_lanes(played.trace, played.network.lanes)


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--situations", default="city,turn-lanes,town-small")
    parser.add_argument("--selector", default="greedy")
    parser.add_argument("--bundle", default="intersection")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    bundle, names = load_bundle(options.bundle), options.situations.split(",")
    figure = Figure(figsize=(12.0, 3.6 * len(names)), layout="constrained")
    all_axes = figure.subplots(len(names), 2, squeeze=False, sharey="row")
    for name, (left, right) in zip(names, all_axes, strict=True):
        plain = played_by(name, SUMO, options.seed, bundle)
        chain = arterial(*plain)
        for axes, arm, run in ((left, SUMO, plain), (right, options.selector, None)):
            draw(axes, *(run or played_by(name, arm, options.seed, bundle)), chain)
            axes.set_title(f"{name}, {arm}")
            axes.set_xlabel("time, s")
        left.set_ylabel("place, m")
        print(name, *(lane.edge for lane in chain), flush=True)
    figure.savefig(options.out, dpi=110)


if __name__ == "__main__":
    main()
