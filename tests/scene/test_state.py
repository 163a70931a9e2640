"""Taking and joining worlds."""

from dataclasses import fields

import numpy as np
from builders import make_world

from slrl_sumo.scene.state import WorldState, empty_world


def numbered(n: int, first: int, time: float) -> WorldState:
    """A world whose every array holds different numbers."""
    names = ("x", "y", "heading", "speed", "acceleration", "yaw_rate", "length", "width")
    columns = {name: np.arange(first, first + n) + 100.0 * k for k, name in enumerate(names)}
    row = np.arange(n)
    return make_world(**columns, type=row % 3, learned=row % 2 == 0, ids=[f"u{first + i}" for i in row], time=time)


ARRAYS = [f.name for f in fields(WorldState) if f.name not in ("time", "ids")]


def test_take_reorders_every_array_alike() -> None:
    world = numbered(5, 0, 2.0)
    taken = world.take(np.array([3, 0, 3]))
    assert taken.time == 2.0
    assert taken.ids == ("u3", "u0", "u3")
    assert len(taken) == 3
    for name in ARRAYS:
        assert np.array_equal(getattr(taken, name), getattr(world, name)[[3, 0, 3]]), name


def test_take_nothing_leaves_an_empty_world() -> None:
    taken = numbered(5, 0, 2.0).take(np.zeros(0, np.intp))
    assert len(taken) == 0
    assert all(len(getattr(taken, name)) == 0 for name in ARRAYS)


def test_join_puts_self_first_at_its_time() -> None:
    a, b = numbered(2, 0, 2.0), numbered(3, 10, 9.0)
    joined = a.join(b)
    assert joined.time == 2.0
    assert joined.ids == ("u0", "u1", "u10", "u11", "u12")
    for name in ARRAYS:
        assert np.array_equal(getattr(joined, name), [*getattr(a, name), *getattr(b, name)]), name
        assert getattr(joined, name).dtype == getattr(a, name).dtype, name


def test_join_with_an_empty_world_changes_nothing() -> None:
    world = numbered(3, 0, 1.0)
    for joined in (world.join(empty_world()), empty_world(1.0).join(world)):
        assert joined.ids == world.ids
        for name in ARRAYS:
            assert np.array_equal(getattr(joined, name), getattr(world, name)), name
            assert getattr(joined, name).dtype == getattr(world, name).dtype, name
