"""What a learned road user decides from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.perception.ego_image import ego_images
from slrl_sumo.perception.features import features
from slrl_sumo.perception.route_features import route_features
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import RouteAhead
from slrl_sumo.scene.state import WorldState


@dataclass(frozen=True)
class Observation:
    """What n road users perceive at one time."""

    vector: NDArray[np.float32]
    """(n, 12), columns as in `features.FEATURES`, not normalised."""
    image: NDArray[np.uint8] | None
    """(n, EGO_ROWS, EGO_COLS, 3) RGB as in `raster.ego_images`; None where nobody looks."""
    type: NDArray[np.int8]
    """RoadUserType of each, (n,)."""
    ahead: NDArray[np.float32] | None = None
    """What each mode would lead to, (n, modes, 4), or 9 columns in the preset `extended`, as lookahead.lookahead has
    it; None where nobody looks ahead."""
    route: NDArray[np.float32] | None = None
    """(n, 14), columns as in `routefeatures.ROUTE_FEATURES`; None in the preset `paper`."""

    def __len__(self) -> int:
        return len(self.type)


@dataclass(frozen=True)
class Way:
    """The routes of n observed road users, with who is ahead on them: the gap in m and the speed in m/s, (n,)."""

    route: RouteAhead
    gap: Floats
    leading: Floats

    def take(self, rows: NDArray[np.intp]) -> "Way":
        """Those of the road users `rows`."""
        return Way(self.route.take(rows), self.gap[rows], self.leading[rows])


def observe(
    world: WorldState, rows: NDArray[np.intp], roadmap: RoadMap, with_image: bool = True, way: Way | None = None
) -> Observation:
    """What the road users `rows` of `world` perceive: the only way to an observation, in live and in recorded worlds.

    `with_image=False` spares the images for selectors that do not look. With the `way` of those road users this is the
    preset `extended`: their route as numbers and as a line in the image, crossings and cycle lanes in their own
    colours; without it `paper`.
    """
    numbers = None if way is None else route_features(world, rows, way.route, way.gap, way.leading)
    return Observation(
        vector=features(world, rows),
        image=ego_images(world, rows, roadmap, None if way is None else way.route) if with_image else None,
        type=world.type[rows],
        route=numbers,
    )
