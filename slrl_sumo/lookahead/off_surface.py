"""Which courses leave the ground that belongs to a road user."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE
from slrl_sumo.ground.tiles import Ids
from slrl_sumo.lookahead.mode_rollout import STEPS, ModeRollouts
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import HERE, SPACING, RouteAhead

NEAR = 3
"""Intervals, 1.2 s, in which who has a route must not leave its surface: later it turns with its path."""


def off_surface(
    free: ModeRollouts, kind: NDArray[np.int8], roadmap: RoadMap, rows: NDArray[np.intp], route: RouteAhead | None
) -> Floats:
    """In which share of the intervals, of the first NEAR ones for who has a route, each mode is off the own surface,
    (n, modes).

    `free`: the courses of n road users of the types `kind`, which are the `rows` of those with a `route`.
    """
    looked = np.full(len(kind), STEPS) if route is None else np.where(route.known[rows], NEAR, STEPS)
    surface = roadmap.surface_at(*_places(free.x, free.y, looked))
    outside = _outside(surface, looked, kind, OWN_SURFACE, free.x.shape[2])
    if route is not None:
        # Paths lead off the ground where the network ends: who follows them there is right.
        place, user, x, y = _beside(outside, looked, free.way, route.known, rows, route.x, route.y, SPACING, HERE)
        if len(place):
            outside[place] = OWN_SURFACE[kind[user], roadmap.surface_at(x, y)]
    return _share(outside, looked, free.x.shape[2])


@compiled
def _places(x: Floats, y: Floats, looked: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """The first `looked` (n,) of `x` and `y` (n, STEPS, modes), laid end to end."""
    modes, k = x.shape[2], 0
    all_x, all_y = np.empty(looked.sum() * modes), np.empty(looked.sum() * modes)
    for i in range(len(looked)):
        for step in range(looked[i]):
            for mode in range(modes):
                all_x[k], all_y[k] = x[i, step, mode], y[i, step, mode]
                k += 1
    return all_x, all_y


@compiled
def _outside(
    surface: Ids, looked: NDArray[np.intp], kind: NDArray[np.int8], own: NDArray[np.bool_], modes: int
) -> NDArray[np.bool_]:
    """Whether places as `_places` has them are on no surface of the `own` ones, (types, surfaces)."""
    outside, k = np.empty(len(surface), np.bool_), 0
    for i in range(len(looked)):
        for _ in range(looked[i] * modes):
            outside[k] = not own[kind[i], surface[k]]
            k += 1
    return outside


@compiled
def _beside(
    outside: NDArray[np.bool_],
    looked: NDArray[np.intp],
    way: Floats,
    known: NDArray[np.bool_],
    rows: NDArray[np.intp],
    path_x: Floats,
    path_y: Floats,
    spacing: float,
    here: int,
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats]:
    """Of the places that are `outside`: which, whose, and the point of that one's path that is as far on; for those who
    have a path."""
    most, last, modes = np.count_nonzero(outside), path_x.shape[1] - 1, way.shape[2]
    place, user, x, y = np.empty(most, np.intp), np.empty(most, np.intp), np.empty(most), np.empty(most)
    k = found = 0
    for i in range(len(rows)):
        row = rows[i]
        for step in range(looked[i]):
            for mode in range(modes):
                if outside[k] and known[row]:
                    on = way[i, step, mode] / spacing
                    # Ways that are no numbers end there as well.
                    there = here + int(np.rint(on)) if 0.0 <= on < last - here else last
                    place[found], user[found], x[found], y[found] = k, i, path_x[row, there], path_y[row, there]
                    found += 1
                k += 1
    return place[:found], user[:found], x[:found], y[:found]


@compiled
def _share(outside: NDArray[np.bool_], looked: NDArray[np.intp], modes: int) -> Floats:
    """The share of the places of each mode that is `outside`, (n, modes)."""
    share, k = np.zeros((len(looked), modes)), 0
    for i in range(len(looked)):
        for _ in range(looked[i]):
            for mode in range(modes):
                share[i, mode] += outside[k]
                k += 1
        for mode in range(modes):
            share[i, mode] /= looked[i]
    return share
