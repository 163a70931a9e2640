"""Background road users in the world state, and the rows of the trace."""

from dataclasses import replace

import numpy as np

from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.scene.geometry import wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import PEDESTRIAN
from slrl_sumo.sumo.reader import Snapshot


def background_world(snapshot: Snapshot, time: float, skip: frozenset[str]) -> WorldState:
    """The road users of `snapshot` that are not in `skip`, at `time` (s); accelerations and yaw rates are 0."""
    kept = [i for i, road_user in enumerate(snapshot.ids) if road_user not in skip]
    rows, none = np.array(kept, np.intp), np.zeros(len(kept))
    return WorldState(
        time=time,
        ids=tuple([snapshot.ids[i] for i in kept]),
        type=snapshot.type[rows],
        x=snapshot.x[rows],
        y=snapshot.y[rows],
        heading=snapshot.heading[rows],
        speed=snapshot.speed[rows],
        acceleration=none,
        yaw_rate=none,
        length=snapshot.length[rows],
        width=snapshot.width[rows],
        learned=np.zeros(len(rows), np.bool_),
    )


class Differences:
    """Accelerations and yaw rates of successive worlds, by differences between them."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[float, float]] = {}
        self._time = 0.0

    def complete(self, world: WorldState) -> WorldState:
        """`world` with accelerations (m/s²) and yaw rates (rad/s) since the last call; 0 for new road users."""
        now = dict(zip(world.ids, zip(world.speed.tolist(), world.heading.tolist(), strict=True), strict=True))
        before = np.array([self._last.get(i, now[i]) for i in world.ids], np.float64).reshape(-1, 2)
        dt = max(world.time - self._time, 1e-3)
        self._last, self._time = now, world.time
        return replace(
            world,
            acceleration=(world.speed - before[:, 0]) / dt,
            yaw_rate=wrap_angle(world.heading - before[:, 1]) / dt,
        )


def places_of(learned: WorldState, sumo_types: tuple[str, ...], background: WorldState, snapshot: Snapshot) -> Places:
    """Lane, position and vType in the trace of each road user of `learned` and `background`, in this order."""
    spawned = snapshot.spawned
    where = {road_user: i for i, road_user in enumerate((*snapshot.ids, *spawned.vehicles))}
    own = np.array([where.get(road_user, -1) for road_user in learned.ids], np.intp)
    # SUMO's lane is valid only if SUMO has the road user at its learned position, not while SUMO holds it elsewhere.
    known = np.flatnonzero(own >= 0)
    rows = own[known]
    x, y = np.append(snapshot.x, spawned.front_x), np.append(snapshot.y, spawned.front_y)
    # Of spawned vehicles SUMO's front is known, of others the centre.
    ahead, heading = np.where(rows < len(snapshot.ids), 0.0, 0.5 * learned.length[known]), learned.heading[known]
    away_x = x[rows] - (learned.x[known] + ahead * np.cos(heading))
    away_y = y[rows] - (learned.y[known] + ahead * np.sin(heading))
    away = np.abs(away_x) + np.abs(away_y)
    own[known[~(away < 0.1)]] = -1
    here, theirs = own.tolist(), [where[road_user] for road_user in background.ids]
    # Row -1 is the place of the road users that SUMO does not have here.
    lanes = (*snapshot.lane, *spawned.lane, "")
    positions = np.concatenate([snapshot.lane_position, spawned.lane_position, [0.0]])
    return Places(
        sumo_type=sumo_types + tuple([snapshot.sumo_type[row] for row in theirs]),
        lane=tuple([lanes[row] for row in here + theirs]),
        lane_position=positions[here + theirs],
        person=np.concatenate([learned.type == PEDESTRIAN, snapshot.person[theirs].astype(np.bool_)]),
    )
