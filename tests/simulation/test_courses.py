"""Courses of all modes at once against `advance`, and who is met on them against a look at every box."""

from dataclasses import replace

import numpy as np
import pytest

from slrl_sumo.simulation.courses import HELD, MARGIN, STANDING, STEPS, Courses, courses, meeting
from slrl_sumo.world.advance import advance, halting
from slrl_sumo.world.geometry import Floats, boxes_overlap, wrap_angle
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL

MODES = 6


def crowd(n: int, seed: int, extent: float) -> WorldState:
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


def drawn_courses(users: WorldState, seed: int, *, halts: bool = True) -> tuple[Courses, Floats, Floats, Floats]:
    rng = np.random.default_rng(seed)
    acceleration, yaw_rate = rng.normal(0.0, 1.5, (2, len(users), MODES))
    top = np.full((len(users), 1), 9.0)
    return courses(users, acceleration, yaw_rate, top, halting=halts), acceleration, yaw_rate, top


@pytest.mark.parametrize("halts", [False, True])
def test_courses_are_those_of_advance_one_interval_after_the_other(halts: bool) -> None:
    users = crowd(40, 1, 100.0)
    found, acceleration, yaw_rate, top = drawn_courses(users, 2, halts=halts)
    for mode in range(MODES):
        state, way = users, np.zeros(len(users))
        for step in range(STEPS):
            held = step < HELD
            felt = acceleration[:, mode] if held else np.zeros(len(users))
            if halts and held:
                felt = halting(state.speed, felt, DECISION_INTERVAL)
            state = advance(state, felt, yaw_rate[:, mode] * held, top[:, 0], DECISION_INTERVAL)
            way = way + state.speed * DECISION_INTERVAL
            here = found.x[:, step, mode], found.y[:, step, mode], found.speed[:, step, mode], found.way[:, step, mode]
            assert np.allclose(here, (state.x, state.y, state.speed, way), atol=1e-9)
            assert np.abs(wrap_angle(found.heading[:, step, mode] - state.heading)).max() < 1e-9


def every_box(mine: Courses, size: Floats, excused: Floats, theirs: Floats, ego: Floats, other: Floats) -> Floats:
    """What `meeting` says, by a look at every pair, interval and mode."""
    met = np.zeros((len(size), MODES))
    for e, o in zip(ego, other, strict=True):
        for step in range(STEPS):
            for mode in range(MODES):
                x, y, heading = mine.x[e, step, mode], mine.y[e, step, mode], mine.heading[e, step, mode]
                box = np.array([[x, y, heading, *size[e]]])
                if not boxes_overlap(box, theirs[o, step][None])[0]:
                    continue
                ahead = (theirs[o, step, 0] - x) * np.cos(heading) + (theirs[o, step, 1] - y) * np.sin(heading)
                if excused[e] and not (mine.speed[e, step, mode] > STANDING and ahead > 0.0):
                    continue
                met[e, mode] = max(met[e, mode], 1.0 - step / STEPS)
    return met


@pytest.mark.parametrize("extent", [15.0, 40.0])
def test_circles_leave_out_nobody_who_is_met(extent: float) -> None:
    users = crowd(24, 3, extent)
    mine, *_ = drawn_courses(users, 4)
    # The others go on along one of their modes.
    size = np.column_stack([users.length, users.width]) + MARGIN[users.type, None]
    boxes = np.broadcast_to(size[:, None], (len(users), STEPS, 2))
    theirs = np.concatenate([np.stack([mine.x, mine.y, mine.heading], -1)[:, :, 0], boxes], -1)
    excused = np.arange(len(users)) % 3 == 0
    ego, other = np.nonzero(~np.eye(len(users), dtype=np.bool_))
    found = meeting(mine, size, excused, theirs, ego, other)
    assert np.array_equal(found, every_box(mine, size, excused, theirs, ego, other))
    # Some are met at once, some later, and some modes meet nobody.
    assert len(np.unique(found)) > 4
    assert (found == 0.0).any()


def test_nobody_to_meet() -> None:
    users = crowd(3, 5, 50.0)
    mine, *_ = drawn_courses(users, 6)
    none = np.zeros(0, np.intp)
    alone = meeting(mine, np.ones((3, 2)), np.zeros(3, np.bool_), np.zeros((3, STEPS, 5)), none, none)
    assert not alone.any()
    assert alone.shape == (3, MODES)
    empty = users.take(none)
    assert courses(empty, np.zeros((0, MODES)), np.zeros((0, MODES)), np.zeros((0, 1)), halting=True).x.shape[0] == 0
    assert replace(empty).ids == ()
