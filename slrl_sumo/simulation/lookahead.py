"""What each mode of a road user would lead to in the next seconds, if all others went on as they are."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.perception.observation import Observation, Way
from slrl_sumo.simulation.agility import Agility
from slrl_sumo.simulation.leaders import Leaders
from slrl_sumo.simulation.tally import OWN_SURFACE
from slrl_sumo.world.advance import halting
from slrl_sumo.world.geometry import Floats, boxes_overlap, to_ego, wrap_angle
from slrl_sumo.world.roadmap import RoadMap
from slrl_sumo.world.route import HERE, POINTS, SPACING, RouteAhead, at, on_path
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL, RoadUserType

STEPS = 8
"""Intervals that are looked ahead: 3.2 s."""
HELD = 5
"""Intervals for which a mode's acceleration and yaw rate are kept up; then speed and heading stay."""
NEAR = 3
"""Intervals, 1.2 s, in which who has a route must not leave its surface: later it turns with its path."""
MARGIN = np.array([0.4, 0.4, 0.15])
"""m that boxes of each type are enlarged by, half on each side: cars meet below 0.4 m between them, pedestrians
0.15 m. Without routes 0.4 for all: selectors of the preset `paper` learned with that."""
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
STANDING = 0.2
"""m/s."""
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
) -> Lookahead:
    """What every mode leads to, for the n road users `rows` of `world`, which made `observation`.

    Each of them alone follows a mode as `advance` would move it; the others keep speed and yaw rate. With `prospects`
    vehicles that have a route follow it, at the speeds of the mode: where they meet somebody does not depend on how
    they turn in the next moment.
    """
    n, me = len(observation), world.take(rows)
    with torch.inference_mode():
        motions = bundle.displacement.motion_all(*tensors(observation))
        acceleration, yaw_rate = (motion.double().numpy() for motion in motions)
    modes = acceleration.shape[1]
    top = bundle.max_speed[me.type, None]
    x, y, heading, speed = (np.repeat(column[:, None], modes, axis=1) for column in (me.x, me.y, me.heading, me.speed))
    margin = np.full_like(MARGIN, MARGIN.max()) if prospects is None else MARGIN
    room = margin[me.type]
    length, width = (np.repeat((column + room)[:, None], modes, axis=1) for column in (me.length, me.width))
    own = OWN_SURFACE[me.type]
    everyone = cKDTree(np.column_stack([world.x, world.y]))
    pairs = cKDTree(np.column_stack([me.x, me.y])).sparse_distance_matrix(everyone, REACH, output_type="ndarray")
    ego, other = pairs["i"], pairs["j"]
    ego, other = ego[rows[ego] != other], other[rows[ego] != other]
    reach = np.hypot(world.length, world.width)
    meeting, off = np.zeros((n, modes)), np.zeros((n, modes))
    final_speed, turned = speed, np.zeros((n, modes))
    mine = None if prospects is None else prospects.take(rows)
    steered = known = np.zeros(n, np.bool_)
    everybody = None if prospects is None else _paths_kept(prospects.route, world)
    if mine is not None:
        known = mine.route.known
        kept = _paths_kept(mine.route, me)
        steered[kept.rows] = True
        travelled = np.zeros((n, modes))
        under = roadmap.surface_at(mine.route.x.ravel(), mine.route.y.ravel()).reshape(n, POINTS)
        grounded = np.take_along_axis(own, under.astype(np.intp), axis=1) | ~known[:, None]
        after: list[tuple[Floats, Floats, Floats, Floats]] = []
    looked = np.where(known, NEAR, STEPS)
    for step in range(1, STEPS + 1):
        if step <= HELD:
            felt = acceleration if prospects is None else halting(speed, acceleration, DECISION_INTERVAL)
            speed = np.clip(speed + felt * DECISION_INTERVAL, 0.0, top)
            turn = yaw_rate * DECISION_INTERVAL
            final_speed, turned = speed, turned + turn
        else:
            turn = np.zeros_like(yaw_rate)
        middle = heading + 0.5 * turn
        x, y = x + speed * DECISION_INTERVAL * np.cos(middle), y + speed * DECISION_INTERVAL * np.sin(middle)
        heading = wrap_angle(heading + turn)
        look = np.flatnonzero(step <= looked)
        surface = roadmap.surface_at(x[look].ravel(), y[look].ravel()).reshape(len(look), modes)
        outside = ~np.take_along_axis(own[look], surface.astype(np.intp), axis=1)
        if mine is not None:
            # Paths lead off the ground where the network ends: who follows them there is right.
            place = HERE + np.rint((travelled[look] + speed[look] * DECISION_INTERVAL) / SPACING).astype(np.intp)
            outside &= np.take_along_axis(grounded[look], np.minimum(place, POINTS - 1), axis=1)
        off[look] += outside
        at_x, at_y, at_heading = x, y, heading
        if mine is not None:
            travelled = travelled + speed * DECISION_INTERVAL
            after.append((x, y, heading, speed))
            if len(kept.rows):
                at_x, at_y, at_heading = x.copy(), y.copy(), heading.copy()
                at_x[steered], at_y[steered], at_heading[steered] = _along(kept, travelled[steered], step)
        them = _led_on(world, step, everybody, margin)
        # Whose circles do not meet under any mode need not be compared box by box.
        spread = np.hypot(at_x[ego] - them[other, None, 0], at_y[ego] - them[other, None, 1]).min(axis=1)
        close = spread < 0.5 * (reach[rows[ego]] + reach[other]) + 2 * MARGIN.max()
        e, o = ego[close], other[close]
        boxes = np.stack([at_x[e], at_y[e], at_heading[e], length[e], width[e]], axis=-1).reshape(-1, 5)
        hit = boxes_overlap(boxes, np.repeat(them[o], modes, axis=0)).reshape(-1, modes)
        if mine is not None:
            # A vehicle that stands by then is run into, and could not help it by driving on.
            # Nor can it help who comes from behind, or stands beside the rear that swings out in a turn. Pedestrians
            # step aside.
            ahead, _ = to_ego(them[o, None, 0] - at_x[e], them[o, None, 1] - at_y[e], at_heading[e])
            hit &= ((speed[e] > STANDING) & (ahead > 0.0)) | ~steered[e, None]
        weight = 1.0 - (step - 1) / STEPS
        np.maximum.at(meeting, e, hit * weight)
    fits = None if mine is None else _on_route(mine, me, after)
    return Lookahead(meeting, off / looked[:, None], final_speed, turned, fits)


def _on_route(mine: Prospects, me: WorldState, after: list[tuple[Floats, Floats, Floats, Floats]]) -> OnRoute:
    """How the modes of n road users fit their routes; `after`: positions, headings and speeds after each interval."""
    route, known = mine.route, mine.route.known[:, None]
    x, y, heading, speed = after[STEERED - 1]
    _, aside, direction = on_path(route, x, y)
    aim = np.clip(np.arctan2(RETURN * aside, speed + SLOW), -AIM, AIM)
    steer = np.abs(wrap_angle(heading - direction + aim))
    first = after[0][3]
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
    ahead = look_ahead(bundle, observation, world, rows, roadmap, prospects)
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


def _paths_kept(route: RouteAhead, users: WorldState) -> _Kept:
    """Who of the first road users of `users`, those of `route`, keeps to its path."""
    n = len(route)
    rows = np.flatnonzero(route.known & (users.type[:n] != RoadUserType.PEDESTRIAN))
    _, beside, direction = (c[:, 0] for c in on_path(route.take(rows), users.x[rows, None], users.y[rows, None]))
    keeps = follows(beside, users.heading[rows] - direction)
    return _Kept(rows[keeps], route.take(rows[keeps]), beside[keeps])


def _along(kept: _Kept, way: Floats, step: int) -> tuple[Floats, Floats, Floats]:
    """Positions (m) and headings (rad) `way` (k, m) metres along the paths, after `step` intervals, in which who is
    beside its path comes back to it: (k, m) each."""
    x, y, direction = at(kept.path, way)
    shift = kept.beside[:, None] * max(0.0, 1.0 - step / STEPS)
    return x - shift * np.sin(direction), y + shift * np.cos(direction), direction


def _led_on(world: WorldState, step: int, kept: _Kept | None, margin: Floats) -> Floats:
    """Boxes (m, 5), `margin` of their type larger, after `step` intervals at constant speed and yaw rate.

    Vehicles that keep to their paths follow them, up to lines at which they must stop.
    """
    seconds = step * DECISION_INTERVAL
    turn = world.yaw_rate * seconds
    middle = world.heading + 0.5 * turn
    x = world.x + world.speed * seconds * np.cos(middle)
    y = world.y + world.speed * seconds * np.sin(middle)
    heading = world.heading + turn
    if kept is not None:
        rows = kept.rows
        way = np.minimum(world.speed[rows] * seconds, np.maximum(kept.path.stop, 0.0))
        x[rows], y[rows], heading[rows] = (column[:, 0] for column in _along(kept, way[:, None], step))
    room = margin[world.type]
    return np.column_stack([x, y, heading, world.length + room, world.width + room])
