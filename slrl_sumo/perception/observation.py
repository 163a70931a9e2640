"""What a learned road user decides from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.perception.features import features
from slrl_sumo.perception.raster import ego_images
from slrl_sumo.world.roadmap import RoadMap
from slrl_sumo.world.state import WorldState


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
    """What each mode would lead to, (n, modes, 4), as simulation.lookahead has it; None where nobody looks ahead."""

    def __len__(self) -> int:
        return len(self.type)


def observe(world: WorldState, rows: NDArray[np.intp], roadmap: RoadMap, with_image: bool = True) -> Observation:
    """What the road users `rows` of `world` perceive: the only way to an observation, in live and in recorded worlds.

    `with_image=False` spares the images for selectors that do not look.
    """
    return Observation(
        vector=features(world, rows),
        image=ego_images(world, rows, roadmap) if with_image else None,
        type=world.type[rows],
    )
