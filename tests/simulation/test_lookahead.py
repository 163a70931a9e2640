"""What modes lead to: met road users, left surfaces, speeds and turns, by hand."""

from dataclasses import replace

import numpy as np

from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.perception.observation import observe
from slrl_sumo.simulation.lookahead import HELD, look_ahead, with_ahead
from slrl_sumo.world.advance import advance
from slrl_sumo.world.roadmap import RoadMap
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.surfaces import Area, Surface, SurfaceShapes
from slrl_sumo.world.types import DECISION_INTERVAL

ROAD = RoadMap(
    SurfaceShapes((Area(Surface.ROAD, np.array([[-50.0, -4.0], [150.0, -4.0], [150.0, 4.0], [-50.0, 4.0]])),))
)


def _cars(x: list[float], y: list[float], speed: list[float]) -> WorldState:
    n = len(x)
    none = np.zeros(n)
    return WorldState(
        time=0.0,
        ids=tuple(str(i) for i in range(n)),
        type=np.zeros(n, np.int8),
        x=np.array(x),
        y=np.array(y),
        heading=none,
        speed=np.array(speed),
        acceleration=none,
        yaw_rate=none,
        length=np.full(n, 5.0),
        width=np.full(n, 1.8),
        learned=np.ones(n, np.bool_),
    )


def test_who_stands_ahead_is_met_unless_the_mode_brakes_enough(shipped_bundle: ModelBundle) -> None:
    world = _cars([0.0, 22.0], [0.0, 0.0], [8.0, 0.0])
    rows = np.array([0])
    seen = observe(world, rows, ROAD, with_image=False)
    ahead = look_ahead(shipped_bundle, seen, world, rows, ROAD)
    straight = np.abs(ahead.turn[0]) < 0.05
    slow, fast = ahead.speed[0] < 3.0, ahead.speed[0] > 7.0
    assert (ahead.meeting[0, straight & fast] > 0).all()
    assert (straight & fast).any()
    assert (ahead.meeting[0, slow] < ahead.meeting[0, straight & fast].min()).all()
    assert slow.any()
    # Nearer is sooner is worse, and who is alone meets nobody.
    nearer = replace(world, x=np.array([0.0, 12.0]))
    sooner = look_ahead(shipped_bundle, observe(nearer, rows, ROAD, False), nearer, rows, ROAD)
    assert (sooner.meeting[0, straight & fast] > ahead.meeting[0, straight & fast]).all()
    alone = world.take(rows)
    assert not look_ahead(shipped_bundle, observe(alone, rows, ROAD, False), alone, rows, ROAD).meeting.any()
    # Who drives away in front at the same speed is not met by modes that keep it.
    going = replace(world, speed=np.array([8.0, 8.0]))
    after = look_ahead(shipped_bundle, observe(going, rows, ROAD, False), going, rows, ROAD)
    assert (after.meeting[0, straight & (ahead.speed[0] < 9.0)] == 0).all()


def test_turning_off_the_road_counts_and_straight_on_does_not(shipped_bundle: ModelBundle) -> None:
    world, rows = _cars([0.0], [0.0], [8.0]), np.array([0])
    ahead = look_ahead(shipped_bundle, observe(world, rows, ROAD, False), world, rows, ROAD)
    turn, off = np.abs(ahead.turn[0]), ahead.off_surface[0]
    assert (off[turn < 0.02] == 0).all()
    assert (off[turn > 0.7] > 0.2).all()
    assert (turn > 0.7).any()


def test_speeds_and_turns_are_those_of_advance(shipped_bundle: ModelBundle) -> None:
    world, rows = _cars([0.0], [0.0], [6.0]), np.array([0])
    seen = observe(world, rows, ROAD, False)
    ahead = look_ahead(shipped_bundle, seen, world, rows, ROAD)
    for mode in (0, 7, 19):
        acceleration, yaw_rate = shipped_bundle.motion(seen, np.array([mode]))
        state = world
        for _ in range(HELD):
            state = advance(state, acceleration, yaw_rate, shipped_bundle.max_speed[:1], DECISION_INTERVAL)
        np.testing.assert_allclose(ahead.speed[0, mode], state.speed[0])
        np.testing.assert_allclose(np.cos(ahead.turn[0, mode]), np.cos(state.heading[0]))


def test_rows_are_looked_at_wherever_they_stand(shipped_bundle: ModelBundle) -> None:
    world = _cars([0.0, 18.0, 60.0, 75.0], [0.0, 0.5, 0.0, 0.0], [8.0, 1.0, 9.0, 2.0])
    every = np.arange(4)
    whole = with_ahead(shipped_bundle, observe(world, every, ROAD, False), world, every, ROAD).ahead
    some = np.array([2, 0])
    part = with_ahead(shipped_bundle, observe(world, some, ROAD, False), world, some, ROAD).ahead
    assert whole is not None
    np.testing.assert_allclose(part, whole[some], atol=1e-5)
    assert whole[[0, 2], :, 0].max(axis=1).min() > 0
