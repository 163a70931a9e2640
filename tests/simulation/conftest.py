"""Crowds without a simulation."""

from collections.abc import Callable

import numpy as np
import pytest

from slrl_sumo.scene.state import WorldState

Crowd = Callable[[int, int, float], WorldState]


@pytest.fixture(scope="session")
def crowd() -> Crowd:
    """Draws so many road users of all types, by that seed, in a square of that many m."""

    def drawn(n: int, seed: int, extent: float) -> WorldState:
        rng = np.random.default_rng(seed)
        sizes = np.array([[5.0, 1.8], [1.6, 0.65], [0.5, 0.5]])
        kind = rng.integers(0, 3, n)
        return WorldState(
            time=0.0,
            ids=tuple(str(i) for i in range(n)),
            type=kind.astype(np.int8),
            x=rng.uniform(0.0, extent, n),
            y=rng.uniform(0.0, extent, n),
            heading=rng.uniform(-np.pi, np.pi, n),
            speed=rng.uniform(0.0, 8.0, n),
            acceleration=np.zeros(n),
            yaw_rate=rng.normal(0.0, 0.3, n),
            length=sizes[kind, 0],
            width=sizes[kind, 1],
            learned=np.ones(n, np.bool_),
        )

    return drawn
