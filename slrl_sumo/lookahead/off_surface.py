"""Mode paths that leave the surfaces that belong to a road user, and how far they leave them."""

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import CIRCLE, RoadMap
from slrl_sumo.ground.surfaces import OWN_SURFACE, Surface
from slrl_sumo.ground.tiles import Ids
from slrl_sumo.lookahead.mode_paths import STEPS, ModePaths
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import HERE, RouteAhead
from slrl_sumo.scene.types import PEDESTRIAN, RoadUserType

NEAR = 3
"""Number of intervals (1.2 s) in which a road user with a route must not leave its surfaces; later it follows its
path."""
WALK = len(OWN_SURFACE)
"""Row of OWN for pedestrians with a route: roads, cycleways and crossings belong to them only where their path leads
over these. Otherwise they would pass a crowd on the carriageway, or on a crossing with a red signal."""
OWN = np.append(OWN_SURFACE, OWN_SURFACE[[RoadUserType.PEDESTRIAN]], axis=0)
OWN[WALK, [Surface.ROAD, Surface.CYCLEWAY, Surface.CROSSING]] = False
JUST_OFF, FOREIGN = 0.25, 0.1
"""Weights, for road users with a route, of a place just off their own surfaces, and of foreign surface under their
path. The weight of a place grows by a quarter at each of DISTANCES, to 1; from 1 m off the surface, a trip is not
clean. With equal weights for all places, nothing led road users back that a crowd had pushed off their surfaces."""
DISTANCES = 0.25, 0.5, 0.75
"""Distances (m) from the own surfaces at which the weight of a place grows."""
AROUND = CIRCLE[::2]
"""Directions (rad) in which the own surfaces are searched; every second one, because each mode needs the search."""


def off_surface(
    paths: ModePaths, kind: NDArray[np.int8], road_map: RoadMap, rows: NDArray[np.intp], route: RouteAhead | None
) -> Floats:
    """Share of the intervals in which each mode is off the road user's own surfaces, (n, modes).

    For road users with a route only the first NEAR intervals count, weighted by distance (`distance_off`). `paths`:
    mode paths of n road users of the types `kind`. `rows`: their rows in `route`.
    """
    checked = np.full(len(kind), STEPS) if route is None else np.where(route.known[rows], NEAR, STEPS)
    ground = kind
    if route is not None:
        ground = np.where((kind == PEDESTRIAN) & route.known[rows], WALK, kind).astype(np.int8)
    x, y = _places(paths.x, paths.y, checked)
    surface = road_map.surface_at(x, y)
    outside = _outside(surface, checked, ground, paths.x.shape[2])
    if route is None:
        return _share(outside.astype(np.float64), checked, paths.x.shape[2])
    # Paths leave the ground where the network ends, and lead over foreign surfaces: a road user that follows its path
    # there is right. The carriageway on a pedestrian's path belongs to the pedestrian.
    place, user, path_x, path_y = _on_route(
        outside, checked, paths.distance, route.known, rows, route.x, route.y, route.spacing
    )
    if len(place):
        path = road_map.surface_at(path_x, path_y)
        still = OWN[ground[user], path] | ((surface[place] == Surface.NONE) & (path != Surface.NONE))
        outside[place] = still
        place, user = place[still], user[still]
    counts = outside.astype(np.float64)
    counts[place] = FOREIGN
    off = ~OWN_SURFACE[kind[user], surface[place]]
    place, user = place[off], user[off]
    counts[place] = distance_off(road_map, kind[user], x[place], y[place])
    return _share(counts, checked, paths.x.shape[2])


def distance_off(road_map: RoadMap, kind: NDArray[np.int8], x: Floats, y: Floats) -> Floats:
    """Weights, from JUST_OFF to 1, of places (m) off the own surfaces of road users of the types `kind`, all (n,)."""
    counts = np.full(len(kind), JUST_OFF)
    far = np.arange(len(kind))
    for distance in DISTANCES:
        far = far[road_map.beyond_own_surface(kind[far], x[far], y[far], distance, AROUND)]
        counts[far] += (1.0 - JUST_OFF) / len(DISTANCES)
    return counts


@compiled
def _places(x: Floats, y: Floats, checked: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """The first `checked` (n,) intervals of `x` and `y` (n, STEPS, modes), concatenated."""
    modes, k = x.shape[2], 0
    many = 0
    for steps in checked:
        many += steps * modes
    all_x, all_y = np.empty(many), np.empty(many)
    for i in range(len(checked)):
        for step in range(checked[i]):
            for mode in range(modes):
                all_x[k], all_y[k] = x[i, step, mode], y[i, step, mode]
                k += 1
    return all_x, all_y


@compiled
def _outside(surface: Ids, checked: NDArray[np.intp], ground: NDArray[np.int8], modes: int) -> NDArray[np.bool_]:
    """Whether places in the order of `_places` are on none of the surfaces in the rows `ground` of OWN, (n,)."""
    outside, k = np.empty(len(surface), np.bool_), 0
    for i in range(len(checked)):
        for _ in range(checked[i] * modes):
            outside[k] = not OWN[ground[i], surface[k]]
            k += 1
    return outside


@compiled
def _on_route(
    outside: NDArray[np.bool_],
    checked: NDArray[np.intp],
    distance: Floats,
    known: NDArray[np.bool_],
    rows: NDArray[np.intp],
    path_x: Floats,
    path_y: Floats,
    spacing: Floats,
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats]:
    """For each place that is `outside`, of road users with a path: index of the place, index of the road user, and the
    point (x, y) of its path at the same distance."""
    most, last, modes = 0, path_x.shape[1] - 1, distance.shape[2]
    for one in outside:  # numba takes 1 s to compile np.count_nonzero
        most += one
    place, user, x, y = np.empty(most, np.intp), np.empty(most, np.intp), np.empty(most), np.empty(most)
    k = found = 0
    for i in range(len(rows)):
        row = rows[i]
        for step in range(checked[i]):
            for mode in range(modes):
                if outside[k] and known[row]:
                    on = distance[i, step, mode] / spacing[row]
                    # NaN distances select the last point, too.
                    there = HERE + int(np.rint(on)) if 0.0 <= on < last - HERE else last
                    place[found], user[found], x[found], y[found] = k, i, path_x[row, there], path_y[row, there]
                    found += 1
                k += 1
    return place[:found], user[:found], x[:found], y[:found]


@compiled
def _share(outside: Floats, checked: NDArray[np.intp], modes: int) -> Floats:
    """The mean of `outside` over the places of each mode, (n, modes)."""
    share, k = np.zeros((len(checked), modes)), 0
    for i in range(len(checked)):
        for _ in range(checked[i]):
            for mode in range(modes):
                share[i, mode] += outside[k]
                k += 1
        for mode in range(modes):
            share[i, mode] /= checked[i]
    return share
