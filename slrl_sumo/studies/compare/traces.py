"""Comparison of the road users of two traces of one network."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.read import read_fcd_types
from slrl_sumo.formats.trajectories import Trajectories, road_users
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.metrics.driving_stats import DrivingStats
from slrl_sumo.metrics.traffic.trips import Trip, trips_of_trace
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.studies.compare.measures import EVERY_TYPE, TRACE_MEASURES
from slrl_sumo.studies.compare.report import print_comparison, write_comparison
from slrl_sumo.studies.compare.run import Record, Run, motion_record
from slrl_sumo.studies.compare.tables import distances, rows
from slrl_sumo.studies.compare.traced_vehicles import TracedVehicles, unknown_types
from slrl_sumo.studies.compare.verdicts import sign
from slrl_sumo.studies.prediction.given_ground import check_ground
from slrl_sumo.sumo.net_file import read_net_motors
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.scenario import Scenario

FIRST, SECOND = "first", "second"
LISTED = 10
"""Number of road users on the page."""
MAX_END_DIFFERENCE = 1.0
"""Difference (s) between the ends of two traces from which their counts are for different durations."""


def write_compared_traces(
    net: Path,
    traces: tuple[Path, Path],
    folder: Path,
    types: Mapping[str, str],
    sizes: Mapping[str, tuple[float, float]],
    scenario: Scenario | None = None,
) -> None:
    """Compare two traces (FCD) on the network `net`; write the result into `folder`, which is created, and print it.

    `types`, `sizes`: of vehicle types, as in `read_fcd`; `scenario` defines the vehicle types beside SUMO's default
    ones. Raises InputError where a file cannot be used.
    """
    begin = time.perf_counter()
    read = [read_fcd_types(trace, types, sizes) for trace in traces]
    network, motors = read_net_motors(net, scenario)
    road_map = RoadMap(network.surfaces())
    for tracks, _ in read:
        if not len(tracks):
            raise InputError(f"{tracks.source}: holds no road user; give a trace with some")
        check_ground(tracks, road_map, f"SUMO network {net}")
    first, second = (TracedVehicles(*each, motors) for each in read)
    result, runs = compare_traces((first, second), network, road_map, str(net))
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); name another --out") from None
    write_comparison(result, runs, folder)
    print_comparison(result, folder, time.perf_counter() - begin)


def compare_traces(
    traced: tuple[TracedVehicles, TracedVehicles], network: Network, road_map: RoadMap, name: str
) -> tuple[dict[str, Any], dict[Run, Record]]:
    """What differs between two traces: a result as that of `comparison.compare`, with the arms FIRST and SECOND.

    Each arm is one run, so `rows` have no intervals, and their `verdict` is the sign of the difference. `trips`: how
    many road users have a whole trip in both, or appear in one trace alone, and the trips that differ most.
    """
    arms = (FIRST, SECOND)
    tracks = traced[0].tracks, traced[1].tracks
    runs = {Run(1, arm): _record(each, network, road_map) for arm, each in zip(arms, traced, strict=True)}
    there = {EVERY_TYPE, *(TYPE_NAMES[kind] for each in tracks for kind in set(each.type.tolist()))}
    found = [row for row in rows(runs, arms, TRACE_MEASURES) if row["type"] in there]
    spans = [(each.t0, each.t0 + each.dt * each.frames[-1]) for each in tracks]
    result = {
        "network": name,
        "traces": {arm: each.source for arm, each in zip(arms, tracks, strict=True)},
        "spans_s": {arm: [round(time, 3) for time in span] for arm, span in zip(arms, spans, strict=True)},
        "seeds": [1],
        "notices": [*_notices(spans), *unknown_types(traced)],
        "rows": [row | {"verdict": sign(row["difference"])} for row in found],
        "distances": distances(runs, arms),
        "trips": _trips(tracks, list(runs.values())),
        "left_out": [],
    }
    return result, runs


def _record(traced: TracedVehicles, network: Network, road_map: RoadMap) -> Record:
    tracks = traced.tracks
    stats, names = DrivingStats(road_map), np.array(road_users(tracks.ids), np.object_)
    for frame in tracks.frames:
        world = tracks.world(frame)
        # A colliding pair counts once, even if a road user continues in a new track.
        users = tuple(names[tracks.track[tracks.rows_at(frame)]].tolist())
        if len(set(users)) == len(users):  # a vehicle and a person may have the same id
            world = replace(world, ids=users)
        stats.add(world, frozenset(world.ids))
    trips = trips_of_trace(tracks, traced.desired_speed(network))
    return {
        "trips": {road_user: list(astuple(trip)) for road_user, trip in trips.items()},
        "driving_stats": stats.record(),
        "emissions": traced.emissions(),
        **motion_record(tracks, network.levels),
    }


def _notices(spans: list[tuple[float, float]]) -> list[str]:
    lines = ["a trip counts where it begins after the first time step of a trace and ends before its last"]
    if any(abs(a - b) > MAX_END_DIFFERENCE for a, b in zip(*spans, strict=True)):
        between = " and ".join(f"{begin:g} to {end:g} s" for begin, end in spans)
        lines.append(f"the traces cover {between}: compare counts (trips, conflicts, collisions) with care")
    return lines


def _trips(tracks: Sequence[Trajectories], records: Sequence[Record]) -> dict[str, Any]:
    """Comparison of road users by id: counts, and the complete trips with the greatest differences of travel times."""
    here, there = (set(road_users(each.ids)) for each in tracks)
    first, second = ({i: Trip(*trip) for i, trip in record["trips"].items()} for record in records)
    times = [
        (road_user, one.arrived - one.departed, other.arrived - other.departed)
        for road_user, one in first.items()
        if (other := second.get(road_user)) is not None and one.arrived is not None and other.arrived is not None
    ]
    times.sort(key=lambda each: (-abs(each[2] - each[1]), each[0]))
    return {
        "in_both": len(times),
        "only_first": len(here - there),
        "only_second": len(there - here),
        "largest": [
            {"id": road_user, "type": TYPE_NAMES[first[road_user].type], FIRST: round(a, 1), SECOND: round(b, 1)}
            for road_user, a, b in times[:LISTED]
        ],
    }
