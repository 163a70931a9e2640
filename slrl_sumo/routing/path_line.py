"""The line that a vehicle follows along its lanes."""

import math
from collections.abc import Mapping, Sequence

from slrl_sumo.routing.junctions.bent_lane import is_bent
from slrl_sumo.routing.polyline import Polyline, direction_between, line_through
from slrl_sumo.routing.short_lanes import curve_over
from slrl_sumo.sumo.network.lanes import Lane, neighbour

PARALLEL = 0.35
"""Greatest angle (rad) between a lane and a next lane that begins beside it; a connection at a greater angle to both
lanes leads aside."""
BESIDE, WIDEST = 0.5, 12.0
"""Least and greatest distance (m) between a lane and a next lane that begins beside it: up to three lanes, such as
where turn lanes are added on both sides. With at most one lane, cars on an arterial that shifts by two lanes braked
from 16.7 to 4.4 m/s."""
SIDEWAYS = 1.5
"""Lateral speed (m/s) at which vehicles move to such a lane: 3.2 m within 2.1 s."""
VIEW = 4.0
"""Extension (m) of a line beyond its end, so that vehicles see road users that cross there."""


def path_line(
    lanes: Sequence[Lane], before: Sequence[tuple[float, float]], network: Mapping[str, Lane]
) -> tuple[Polyline, tuple[float, ...]]:
    """A line along `lanes` of a `network` (by id), and the position (m along the line) of the end of each lane.

    `before`: points before the first lane, for the rear of a vehicle that has just entered the lane.
    """
    points, last, k = list(before), list[int](), 0
    while k < len(lanes):
        if (curve := curve_over(lanes, k)) is None:
            points += _eased(points, lanes[k], lanes[k + 1] if k + 1 < len(lanes) else None, network)
            last.append(len(points) - 1)
            k += 1
            continue
        # A vehicle passes the line at the end of a lane where the curve is nearest to it.
        bend, begin = line_through([points[-1], *curve.points])[0], 0.0
        for lane in lanes[k : curve.after]:
            end = bend.nearest(*lane.points[-1], begin)[0]
            points += bend.between(begin, end)[1:]
            last.append(len(points) - 1)
            begin = end
        points += [*bend.between(begin, bend.end)[1:], *curve.rest[1:]]
        last.append(len(points) - 1)
        k = curve.after + 1
    points.append(_beyond(points))
    line, along = line_through(points)
    return line, tuple(along[i] for i in last)


def _eased(
    points: list[tuple[float, float]], lane: Lane, following: Lane | None, network: Mapping[str, Lane]
) -> Sequence[tuple[float, float]]:
    """The points of a lane that continue `points` without a jump to the side.

    The line reaches a lane that begins beside the previous lane, such as an exit lane, at SIDEWAYS, as in a lane
    change. SUMO's internal lanes of such junctions shift within 3 m.
    """
    shape = lane.points
    if len(points) < 2 or len(shape) < 2:
        return shape
    here = direction_between(points[-2], points[-1])
    if not lane.internal:
        aside = _beside(points[-1], here, lane, network)
        if not aside:
            return shape
        line, _ = line_through(shape)
        return [points[-1], *line.between(min(aside / SIDEWAYS * lane.max_speed, 0.5 * line.end), line.end)]
    (x0, y0), (x1, y1) = points[-1], shape[-1]
    along = (x1 - x0) * math.cos(here) + (y1 - y0) * math.sin(here)
    ahead = x0 + along * math.cos(here), y0 + along * math.sin(here)
    if following is None or along < 0.0:
        return shape
    aside, over = _beside(ahead, here, following, network), SIDEWAYS * along / lane.max_speed
    if aside <= max(along * math.tan(PARALLEL), over) or not _have_room(ahead, lane, following, network):
        return shape
    # The shift begins inside the junction, so that a queue on the lane straight ahead blocks the vehicle less.
    begin = following.points[0]
    share = over / aside
    return [points[-1], (ahead[0] + share * (begin[0] - ahead[0]), ahead[1] + share * (begin[1] - ahead[1]))]


def _beside(place: tuple[float, float], direction: float, lane: Lane, network: Mapping[str, Lane]) -> float:
    """Lateral distance (m) from a place, passed in a `direction` (rad), to a lane that begins beside the place.

    0 if the lane does not begin beside it, or if the area between them is not carriageway.
    """
    if lane.internal or len(lane.points) < 2:
        return 0.0
    begin, then = lane.points[:2]
    dx, dy = place[0] - begin[0], place[1] - begin[1]
    if not BESIDE <= math.hypot(dx, dy) <= WIDEST:
        return 0.0
    along = direction_between(begin, then)
    left = dy * math.cos(along) - dx * math.sin(along)
    if abs(math.remainder(along - direction, math.tau)) >= PARALLEL or abs(left) < BESIDE:
        return 0.0
    return abs(left) if _carriageway_between(place, lane, network) else 0.0


def _have_room(place: tuple[float, float], lane: Lane, following: Lane, network: Mapping[str, Lane]) -> bool:
    """Whether the lanes beside an internal `lane`, which shift with it, can be eased like it.

    A vehicle beside, on the last of these lanes, would meet a vehicle that is eased while it is not. No lane shifts
    with a bent one. `place`: as far ahead as the begin of the `following` lane, straight on.
    """
    if is_bent(lane.id):
        return True
    step = _step_towards(place, following, network)
    if not step:
        return True
    outer, beside = following, neighbour(lane, step, network)
    while beside is not None and (after := neighbour(outer, step, network)) is not None:
        outer, beside = after, neighbour(beside, step, network)
    (x0, y0), (x1, y1) = following.points[0], outer.points[0]
    return outer is following or _carriageway_between((place[0] + x1 - x0, place[1] + y1 - y0), outer, network)


def _carriageway_between(place: tuple[float, float], lane: Lane, network: Mapping[str, Lane]) -> bool:
    """Whether all lanes of the edge between the begin of a lane and a place beside it are carriageway."""
    nearest, step = _away(lane, place), _step_towards(place, lane, network)
    if not step:
        return nearest <= 0.5 * lane.width
    between = neighbour(lane, step, network)
    while between is not None and between.surface == lane.surface:
        away = _away(between, place)
        if away <= 0.5 * between.width or away >= nearest:
            return True
        between, nearest = neighbour(between, step, network), away
    return False


def _step_towards(place: tuple[float, float], lane: Lane, network: Mapping[str, Lane]) -> int:
    """The step, see `neighbour`, to the lane beside a lane that begins nearer to a place; 0 without one."""
    left, right = (_away(neighbour(lane, step, network), place) for step in (1, -1))
    if min(left, right) >= _away(lane, place):
        return 0
    return 1 if left < right else -1


def _away(lane: Lane | None, place: tuple[float, float]) -> float:
    """Distance (m) from the begin of a lane to a place."""
    return math.inf if lane is None else math.dist(lane.points[0], place)


def _beyond(points: list[tuple[float, float]]) -> tuple[float, float]:
    """A point `VIEW` m straight ahead of the last point."""
    x, y = points[-1]
    for px, py in reversed(points):
        step = math.hypot(x - px, y - py)
        if step > 0.1:
            return x + VIEW * (x - px) / step, y + VIEW * (y - py) / step
    return x + VIEW, y
