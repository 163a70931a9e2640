"""Worlds and ground for the tests of what road users see."""

from collections.abc import Callable

import numpy as np
import pytest
from builders import make_world
from numpy.typing import ArrayLike

from slrl_sumo.ground.surfaces import Ribbon, Surface, SurfaceShapes
from slrl_sumo.scene.state import WorldState


@pytest.fixture
def place() -> Callable[..., WorldState]:
    """Makes a world from rows of (type, x, y, heading); boxes of the types' default size unless given."""

    def make(rows: ArrayLike, length: ArrayLike | None = None, width: ArrayLike | None = None) -> WorldState:
        kind, x, y, heading = np.asarray(rows, np.float64).reshape(-1, 4).T
        row = np.arange(len(kind))
        speed, acceleration, learned = row + 0.5, row - 3.25, row % 2 == 0
        return make_world(
            x, y, heading, speed, type=kind, acceleration=acceleration, length=length, width=width, learned=learned
        )

    return make


@pytest.fixture
def street() -> SurfaceShapes:
    """A road 8 m wide along +x from -300 m to 300 m with pavements of 2 m, and one across at the origin."""
    ends = np.array([(-300.0, 0.0), (300.0, 0.0)])
    along, across = (Ribbon(Surface.ROAD, line, 8.0) for line in (ends, ends[:, ::-1]))
    pavements = tuple(Ribbon(Surface.SIDEWALK, ends + np.array([0.0, side]), 2.0) for side in (5.0, -5.0))
    return SurfaceShapes((*pavements, along, across))
