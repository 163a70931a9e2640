"""What the road says to vehicles that we move: signals, leaders, speed limits. SUMO enforces none of them there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.sumo.api import SumoApi

LEADER_RANGE = 50.0
"""m within which a leader is looked for."""


@dataclass(frozen=True)
class TrafficAhead:
    """For n vehicles; where a mask is False, the values that belong to it are 0."""

    has_signal: NDArray[np.bool_]
    """A signal controls the next junction on the vehicle's route, (n,)."""
    signal_distance: Floats
    """m from the front bumper to the stop line, (n,)."""
    signal_red: NDArray[np.bool_]
    """Red, also with yellow (SUMO's states r, u), (n,)."""
    signal_yellow: NDArray[np.bool_]
    """Yellow (y, Y), (n,)."""
    has_leader: NDArray[np.bool_]
    """SUMO knows a vehicle ahead on the vehicle's lanes within 50 m, (n,)."""
    leader_gap: Floats
    """m from the front bumper to the leader's rear, less the vehicle's minGap, as SUMO gives it, (n,)."""
    leader_speed: Floats
    """m/s, (n,)."""
    has_limit: NDArray[np.bool_]
    """SUMO has the vehicle on a lane, (n,)."""
    speed_limit: Floats
    """Of that lane, m/s, (n,)."""


def traffic_ahead(api: SumoApi, vehicles: Sequence[str]) -> TrafficAhead:
    """Read signals, leaders and limits of vehicles (not persons) through `api` (libsumo or a TraCI connection).

    Signals and leaders are known for vehicles with a route, so for those that are taken over; road users that we added
    have no route, and only their limit is known. About 5 us a vehicle with libsumo.
    """
    n = len(vehicles)
    signal, leader, limit = np.zeros((n, 3)), np.zeros((n, 2)), np.zeros(n)
    has_signal, has_leader, has_limit = (np.zeros(n, np.bool_) for _ in range(3))
    for row, vehicle in enumerate(vehicles):
        lane = api.vehicle.getLaneID(vehicle)
        if not lane:
            continue
        has_limit[row], limit[row] = True, api.lane.getMaxSpeed(lane)
        signals = api.vehicle.getNextTLS(vehicle)
        if signals:
            _, _, distance, state = signals[0]
            has_signal[row], signal[row] = True, (distance, state in "ru", state in "yY")
        ahead = api.vehicle.getLeader(vehicle, LEADER_RANGE)
        if ahead and ahead[0]:
            has_leader[row], leader[row] = True, (ahead[1], api.vehicle.getSpeed(ahead[0]))
    return TrafficAhead(
        has_signal=has_signal,
        signal_distance=signal[:, 0],
        signal_red=signal[:, 1] > 0,
        signal_yellow=signal[:, 2] > 0,
        has_leader=has_leader,
        leader_gap=leader[:, 0],
        leader_speed=leader[:, 1],
        has_limit=has_limit,
        speed_limit=limit,
    )
