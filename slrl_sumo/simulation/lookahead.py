"""What each mode of a road user would lead to in the next seconds, if all others went on as they are."""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.perception.observation import Observation, Way
from slrl_sumo.simulation.agility import Agility
from slrl_sumo.simulation.courses import HELD, MARGIN, STEPS, Courses, courses, meeting
from slrl_sumo.simulation.leaders import Leaders
from slrl_sumo.simulation.tally import OWN_SURFACE
from slrl_sumo.world.geometry import Floats, cos_sin, wrap_angle
from slrl_sumo.world.roadmap import RoadMap
from slrl_sumo.world.route import HERE, POINTS, SPACING, RouteAhead, at, on_path
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL, RoadUserType

NEAR = 3
"""Intervals, 1.2 s, in which who has a route must not leave its surface: later it turns with its path."""
REACH = 30.0
"""m within which others are looked at."""
STEERED = 2
"""Intervals after which it is seen whether a mode leads back to the path."""
RETURN = 1.0
"""1/s, and m/s, rad: who is beside its path heads back to it with atan(RETURN * aside / (speed + SLOW)), at most AIM
(as in S. Thrun et al. 2006, Stanley, https://doi.org/10.1002/rob.20147)."""
SLOW, AIM = 1.5, 0.4
BESIDE, ASKEW = 1.0, 0.35
"""m and rad: who is farther off its path in both is led on as it is, not along the path."""
CALM = 0.5
"""Share of the way there is within which it wants to be able to stop."""
SPARE = 1.5
"""m before a line to stop at, for who does not stop to the centimetre."""
AT = 0.3
"""m within which somebody is at the place to stop at."""
TOO_MUCH = 8.0
"""At most so many times as much."""
GAP = np.array([1.5, 1.5, 0.4])
"""m that each type keeps behind a leader."""
HEADWAY = 0.5
"""s of it."""
LEADER_BRAKES = 4.0
"""m/s² with which a leader is expected to brake at most."""


@dataclass(frozen=True, eq=False)
class Lookahead:
    """For n road users and all their modes, (n, modes) each."""

    meeting: Floats
    """0 where nobody is met within STEPS, up to 1 where somebody is met at once."""
    off_surface: Floats
    """Share of the STEPS off the own surface; of the first NEAR ones for who has a route."""
    speed: Floats
    """m/s after HELD intervals."""
    turn: Floats
    """rad turned after HELD intervals."""
    route: "OnRoute | None" = None
    touching: Floats | None = None
    """As `meeting`, on the very course of the mode, also for who keeps to a path; where it was asked for."""


@dataclass(frozen=True, eq=False)
class OnRoute:
    """The same for road users with a route; zeros for those without."""

    steer: Floats
    """rad between the heading after STEERED intervals and the one that leads back to the path."""
    aside: Floats
    """m beside the path then."""
    pace: Floats
    """Speed after STEERED intervals relative to the desired one, or to that from which it still stops where it must, if
    that is lower: -1 at none, 1 at twice of it or more."""
    brake: Floats
    """After one interval, the way to a stand relative to the way to where it must stop: from 1 on it is too late. Up to
    TOO_MUCH."""
    follow: Floats
    """The same for who is ahead on the path."""


@dataclass(frozen=True, eq=False)
class Prospects:
    """What is known of routes when modes are looked at: of the first road users of a world, who are the learned."""

    route: RouteAhead
    leaders: Leaders
    able: Agility

    @property
    def way(self) -> Way:
        """The same as perception has it."""
        return Way(self.route, self.leaders.gap, self.leaders.speed)

    def take(self, rows: NDArray[np.intp]) -> "Prospects":
        """Those of the learned road users `rows`."""
        return Prospects(self.route.take(rows), Leaders(self.leaders.gap[rows], self.leaders.speed[rows]), self.able)


def look_ahead(
    bundle: ModelBundle,
    observation: Observation,
    world: WorldState,
    rows: NDArray[np.intp],
    roadmap: RoadMap,
    prospects: Prospects | None = None,
    *,
    touching: bool = False,
) -> Lookahead:
    """What every mode leads to, for the n road users `rows` of `world`, which made `observation`.

    Each of them alone follows a mode as `advance` would move it; the others keep speed and yaw rate. With `prospects`
    vehicles that have a route follow it, at the speeds of the mode: where they meet somebody does not depend on how
    they turn in the next moment. With `touching` it is also looked whom they meet if they do not.
    """
    n, me = len(observation), world.take(rows)
    with torch.inference_mode():
        motions = bundle.displacement.motion_all(*tensors(observation))
        acceleration, yaw_rate = (motion.double().numpy() for motion in motions)
    free = courses(me, acceleration, yaw_rate, bundle.max_speed[me.type, None], halting=prospects is not None)
    known = steered = np.zeros(n, np.bool_)
    margin = np.full_like(MARGIN, MARGIN.max()) if prospects is None else MARGIN
    kept = None if prospects is None else _paths_kept(prospects.route, world)
    theirs = _led_on(world, kept, margin)
    on_paths = free
    mine = fits = None
    if prospects is not None and kept is not None:
        mine, known = prospects.take(rows), prospects.route.known[rows]
        own, steered = kept.of(rows)
        on_paths = _steered(free, own, steered)
        fits = _on_route(mine, me, free)
    off = _off_surface(free, me, roadmap, None if mine is None else mine.route)
    everyone = cKDTree(np.column_stack([world.x, world.y]))
    pairs = cKDTree(np.column_stack([me.x, me.y])).sparse_distance_matrix(everyone, REACH, output_type="ndarray")
    ego, other = pairs["i"], pairs["j"]
    others = rows[ego] != other
    # A vehicle that stands by then is run into, and could not help it by driving on. Nor can it help who comes from
    # behind, or stands beside the rear that swings out in a turn. Pedestrians step aside.
    size = np.column_stack([me.length, me.width]) + margin[me.type, None]
    met = meeting(on_paths, size, steered, theirs, ego[others], other[others])
    touched = meeting(free, size, steered, theirs, ego[others], other[others]) if touching else None
    looked = np.where(known, NEAR, STEPS)
    turned = HELD * DECISION_INTERVAL * yaw_rate
    return Lookahead(met, off / looked[:, None], free.speed[:, HELD - 1], turned, fits, touched)


def _off_surface(mine: Courses, me: WorldState, roadmap: RoadMap, route: RouteAhead | None) -> NDArray[np.intp]:
    """In how many intervals, NEAR for who has a route, each mode is off the own surface, (n, modes)."""
    off = np.zeros(mine.x.shape, np.bool_)
    known = np.zeros(len(me), np.bool_) if route is None else route.known
    user, step = np.nonzero(np.arange(STEPS) < np.where(known, NEAR, STEPS)[:, None])
    x, y = mine.x[user, step], mine.y[user, step]
    surface = roadmap.surface_at(x.ravel(), y.ravel()).reshape(x.shape)
    outside = ~OWN_SURFACE[me.type[user, None], surface]
    if route is not None:
        # Paths lead off the ground where the network ends: who follows them there is right.
        row, mode = np.nonzero(outside & known[user, None])
        who = user[row]
        place = HERE + np.rint(mine.way[who, step[row], mode] / SPACING).astype(np.intp)
        there = who, np.minimum(place, POINTS - 1)
        under = roadmap.surface_at(route.x[there], route.y[there])
        outside[row, mode] = OWN_SURFACE[me.type[who], under]
    off[user, step] = outside
    return np.asarray(off.sum(axis=1), np.intp)


def _steered(free: Courses, kept: "_Kept", steered: NDArray[np.bool_]) -> Courses:
    """`free`, but along the paths of those that are `steered`, (n,), the rows of `kept`."""
    if not len(kept.rows):
        return free
    x, y, heading = free.x.copy(), free.y.copy(), free.heading.copy()
    x[steered], y[steered], heading[steered] = _along(kept, free.way[steered])
    return replace(free, x=x, y=y, heading=heading)


def _on_route(mine: Prospects, me: WorldState, free: Courses) -> OnRoute:
    """How the modes of n road users fit their routes."""
    route, known = mine.route, mine.route.known[:, None]
    speed, heading = free.speed[:, STEERED - 1], free.heading[:, STEERED - 1]
    _, aside, direction = on_path(route, free.x[:, STEERED - 1], free.y[:, STEERED - 1])
    aim = np.clip(np.arctan2(RETURN * aside, speed + SLOW), -AIM, AIM)
    steer = np.abs(wrap_angle(heading - direction + aim))
    first = free.speed[:, 0]
    stopping = mine.able.stop_from(first, me.type)
    stop, room = (way[:, None] for way in _ways_left(mine, me))
    brake = strain(stopping, stop - first * DECISION_INTERVAL)
    leading = mine.leaders.speed[:, None]
    follow = strain(stopping, room + (leading - (1.0 + HEADWAY / DECISION_INTERVAL) * first) * DECISION_INTERVAL)
    covered = (first + speed) * DECISION_INTERVAL
    room = room + 2.0 * leading * DECISION_INTERVAL
    allowed = mine.able.speed_within(CALM * (np.minimum(stop, room - HEADWAY * speed) - covered), me.type)
    allowed = np.minimum(allowed, route.desired[:, None])
    pace = np.clip((speed - allowed) / np.maximum(allowed, 1.0), -1.0, 1.0)
    columns = (steer, np.clip(aside, -5.0, 5.0), pace, brake, follow)
    return OnRoute(*(np.where(known, column, 0.0) for column in columns))


def follows(beside: Floats, askew: Floats) -> NDArray[np.bool_]:
    """Who is on its path, or goes back to it, so that it will be found there, (n,); m beside it and rad off its
    direction, (n,)."""
    return (np.abs(beside) < BESIDE) | (np.abs(wrap_angle(askew)) < ASKEW)


def allowed_speed(prospects: Prospects, users: WorldState) -> Floats:
    """m/s at which each of n road users with a route may go on: desired, and low enough to stop where it must, (n,)."""
    stop, room = _ways_left(prospects, users)
    distance = np.minimum(stop, room - HEADWAY * users.speed)
    within = prospects.able.speed_within(CALM * np.maximum(distance, 0.0)[:, None], users.type)[:, 0]
    return np.minimum(within, prospects.route.desired)


def _ways_left(prospects: Prospects, users: WorldState) -> tuple[Floats, Floats]:
    """m to where n road users must stop, and m in which they must be able to stop behind their leaders, (n,) each."""
    stop = kept_clear(prospects.route, prospects.leaders, users.length) - SPARE
    room = prospects.leaders.gap - GAP[users.type] + prospects.leaders.speed**2 / (2.0 * LEADER_BRAKES)
    return stop, room


def strain(stopping: Floats, distance: Floats) -> Floats:
    """The way to a stand (m) relative to the way there is (m): 1 is just possible; up to TOO_MUCH."""
    return np.minimum(stopping / np.maximum(distance, AT), TOO_MUCH)


def kept_clear(route: RouteAhead, leaders: Leaders, length: Floats) -> Floats:
    """m to where n road users must stop: as their routes say, and before junctions whose exits are taken."""
    blocked = (
        (leaders.speed < 1.0) & (leaders.gap > route.line) & (leaders.gap < route.out + length + GAP[RoadUserType.CAR])
    )
    blocked &= (route.line > 1.0) & np.isfinite(route.line) & np.isfinite(route.out)
    return np.where(blocked, np.minimum(route.stop, route.line - 1.0), route.stop)


def with_ahead(
    bundle: ModelBundle,
    observation: Observation,
    world: WorldState,
    rows: NDArray[np.intp],
    roadmap: RoadMap,
    prospects: Prospects | None = None,
) -> Observation:
    """`observation` with what every mode leads to: its `ahead` has the fields of Lookahead and, with `prospects`, of
    OnRoute, in m/s, rad and m."""
    return told(observation, look_ahead(bundle, observation, world, rows, roadmap, prospects))


def told(observation: Observation, ahead: Lookahead) -> Observation:
    """`observation` with `ahead` as columns."""
    columns = [ahead.meeting, ahead.off_surface, ahead.speed, ahead.turn]
    if (route := ahead.route) is not None:
        columns += [route.steer, route.aside, route.pace, route.brake, route.follow]
    return replace(observation, ahead=np.stack(columns, axis=-1).astype(np.float32))


@dataclass(frozen=True, eq=False)
class _Kept:
    """Vehicles that keep to their paths: their rows, their paths, and m beside them now, (k,)."""

    rows: NDArray[np.intp]
    path: RouteAhead
    beside: Floats

    def of(self, rows: NDArray[np.intp]) -> tuple["_Kept", NDArray[np.bool_]]:
        """Those among the road users `rows` (n,), in that order, and which of `rows` they are, (n,)."""
        index = np.full(max(rows.max(initial=-1), self.rows.max(initial=-1)) + 1, -1)
        index[self.rows] = np.arange(len(self.rows))
        chosen = index[rows]
        there = chosen >= 0
        if there.all() and len(rows) == len(self.rows):
            return self, there
        some = chosen[there]
        return _Kept(self.rows[some], self.path.take(some), self.beside[some]), there


def _paths_kept(route: RouteAhead, users: WorldState) -> _Kept:
    """Who of the first road users of `users`, those of `route`, keeps to its path."""
    n = len(route)
    rows = np.flatnonzero(route.known & (users.type[:n] != RoadUserType.PEDESTRIAN))
    _, beside, direction = (c[:, 0] for c in on_path(route, users.x[rows, None], users.y[rows, None], rows))
    keeps = follows(beside, users.heading[rows] - direction)
    return _Kept(rows[keeps], route.take(rows[keeps]), beside[keeps])


_BACK = np.maximum(0.0, 1.0 - np.arange(1, STEPS + 1) / STEPS)[:, None]
"""How far who is beside its path still is after each interval, (STEPS, 1)."""


def _along(kept: _Kept, way: Floats) -> tuple[Floats, Floats, Floats]:
    """Positions (m) and headings (rad) `way` (k, STEPS, m) metres along the paths after each interval, in which who is
    beside its path comes back to it: (k, STEPS, m) each."""
    row = math.prod(way.shape[1:])
    x, y, direction = (column.reshape(way.shape) for column in at(kept.path, way.reshape(len(way), row)))
    shift = kept.beside[:, None, None] * _BACK
    c, s = cos_sin(direction)
    return x - shift * s, y + shift * c, direction


def _led_on(world: WorldState, kept: _Kept | None, margin: Floats) -> Floats:
    """Boxes (m, STEPS, 5), `margin` of their type larger, after each interval at constant speed and yaw rate.

    Vehicles that keep to their paths follow them, up to lines at which they must stop.
    """
    seconds = DECISION_INTERVAL * np.arange(1, STEPS + 1)
    boxes = np.empty((len(world), STEPS, 5))
    turn, way = world.yaw_rate[:, None] * seconds, world.speed[:, None] * seconds
    c, s = cos_sin(world.heading[:, None] + 0.5 * turn)
    boxes[..., 0] = world.x[:, None] + way * c
    boxes[..., 1] = world.y[:, None] + way * s
    boxes[..., 2] = world.heading[:, None] + turn
    room = margin[world.type, None]
    boxes[..., 3], boxes[..., 4] = world.length[:, None] + room, world.width[:, None] + room
    if kept is not None:
        rows = kept.rows
        driven = np.minimum(way[rows], np.maximum(kept.path.stop, 0.0)[:, None])
        for column, values in enumerate(_along(kept, driven[..., None])):
            boxes[rows, :, column] = values[..., 0]
    return boxes
