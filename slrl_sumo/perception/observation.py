"""Observations of learned road users."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS, ego_images
from slrl_sumo.perception.features import state as vector_of
from slrl_sumo.perception.route_context import RouteContext
from slrl_sumo.perception.route_features import path_features, route_features
from slrl_sumo.perception.scene import Scene


@dataclass(frozen=True, eq=False)
class Observation:
    """The observations of n road users at one time."""

    vector: NDArray[np.float32]
    """Feature vectors, (n, columns) as in `features.STATES`; the first 12 columns are `features.FEATURES`. Not
    normalised."""
    image: NDArray[np.uint8] | None
    """Ego images, RGB, (n, EGO_ROWS, EGO_COLS, 3), see `ego_image.ego_images`; None unless requested."""
    type: NDArray[np.int8]
    """RoadUserType of each road user, (n,)."""
    route: NDArray[np.float32] | None = None
    """Route features, (n, 14), columns as in `route_features.ROUTE_FEATURES`; in the preset `image` (n, 30), with the
    columns of PATH_FEATURES. None in the preset `paper` and without routes."""

    def __len__(self) -> int:
        return len(self.type)


def observe(
    scene: Scene,
    *,
    with_image: bool = True,
    context: RouteContext | None = None,
    state: str = "paper",
    path: bool = False,
) -> Observation:
    """Observations of the deciding road users of `scene`; all observations, live and from recordings, are made here.

    With the `context` of the learned road users of the scene, this is the preset `extended`: the route as numbers and
    as a line in the image, crossings and cycle lanes in their own colours. Without it, this is the preset `paper`. With
    `path`, the route also has the points of the path ahead, as in the preset `image`.
    `state`: the vector that models and selector need (see `presets.vector_for`).
    """
    world, rows = scene.world, scene.rows
    mine = None if context is None else context.take(rows)
    image = None
    if with_image:
        if scene.group is None:
            image = ego_images(world, rows, scene.road_map, None if mine is None else mine.route)
        else:  # a recording, which has no routes
            image = np.empty((len(rows), EGO_ROWS, EGO_COLS, 3), np.uint8)
            for part, places in scene.groups():
                image[places] = ego_images(part.world, part.rows, scene.road_map)
    route = None
    if mine is not None:
        route = route_features(world.heading[rows], mine)
        if path:
            points = path_features(mine.route, world.x[rows], world.y[rows], world.heading[rows])
            route = np.concatenate([route, points], axis=1)
    return Observation(
        vector=vector_of(world, rows, scene.group, scene.past, state),
        image=image,
        type=world.type[rows],
        route=route,
    )
