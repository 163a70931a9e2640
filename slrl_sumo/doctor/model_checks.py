"""Limits of the default bundle's models in a network: turns that are too sharp, lanes that are too fast."""

import math
from collections.abc import Iterator
from functools import cache

import numpy as np

from slrl_sumo.agent.path_smoothing import OFF_LANE, path_moved
from slrl_sumo.doctor.finding import Finding, counted
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import DEFAULT_BUNDLE
from slrl_sumo.models.capability import Capability, capability_of
from slrl_sumo.scene.geometry import Floats, wrap_angle
from slrl_sumo.scene.route import SPACING
from slrl_sumo.scene.types import TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.placement.spawn import legal_lanes
from slrl_sumo.simulation.takeover import fast_lanes
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import Lane
from slrl_sumo.sumo.network.links import LaneLinks

SMALLEST_TURN = math.radians(45.0)
"""Angle below which turns are not checked."""
TURN_REACH = 25.0
"""Length (m) of the lanes before and after a junction that belongs to a turn."""


def turn_findings(api: SumoApi, network: Network) -> Iterator[Finding]:
    """Turns of cars and bicycles that are too sharp for the models of the usual bundle, in an open simulation."""
    capability = _capability()
    links, lanes = LaneLinks(api, network), {lane.id: lane for lane in network.lanes}
    for kind in (RoadUserType.CAR, RoadUserType.BICYCLE):
        turns = sharp = 0
        worst, where = 0.0, ""
        admitting = {lane.id for lane in legal_lanes(network, kind)}
        for name, line in _turns(lanes, admitting, links):
            turns += 1
            moved = path_moved(line, capability, kind)
            sharp += moved > OFF_LANE
            if moved > worst:
                worst, where = moved, name
        if sharp:
            yield Finding(
                "note",
                "sharp turns",
                f"{counted(sharp, 'turn', 'turns')} of {turns} for {TYPE_NAMES[kind]}s {'is' if sharp == 1 else 'are'} "
                f"tighter than the models of bundle '{DEFAULT_BUNDLE}' can follow (the tightest: {where}, by "
                f"{worst:.1f} m)",
                "none needed: learned vehicles are steered along the drawn path, at 2 to 3 m/s; added ones "
                "avoid turnarounds",
            )


def fast_lane_findings(network: Network) -> Iterator[Finding]:
    """Lanes that are too fast for the cars of the usual bundle."""
    max_speed = _bundle().max_speed
    roads = [lane for lane in legal_lanes(network, RoadUserType.CAR) if not lane.internal]
    fast = fast_lanes(network, max_speed)
    if fast:
        whole, part = (sum(lane.length for lane in some) / 1000 for some in (roads, [r for r in roads if r.id in fast]))
        top = max(lane.max_speed for lane in roads)
        yield Finding(
            "note",
            "fast lanes",
            f"{counted(len(fast), 'lane has a limit', 'lanes have limits')} far above the top speed of bundle "
            f"'{DEFAULT_BUNDLE}' ({max_speed[RoadUserType.CAR]:.1f} m/s): {part:.1f} of {whole:.1f} km for cars, up to "
            f"{top:g} m/s",
            "none needed: --takeover leaves vehicles there to SUMO and counts them; --selector lane drives there",
        )


@cache
def _bundle() -> ModelBundle:
    return load_bundle(DEFAULT_BUNDLE)


@cache
def _capability() -> Capability:
    return capability_of(_bundle())


def _turns(lanes: dict[str, Lane], admitting: set[str], links: LaneLinks) -> Iterator[tuple[str, Floats]]:
    """Name and path, (k, 2) with points every SPACING m, of bends of lanes and of turns from lane to lane."""
    begins = {lane: _first(lanes[lane].shape) for lane in admitting}
    ends = {lane: _first(lanes[lane].shape[::-1])[::-1] for lane in admitting}
    for start in sorted(admitting):
        shape = _distinct(lanes[start].shape)
        if len(shape) > 2 and _largest_turn(shape) > SMALLEST_TURN:
            yield f"on {lanes[start].edge}", _sampled(shape)
        for target, via in links(start):
            if target not in admitting:
                continue
            pieces = [ends[start]]
            while via and len(pieces) < 5:
                pieces.append(lanes[via].shape)
                via = next((further for _, further in links(via)), "")
            pieces.append(begins[target])
            line = _distinct(np.concatenate(pieces))
            if len(line) > 1 and _whole_turn(line) > SMALLEST_TURN:
                yield f"from {lanes[start].edge} to {lanes[target].edge}", _sampled(line)


def _distinct(line: Floats) -> Floats:
    """Without points that lie on the one before."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    return np.asarray(line[np.concatenate([[True], steps > 1e-3])])


def _headings(line: Floats) -> Floats:
    steps = np.diff(line, axis=0)
    return np.arctan2(steps[:, 1], steps[:, 0])


def _largest_turn(line: Floats) -> float:
    return float(np.abs(wrap_angle(np.diff(_headings(line)))).max(initial=0.0))


def _whole_turn(line: Floats) -> float:
    """rad between its first and last piece."""
    before, after = line[1] - line[0], line[-1] - line[-2]
    return abs(math.remainder(math.atan2(after[1], after[0]) - math.atan2(before[1], before[0]), math.tau))


def _first(line: Floats) -> Floats:
    """The first TURN_REACH m of a line: its points, and the one in which it is cut."""
    passed = 0.0
    for k in range(1, len(line)):
        step = math.dist(line[k - 1], line[k])
        if passed + step > TURN_REACH:
            cut = line[k - 1] + (TURN_REACH - passed) / step * (line[k] - line[k - 1])
            return np.concatenate([line[:k], cut[None]])
        passed += step
    return line


def _sampled(line: Floats) -> Floats:
    """Points every SPACING m along a line, and its ends."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    count = max(2, 1 + math.ceil(along[-1] / SPACING))
    s = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(s, along, line[:, 0]), np.interp(s, along, line[:, 1])])
