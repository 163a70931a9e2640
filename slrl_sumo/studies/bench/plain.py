"""Cost of SUMO's road users, in the same number as the learned road users."""

import statistics
from collections.abc import Generator
from time import perf_counter

import numpy as np

from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.placement.spawn import draw_starts, starting_points, type_counts
from slrl_sumo.simulation.shares import parse_mix
from slrl_sumo.studies.bench.measurement_process import Workload
from slrl_sumo.sumo.api import StageRecord
from slrl_sumo.sumo.network.lanes import LanePoints
from slrl_sumo.sumo.road_users import (
    arrived_ids,
    find_route,
    find_walk,
    insert_pedestrian,
    insert_vehicle,
    loaded_count,
)
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.spawned import SUMO_TEMPLATES

WARM_UP_STEPS = 50
"""Number of SUMO steps before the measurement, in which road users without a gap at first are inserted."""
DESTINATION_ATTEMPTS = 8
"""Number of tried destinations of a road user before its route ends on its first edge."""


class _Traffic:
    """Road users of SUMO's own that start where learned ones would, and start again when they have arrived."""

    def __init__(self, session: SumoSession, work: Workload) -> None:
        self._api = session.api
        self._random = np.random.default_rng(work.seed)
        self._points = starting_points(session.network)
        counts, _ = type_counts(work.agents, parse_mix(work.mix), self._points, str(session.scenario.config))
        kinds, x, y, *_ = draw_starts(counts, self._points, np.random.default_rng(work.seed))
        self._starts: dict[str, tuple[int, int]] = {}
        for number, kind in enumerate(kinds.tolist()):
            place = int(self._points[kind].nearest(x[number : number + 1], y[number : number + 1])[0, 0])
            self._starts[f"plain_{number}"] = kind, place
            self._add(f"plain_{number}")

    def renew(self) -> None:
        """Restart the road users that have arrived; call it after each SUMO step."""
        for user in sorted(arrived_ids(self._api)):
            if user in self._starts:
                self._add(user)

    def _add(self, user: str) -> None:
        kind, place = self._starts[user]
        points = self._points[kind]
        lane, offset = points.lanes[points.lane[place]], float(points.offset[place])
        if kind == RoadUserType.PEDESTRIAN:
            walk = self._walk(lane.edge, points)
            insert_pedestrian(self._api, user, SUMO_TEMPLATES[kind], lane.edge, offset, walk)
            return
        edges = self._drive(lane.edge, points, SUMO_TEMPLATES[kind])
        route = f"{user}:{self._random.integers(2**62)}"
        insert_vehicle(self._api, user, route, edges, SUMO_TEMPLATES[kind], lane.id, offset)

    def _drive(self, edge: str, points: LanePoints, kind: str) -> tuple[str, ...]:
        for _ in range(DESTINATION_ATTEMPTS):
            edges = find_route(self._api, edge, self._somewhere(points), kind)
            if edges:
                return edges
        return (edge,)

    def _walk(self, edge: str, points: LanePoints) -> tuple[StageRecord, ...]:
        for _ in range(DESTINATION_ATTEMPTS):
            stages = find_walk(self._api, edge, self._somewhere(points))
            if stages:
                return stages
        return ()

    def _somewhere(self, points: LanePoints) -> str:
        return points.lanes[self._random.integers(len(points.lanes))].edge


def measure_plain(work: Workload) -> Generator[None, None, float]:
    """Updates of road users per second of SUMO's steps, in this process: of `work.agents` road users of SUMO's own and
    those of the scenario. Yields once after the warm-up.

    Raises InputError if the scenario has no room for them, SumoError if SUMO fails.
    """
    rates: list[float] = []
    with SumoSession(find_scenario(work.scenario), seed=work.seed) as session:
        traffic = _Traffic(session, work)
        for number in range(WARM_UP_STEPS + work.steps * session.substeps):
            if number == WARM_UP_STEPS:
                yield
            begin = perf_counter()
            session.step()
            seconds = perf_counter() - begin
            if number >= WARM_UP_STEPS:
                rates.append(loaded_count(session.api) / seconds)
            traffic.renew()
    return statistics.median(rates)
