import numpy as np
import pytest
from builders import make_world

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.formats.trajectory_builder import TrajectoryBuilder
from slrl_sumo.learning.supervised.fit import fit
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.scene.advance import advance
from slrl_sumo.scene.types import DECISION_INTERVAL

TOP = np.array([9.0, 5.0, 1.6])
CURVATURE = np.array([0.08, 0.12, 0.3])


def made_traffic(seed: int, per_type: int = 72, steps: int = 60) -> Trajectories:
    """Road users of all types on circles to both sides and on straight lines, at various speeds.

    One in four stops, stands and goes on; one in twelve stands all the time. All move by `advance`.
    """
    random = np.random.default_rng(seed)
    kind = np.repeat(np.arange(3), per_type).astype(np.int8)
    n = len(kind)
    number = np.tile(np.arange(per_type), 3)
    curvature = np.choose(number % 3, [-1.0, 0.0, 1.0]) * CURVATURE[kind] * random.uniform(0.6, 1.0, n)
    stops, stands = number % 4 == 3, number % 12 == 7
    cruise = np.where(stands, 0.0, TOP[kind] * random.uniform(0.4, 1.0, n))
    stop_at = random.integers(8, 20, n)
    world = make_world(
        random.uniform(0, 200, n),
        random.uniform(0, 200, n),
        random.uniform(-np.pi, np.pi, n),
        cruise,
        type=kind,
        ids=[f"{seed}-{i}" for i in range(n)],
        learned=False,
    )
    builder = TrajectoryBuilder(source=f"made traffic {seed}", licence="CC0-1.0")
    hard = 0.25 * TOP[kind]
    for step in range(steps):
        builder.append(world)
        halting = stops & (step >= stop_at) & (step < stop_at + 14)
        wanted = np.where(halting, 0.0, cruise)
        acceleration = np.clip((wanted - world.speed) / DECISION_INTERVAL, -hard, 0.7 * hard)
        after = world.speed + acceleration * DECISION_INTERVAL
        world = advance(world, acceleration, curvature * after, TOP[kind], DECISION_INTERVAL)
    return builder.build()


@pytest.fixture(scope="session")
def traffic() -> list[Trajectories]:
    return [made_traffic(1), made_traffic(2)]


@pytest.fixture(scope="session")
def learned(traffic: list[Trajectories]) -> ModelBundle:
    return fit(traffic, name="made", seed=4, epochs=15, modes="kmeans", preset="paper")


@pytest.fixture(scope="session")
def brief_traffic() -> Trajectories:
    """Tracks of 14 rows: one too few for a window."""
    return made_traffic(1, steps=14)
