"""Where learned road users may start, and how many of each type."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.errors import InputError
from slrl_sumo.sumo.lanepoints import LanePoints
from slrl_sumo.sumo.network import Lane, Network
from slrl_sumo.world.geometry import Floats, wrap_angle
from slrl_sumo.world.surfaces import Surface
from slrl_sumo.world.types import TYPE_NAMES, RoadUserType

DEFAULT_MIX = np.array([0.5, 0.2, 0.3])
"""Shares of cars, bicycles and pedestrians when the user gives none."""

SPACING = np.array([9.0, 4.0, 2.0])
"""m between two places to start at, per type: a car's length and a gap in which it can stop at low speed."""

SHARED_SPEED = 8.4
"""m/s (30 km/h). A carriageway that also admits pedestrians is a place for them up to this limit; SUMO's networks
without sidewalks admit everybody everywhere, which says nothing about walking on a fast road."""

CYCLING_SPEED = 20.0
"""m/s (72 km/h). The same for bicycles."""


def legal_lanes(network: Network, kind: RoadUserType) -> list[Lane]:
    """Lanes outside junctions on which a road user of this type may be, as a resident would say."""
    lanes = [lane for lane in network.lanes if not lane.internal]
    if kind == RoadUserType.CAR:
        return [lane for lane in lanes if "passenger" in lane.allowed]
    if kind == RoadUserType.BICYCLE:
        return [lane for lane in lanes if "bicycle" in lane.allowed and lane.max_speed <= CYCLING_SPEED]
    return [
        lane
        for lane in lanes
        if "pedestrian" in lane.allowed and (lane.surface == Surface.SIDEWALK or lane.max_speed <= SHARED_SPEED)
    ]


def starting_points(network: Network) -> tuple[LanePoints, ...]:
    """Places to start at per type, indexed by RoadUserType; empty where the network has no surface for the type."""
    return tuple(LanePoints(legal_lanes(network, kind), spacing=float(SPACING[kind])) for kind in RoadUserType)


def parse_mix(text: str) -> NDArray[np.float64]:
    """Shares per type, (3,), from 'car=0.5,bicycle=0.2,pedestrian=0.3', normalised. Types left out get none."""
    shares = np.zeros(len(TYPE_NAMES))
    for item in text.split(","):
        name, _, value = item.partition("=")
        if name.strip() not in TYPE_NAMES:
            raise InputError(f"--mix {text}: '{name.strip()}' is no road user type; use {', '.join(TYPE_NAMES)}")
        try:
            share = float(value)
        except ValueError:
            share = np.nan
        if not 0.0 <= share < np.inf:
            raise InputError(
                f"--mix {text}: the share of {name.strip()} must be a number from 0; write {name.strip()}=0.3"
            )
        shares[TYPE_NAMES.index(name.strip())] = share
    if shares.sum() <= 0:
        raise InputError(f"--mix {text}: all shares are zero; give at least one type a share above 0")
    return np.asarray(shares / shares.sum())


def type_counts(
    agents: int, mix: NDArray[np.float64] | None, points: tuple[LanePoints, ...], where: str
) -> tuple[NDArray[np.int64], list[str]]:
    """How many road users of each type, (3,), and notices.

    Without a `mix` the shares of types that the network has no surface for go to the others; a given mix that asks for
    such a type is an InputError.
    """
    if agents < 1:
        raise InputError(f"--agents {agents}: at least one learned road user is needed")
    possible = np.array([len(p) > 0 for p in points])
    shares = DEFAULT_MIX if mix is None else mix
    missing = [TYPE_NAMES[k] for k in np.flatnonzero(~possible & (shares > 0))]
    notices = []
    if missing and mix is not None:
        raise InputError(f"{where}: the network has no surface for {', '.join(missing)}; leave it out of --mix")
    if not possible.any():
        raise InputError(f"{where}: the network has no lane for cars, bicycles or pedestrians; nobody can be placed")
    if missing:
        shares = np.where(possible, shares, 0.0)
        notices.append(f"no surface for {' and '.join(missing)} in this network: their share goes to the other types")
    shares = shares / shares.sum()
    exact = agents * shares
    counts = np.floor(exact).astype(np.int64)
    # Largest remainders get what is left, so that the counts add up.
    for kind in np.argsort(counts - exact, kind="stable")[: agents - counts.sum()]:
        counts[kind] += 1
    return counts, notices


def draw_starts(
    counts: NDArray[np.int64], points: tuple[LanePoints, ...], rng: np.random.Generator
) -> tuple[NDArray[np.int8], Floats, Floats, Floats, Floats]:
    """Starting places drawn without overlap: kinds (n,), x, y (m), heading (rad) and the lane's speed limit (m/s).

    Pedestrians walk either way along their lane. Raises InputError when not all of them fit.
    """
    taken = np.zeros((0, 2))
    gaps = np.zeros(0)
    parts = []
    # The largest first: a car needs a place of its own, a pedestrian fits in between.
    for kind in RoadUserType:
        source, wanted = points[kind], int(counts[kind])
        order = rng.permutation(len(source))
        places = np.column_stack([source.x[order], source.y[order]])
        free = _clear_of(places, SPACING[kind], taken, gaps)
        chosen = order[_apart(places, 0.9 * SPACING[kind], free, wanted)]
        if len(chosen) < wanted:
            raise InputError(
                f"--agents {int(counts.sum())}: only {len(chosen)} of {wanted} {TYPE_NAMES[kind]} road users fit into "
                "this network; ask for fewer, or change --mix"
            )
        heading = source.heading[chosen]
        if kind == RoadUserType.PEDESTRIAN:
            heading = wrap_angle(heading + np.pi * rng.integers(0, 2, wanted))
        limit = np.array([lane.max_speed for lane in source.lanes])[source.lane[chosen]] if wanted else np.zeros(0)
        parts.append((np.full(wanted, kind, np.int8), source.x[chosen], source.y[chosen], heading, limit))
        taken = np.concatenate([taken, np.column_stack([source.x[chosen], source.y[chosen]])])
        gaps = np.concatenate([gaps, np.full(wanted, SPACING[kind])])
    kinds, x, y, heading, limit = (np.concatenate(column) for column in zip(*parts, strict=True))
    return kinds, x, y, heading, limit


def _clear_of(places: Floats, gap: float, taken: Floats, gaps: Floats) -> NDArray[np.bool_]:
    """Which places keep half of both gaps from all that are taken."""
    if not len(taken) or not len(places):
        return np.ones(len(places), np.bool_)
    distance, nearest = cKDTree(taken).query(places)
    return np.asarray(distance >= 0.5 * (gap + gaps[nearest]))


def _apart(places: Floats, gap: float, free: NDArray[np.bool_], wanted: int) -> NDArray[np.intp]:
    """The first `wanted` free places, in order, of which no two are closer than `gap`."""
    if not wanted or not len(places):
        return np.zeros(0, np.intp)
    tree = cKDTree(places)
    free = free.copy()
    chosen: list[int] = []
    for row in range(len(places)):
        if len(chosen) == wanted:
            break
        if free[row]:
            chosen.append(row)
            free[tree.query_ball_point(places[row], gap)] = False
    return np.array(chosen, np.intp)
