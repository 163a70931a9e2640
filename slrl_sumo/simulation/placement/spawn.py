"""Starting places of learned road users, and their numbers by type."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.scene.geometry import Floats, boxes_overlap, wrap_angle
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.placement.insertion import insertions, safe_speed
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import Lane, LanePoints

DEFAULT_MIX = np.array([0.5, 0.2, 0.3])
"""Default shares of cars, bicycles and pedestrians."""

START_SPACING = np.array([9.0, 4.0, 2.0])
"""Spacing (m) of road users at the start, by type: for a car its length and a gap in which it can stop from low
speed."""

TIGHT_START_SPACING = np.array([6.5, 2.4, 1.0])
"""The same for numbers of road users that need closer starting places: boxes do not touch."""

START_SIDE_GAP = 0.3
"""Distance (m) by which the reserved box of a road user is wider than its own box at the start."""

LANE_STRIP = np.array([np.inf, np.inf, 0.9])
"""Width (m) of a lane that a road user takes: on wide lanes several pedestrians start side by side. Vehicles start in
the middle of their lane, where they drive: side by side, they would collide there."""

POINT_SPACING = START_SPACING / 4
"""Spacing (m) of the candidate places."""

MOST_STARTING_POINTS = 200_000
"""Approximate greatest number of starting points per type: without a limit, a city of 10 km x 10 km had 7.6 million for
pedestrians, in 1 GB."""

MAX_SHARED_LANE_SPEED = 8.4
"""Speed limit (m/s, 30 km/h) up to which pedestrians may start on a carriageway that admits them: SUMO's networks
without sidewalks admit all road users everywhere, also pedestrians on fast roads."""

MAX_CYCLING_LANE_SPEED = 20.0
"""The same for bicycles (m/s, 72 km/h), which SUMO admits on nearly every road."""


SLOWER = 0.1
"""Reduction of speed (m/s) that requires a check of the follower."""

NO_OTHERS = np.zeros((0, 6))


def legal_lanes(network: Network, kind: RoadUserType) -> list[Lane]:
    """Lanes outside junctions that a road user of this type ordinarily uses."""
    lanes = [lane for lane in network.lanes if not lane.internal]
    if kind == RoadUserType.CAR:
        return [lane for lane in lanes if "passenger" in lane.allowed]
    if kind == RoadUserType.BICYCLE:
        return [lane for lane in lanes if "bicycle" in lane.allowed and lane.max_speed <= MAX_CYCLING_LANE_SPEED]
    return [
        lane
        for lane in lanes
        if "pedestrian" in lane.allowed
        and (lane.surface == Surface.SIDEWALK or lane.max_speed <= MAX_SHARED_LANE_SPEED)
    ]


def starting_points(network: Network) -> tuple[LanePoints, ...]:
    """Starting points by RoadUserType; empty for types without a surface in the network.

    There are at most about MOST_STARTING_POINTS per type: in a city they are farther apart.
    """
    points = []
    for kind in RoadUserType:
        lanes = [lane for lane in legal_lanes(network, kind) if lane.edge not in network.removing]
        spacing, strip = float(POINT_SPACING[kind]), float(LANE_STRIP[kind])
        many = sum(lane.length * max(1, int(lane.width / strip)) for lane in lanes) / spacing
        points.append(LanePoints(lanes, spacing=spacing * max(1.0, many / MOST_STARTING_POINTS), strip=strip))
    return tuple(points)


def type_counts(
    agents: int,
    mix: NDArray[np.float64] | None,
    points: tuple[LanePoints, ...],
    where: str,
    bundle: ModelBundle | None = None,
) -> tuple[NDArray[np.int64], list[str]]:
    """Numbers of road users by type, (3,), and notices.

    Without a `mix`, the shares of types without a surface in the network, or without models in the bundle, go to the
    other types; a mix that contains such a type raises InputError.
    """
    if agents < 1:
        raise InputError("at least one learned road user is needed", argument="agents", value=agents)
    possible = np.array([len(p) > 0 for p in points])
    shares = DEFAULT_MIX if mix is None else mix
    missing = [TYPE_NAMES[k] for k in np.flatnonzero(~possible & (shares > 0))]
    notices = []
    if missing and mix is not None:
        raise InputError(f"{where}: the network has no surface for {', '.join(missing)}; leave it out of `mix`")
    if not possible.any():
        raise InputError(
            f"{where}: the network has no lane for cars, bicycles or pedestrians; no road user can be placed"
        )
    if missing:
        shares = np.where(possible, shares, 0.0)
        notices.append(f"no surface for {' and '.join(missing)} in this network: their share goes to the other types")
    if bundle is not None and (unserved := bundle.missing(shares > 0)):
        if mix is not None:
            raise InputError(f"bundle '{bundle.name}' has no models for {unserved}; leave it out of `mix`")
        shares = np.where(bundle.types, shares, 0.0)
        if not shares.any():
            raise InputError(f"{where}: bundle '{bundle.name}' has models for none of the types that fit in here")
        notices.append(f"bundle '{bundle.name}' has no models for {unserved}: their share goes to the other types")
    shares = shares / shares.sum()
    exact = agents * shares
    counts = np.floor(exact).astype(np.int64)
    # The types with the largest remainders get the rest, so that the counts add up to `agents`.
    for kind in np.argsort(counts - exact, kind="stable")[: agents - counts.sum()]:
        counts[kind] += 1
    return counts, notices


class Starts(NamedTuple):
    """Starting places of n road users, (n,) each."""

    type: NDArray[np.int8]
    """RoadUserType."""
    x: Floats
    """m."""
    y: Floats
    """m."""
    heading: Floats
    """rad."""
    limit: Floats
    """Speed limit of the lane, m/s."""
    rest: Floats
    """Distance (m) to the end of the lane, where a vehicle must be able to stop; inf for pedestrians."""


def draw_starts(counts: NDArray[np.int64], points: tuple[LanePoints, ...], rng: np.random.Generator) -> Starts:
    """Draw starting places without overlap.

    Pedestrians walk in both directions along their lane. If not all road users fit at a comfortable distance, they are
    packed as tightly as their boxes allow. Raises InputError if not all of them fit even then.
    """
    orders = [rng.permutation(len(source)) for source in points]
    chosen = _choose(counts, points, orders, START_SPACING)
    if any(len(rows) < count for rows, count in zip(chosen, counts, strict=True)):
        # The densest order is along the lanes, one place after the other.
        chosen = _choose(counts, points, [np.arange(len(source)) for source in points], TIGHT_START_SPACING)
    for kind, rows in enumerate(chosen):
        if len(rows) < counts[kind]:
            raise InputError(
                f"only {len(rows)} of {int(counts[kind])} {TYPE_NAMES[kind]} road users fit into this network; "
                "ask for fewer, or change `mix`",
                argument="agents",
                value=int(counts.sum()),
            )
    parts = []
    for kind, (source, rows) in enumerate(zip(points, chosen, strict=True)):
        heading = source.heading[rows]
        if kind == RoadUserType.PEDESTRIAN:
            heading = wrap_angle(heading + np.pi * rng.integers(0, 2, len(rows)))
        walks = kind == RoadUserType.PEDESTRIAN
        rest = np.full(len(rows), np.inf) if walks else source.rest_of_lane(rows)
        kinds = np.full(len(rows), kind, np.int8)
        parts.append(Starts(kinds, source.x[rows], source.y[rows], heading, source.max_speed(rows), rest))
    return Starts(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def starting_speeds(starts: Starts, max_speed: Floats, rng: np.random.Generator, others: Floats = NO_OTHERS) -> Floats:
    """Speeds (m/s, (n,)) at the start (see starting_speed), at which each road user can stop behind its leader, and
    before the junction.

    `max_speed`: by type, m/s, (3,). `others`: further road users (see insertion.boxes_of).
    """
    usual = starting_speed(max_speed[starts.type], starts.limit, rng.random(len(starts.type)))
    speed = np.minimum(usual, safe_speed(starts.rest))
    size = np.stack([DEFAULT_LENGTH[starts.type], DEFAULT_WIDTH[starts.type]], axis=1)
    crowd = np.concatenate([np.column_stack([starts.x, starts.y, starts.heading, speed, size]), others])
    changed = True
    # A road user that must be slower may require its follower to be slower, too: repeat up to the length of the longest
    # queue.
    while changed:
        changed = False
        for row in range(len(speed)):
            place = slice(row, row + 1)
            *_, fastest = insertions(starts.x[place], starts.y[place], starts.heading[place], crowd, row)
            if fastest[0] < crowd[row, 3] - SLOWER:
                crowd[row, 3], changed = fastest[0], True
    return crowd[: len(speed), 3]


def starting_speed(max_speed: Any, limit: Any, draw: Any) -> Any:
    """Speed (m/s) at the start: road users already move, at a slow to usual speed of their type, within the limit.

    `max_speed`: of the type, m/s. `limit`: of the lane, m/s. `draw`: from [0, 1). Scalars or (n,).
    """
    return np.minimum(0.5 * max_speed, limit) * (0.5 + 0.5 * draw)


def _choose(
    counts: NDArray[np.int64], points: tuple[LanePoints, ...], orders: list[NDArray[np.intp]], spacing: Floats
) -> list[NDArray[np.intp]]:
    """For each type, the first points in its order that keep their distance, up to the number in `counts`.

    Each road user reserves a box along the lane, as long as the type's spacing and slightly wider than its own box;
    reserved boxes do not overlap. The largest type comes first, because pedestrians fit between cars.
    """
    taken = np.zeros((0, 5))
    chosen = []
    for kind, (source, order) in enumerate(zip(points, orders, strict=True)):
        n = len(order)
        claims = np.column_stack(
            [
                source.x[order],
                source.y[order],
                source.heading[order],
                np.full(n, spacing[kind]),
                np.full(n, DEFAULT_WIDTH[kind] + START_SIDE_GAP),
            ]
        )
        rows = _first_free(claims, taken, int(counts[kind]))
        chosen.append(order[rows])
        taken = np.concatenate([taken, claims[rows]])
    return chosen


def _first_free(claims: Floats, taken: Floats, wanted: int) -> NDArray[np.intp]:
    """The first `wanted` of the boxes `claims` (n, 5) that overlap neither each other nor a box of `taken` (m, 5)."""
    if not wanted or not len(claims):
        return np.zeros(0, np.intp)
    order = np.argsort(claims[:, 0])
    from_west = claims[order, 0]
    reach = float(np.hypot(claims[0, 3], claims[0, 4]))
    free = np.ones(len(claims), np.bool_)

    def block(box: Floats) -> None:
        apart = 0.5 * (reach + float(np.hypot(box[3], box[4])))
        near = order[slice(*np.searchsorted(from_west, (box[0] - apart, box[0] + apart)))]
        near = near[free[near] & (np.abs(claims[near, 1] - box[1]) <= apart)]
        # Shrink the box by 1 cm, so that places exactly one spacing apart do not touch.
        mine = np.repeat((box - [0.0, 0.0, 0.0, 0.01, 0.01])[None], len(near), axis=0)
        free[near[boxes_overlap(mine, claims[near])]] = False

    for box in taken:
        block(box)
    chosen: list[int] = []
    for row in range(len(claims)):
        if len(chosen) == wanted:
            break
        if free[row]:
            chosen.append(row)
            block(claims[row])
    return np.array(chosen, np.intp)
