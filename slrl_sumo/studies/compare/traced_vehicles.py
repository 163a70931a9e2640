"""The vehicles of a trace by their types: desired speeds and emissions."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.trajectories import Trajectories, road_users
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import SPAWNED_PREFIX, RoadUserType
from slrl_sumo.studies.compare.run import Record, emitted
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import LanePoints
from slrl_sumo.sumo.road_users import Motor
from slrl_sumo.sumo.spawned import SUMO_TEMPLATES

TRACE_POINT_SPACING = 2.0
"""Spacing (m) of lane points."""


@dataclass(frozen=True)
class TracedVehicles:
    """A trace, and the types of its vehicles."""

    tracks: Trajectories
    vtypes: Mapping[str, str]
    """Vehicle type id of each vehicle, by its id."""
    motors: Mapping[str, Motor]
    """By vehicle type id: SUMO's default types, and those of the scenario where one is known."""

    @cached_property
    def types(self) -> tuple[str, ...]:
        """Vehicle type id of each track, (T,), '' of pedestrians. SUMO marks types of changed vehicles by "@"; those of
        learned road users, and of vehicles without a type, count as its default types."""
        names = []
        for road_user, kind in zip(road_users(self.tracks.ids), self.tracks.type.tolist(), strict=True):
            vtype = self.vtypes.get(road_user, "").partition("@")[0]
            usual = not vtype or vtype.startswith(SPAWNED_PREFIX)
            names.append("" if kind == RoadUserType.PEDESTRIAN else SUMO_TEMPLATES[kind] if usual else vtype)
        return tuple(names)

    @property
    def unknown(self) -> frozenset[str]:
        """Vehicle types that neither SUMO nor the scenario defines."""
        return frozenset(self.types) - frozenset(self.motors) - {""}

    def desired_speed(self, network: Network) -> Floats:
        """m/s of each row, (R,): the limit of the lane, at most the top speed of the vehicle type; 0 of pedestrians."""
        tracks = self.tracks
        lanes = [lane for lane in network.lanes if lane.allowed - {"pedestrian"} and len(lane.shape) > 1]
        points = LanePoints(lanes, TRACE_POINT_SPACING)
        tops = [
            0.0 if not vtype else self.motors.get(vtype, self.motors[SUMO_TEMPLATES[kind]]).max_speed
            for vtype, kind in zip(self.types, tracks.type.tolist(), strict=True)
        ]
        desired = np.array(tops)[tracks.track]
        rows = np.flatnonzero(desired > 0.0)
        if len(points) and len(rows):
            near = points.along(tracks.x[rows], tracks.y[rows], tracks.heading[rows])
            desired[rows] = np.minimum(desired[rows], points.max_speed(near.own(near.rows)))
        return desired

    def emissions(self) -> Record:
        """See `run.emitted`; empty where no vehicle's type is known."""
        tracks = self.tracks
        motion: dict[str, list[NDArray[np.float64]]] = {}
        for track, vtype in enumerate(self.types):
            if vtype in self.motors:
                rows = slice(*tracks.starts[track : track + 2].tolist())
                some = np.column_stack([tracks.speed[rows], tracks.acceleration[rows]])
                motion.setdefault(self.motors[vtype].emission_class, []).append(some)
        return emitted({name: np.concatenate(parts) for name, parts in motion.items()}) if motion else {}


def unknown_types(traced: Iterable[TracedVehicles]) -> list[str]:
    """Notice on unknown vehicle types."""
    unknown = sorted(frozenset[str]().union(*(each.unknown for each in traced)))
    if not unknown:
        return []
    listed = f"{', '.join(unknown[:5])}{f' and {len(unknown) - 5} more' * (len(unknown) > 5)}"
    return [
        f"the vehicle types {listed} are unknown here: no emissions of theirs are counted, and their top speed is that "
        "of SUMO's default type; give a scenario that defines them in place of the network"
    ]
