"""Worlds and ground for the tests of what road users see."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import Ribbon, Surface, SurfaceShapes
from slrl_sumo.scene.route import HERE, POINTS, SPACING, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH

Place = Callable[..., WorldState]


@pytest.fixture
def place() -> Place:
    """Makes a world from rows of (type, x, y, heading); boxes of the types' default size unless given."""

    def make(
        road_users: Sequence[tuple[float, float, float, float]] | NDArray[np.float64],
        length: NDArray[np.float64] | None = None,
        width: NDArray[np.float64] | None = None,
    ) -> WorldState:
        rows = np.array(road_users, np.float64).reshape(-1, 4)
        kind = rows[:, 0].astype(np.int8)
        n = len(rows)
        return WorldState(
            time=0.0,
            ids=tuple(f"u{i}" for i in range(n)),
            type=kind,
            x=rows[:, 1].copy(),
            y=rows[:, 2].copy(),
            heading=rows[:, 3].copy(),
            speed=np.arange(n) + 0.5,
            acceleration=np.arange(n) - 3.25,
            yaw_rate=np.zeros(n),
            length=DEFAULT_LENGTH[kind] if length is None else length,
            width=DEFAULT_WIDTH[kind] if width is None else width,
            learned=np.arange(n) % 2 == 0,
        )

    return make


@pytest.fixture
def routed() -> Callable[..., RouteAhead]:
    """Makes the routes of road users at places (x, y, direction): straight paths, that turn by `turn` rad `after` m.

    `columns`: other fields of RouteAhead, the same for all.
    """

    def make(*places: tuple[float, float, float], turn: float = 0.0, after: int = 0, **columns: float) -> RouteAhead:
        n = len(places)
        route = RouteAhead.unknown(n)
        x, y, heading = np.array(places, np.float64).reshape(-1, 3).T[:, :, None]
        direction = heading + np.where(np.arange(POINTS - 1) >= HERE + after, turn, 0.0)
        for line, begin, step in ((route.x, x, np.cos(direction)), (route.y, y, np.sin(direction))):
            line[:, 1:] = SPACING * np.cumsum(step, axis=1)
            line += begin - line[:, HERE : HERE + 1]
        route.known[:] = True
        for name, value in columns.items():
            getattr(route, name)[:] = value
        return route

    return make


@pytest.fixture
def crowd(place: Place) -> Callable[[int, int, float], WorldState]:
    """Makes a world of `n` road users of all types at random in a square of `side` m round the origin."""

    def make(seed: int, n: int, side: float) -> WorldState:
        rng = np.random.default_rng(seed)
        kind, heading = rng.integers(0, 3, n), rng.uniform(-np.pi, np.pi, n)
        return place(np.column_stack([kind, rng.uniform(-side / 2, side / 2, (n, 2)), heading]))

    return make


@pytest.fixture
def street() -> SurfaceShapes:
    """A road 8 m wide along +x from -300 m to 300 m with pavements of 2 m, and one across at the origin."""
    ends = np.array([(-300.0, 0.0), (300.0, 0.0)])
    along, across = (Ribbon(Surface.ROAD, line, 8.0) for line in (ends, ends[:, ::-1]))
    pavements = tuple(Ribbon(Surface.SIDEWALK, ends + np.array([0.0, side]), 2.0) for side in (5.0, -5.0))
    return SurfaceShapes((*pavements, along, across))
