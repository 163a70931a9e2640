"""What modes lead to: met road users, left surfaces, speeds and turns, by hand."""

from dataclasses import replace

import numpy as np
import pytest
from builders import ALONG, make_routes, make_world
from numpy.typing import NDArray

from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Area, Surface, SurfaceShapes
from slrl_sumo.lookahead.mode_paths import HELD
from slrl_sumo.lookahead.mode_rollouts import ModeRollouts, mode_rollouts
from slrl_sumo.lookahead.route_fit import AIM, COMFORT_SHARE, HEADWAY, MAX_RATIO, RETURN, SLOW, RouteFit, _ratio
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import SPEEDS, STOPPING, Capability
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.perception.leaders import BRAKES, Leaders
from slrl_sumo.perception.observation import observe
from slrl_sumo.perception.route_context import (
    GAP,
    STOP_MARGIN,
    RouteContext,
    route_context,
    stop_distances,
)
from slrl_sumo.perception.scene import Scene
from slrl_sumo.scene.advance import advance, halting
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import POINTS, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

NO_ROWS = np.zeros(0, np.int64)
ABLE = Capability(np.ones((3, 2, len(SPEEDS))), np.broadcast_to(STOPPING**2 / 4.0, (3, len(STOPPING))))
"""All brake with 2 m/s²."""

PAPER, EXTENDED = (PolicyConfig(preset=preset).rollout_features for preset in ("paper", "extended"))

ROAD = RoadMap(
    SurfaceShapes((Area(Surface.ROAD, np.array([[-50.0, -4.0], [150.0, -4.0], [150.0, 4.0], [-50.0, 4.0]])),))
)


def _cars(x: list[float], y: list[float], speed: list[float]) -> WorldState:
    return make_world(x, y, speed=speed)


def _leading(gap: Floats, speed: Floats, row: NDArray[np.int64]) -> Leaders:
    """Leaders without other road users on the paths."""
    return Leaders(gap, speed, row, gap + speed**2 / (2.0 * BRAKES), speed, NO_ROWS)


def _rolled_out(
    bundle: ModelBundle, world: WorldState, rows: NDArray[np.intp], context: RouteContext | None = None, **words: bool
) -> ModeRollouts:
    """All modes of the road users `rows`; `context` is completed by what `world` says."""
    scene = Scene(world, rows, ROAD, None if context is None else context.route)
    if context is not None:
        gap, speed = context.leader_gap, context.leader_speed
        row = np.where(np.isfinite(gap), len(world), -1)  # not one of the learned road users
        stop, follow = stop_distances(context.route, world, _leading(gap, speed, row))
        context = replace(
            route_context(context.route, world),
            leader_gap=gap,
            leader_speed=speed,
            stop_distance=stop,
            follow_distance=follow,
            follow_speed=speed,
        )
    return mode_rollouts(bundle, observe(scene, with_image=False), scene, context, ABLE, **words)


def test_a_standing_leader_is_hit_unless_the_mode_brakes_enough(shipped_bundle: ModelBundle) -> None:
    world = _cars([0.0, 22.0], [0.0, 0.0], [8.0, 0.0])
    rows = np.array([0])
    ahead = _rolled_out(shipped_bundle, world, rows)
    straight = np.abs(ahead.turn[0]) < 0.05
    slow, fast = ahead.speed[0] < 3.0, ahead.speed[0] > 7.0
    assert (ahead.collision[0, straight & fast] > 0).all()
    assert (straight & fast).any()
    assert (ahead.collision[0, slow] < ahead.collision[0, straight & fast].min()).all()
    assert slow.any()
    # Nearer is sooner is worse, and a road user alone hits nothing.
    nearer = replace(world, x=np.array([0.0, 12.0]))
    sooner = _rolled_out(shipped_bundle, nearer, rows)
    assert (sooner.collision[0, straight & fast] > ahead.collision[0, straight & fast]).all()
    alone = world.take(rows)
    assert not _rolled_out(shipped_bundle, alone, rows).collision.any()
    # A road user in front that drives away at the same speed is not met by modes that keep it.
    going = replace(world, speed=np.array([8.0, 8.0]))
    after = _rolled_out(shipped_bundle, going, rows)
    assert (after.collision[0, straight & (ahead.speed[0] < 9.0)] == 0).all()


def test_pedestrians_meet_others_where_they_are_and_vehicles_where_they_expect_them(
    shipped_bundle: ModelBundle,
) -> None:
    """The third road user waits beside the path of the first one, and is expected beside that of the second one."""
    kinds = [RoadUserType.PEDESTRIAN, RoadUserType.CAR, RoadUserType.PEDESTRIAN]
    world = make_world([0.0, 0.0, 6.0], [0.0, 40.0, 40.0], speed=[1.3, 5.0, 0.0], type=kinds)
    scene = Scene(world, np.arange(2), ROAD)
    told = replace(scene, places=(np.array([0.0, 0.0, 2.0]), np.array([0.0, 40.0, 0.0])))
    seen = observe(scene, with_image=False)
    for direct in (False, True):
        before, after = (mode_rollouts(shipped_bundle, seen, one, off_route=direct) for one in (scene, told))
        assert before.collision[0].max() == 0.0
        assert after.collision[0].max() > 0.0
        assert before.collision[1].max() > 0.0
        np.testing.assert_array_equal(after.collision[1], before.collision[1])
    assert before.collision_off_route is not None
    assert after.collision_off_route is not None
    np.testing.assert_array_equal(after.collision_off_route, after.collision)


def test_turning_off_the_road_counts_and_straight_on_does_not(shipped_bundle: ModelBundle) -> None:
    world, rows = _cars([0.0], [0.0], [8.0]), np.array([0])
    ahead = _rolled_out(shipped_bundle, world, rows)
    turn, off = np.abs(ahead.turn[0]), ahead.off_surface[0]
    assert (off[turn < 0.02] == 0).all()
    leaves = (turn > 0.7) & (ahead.speed[0] > 4.0)
    assert (off[leaves] > 0.2).all()
    assert leaves.any()


def test_speeds_and_turns_are_those_of_advance(shipped_bundle: ModelBundle) -> None:
    world, rows = _cars([0.0], [0.0], [6.0]), np.array([0])
    seen = observe(Scene(world, rows, ROAD), with_image=False)
    ahead = _rolled_out(shipped_bundle, world, rows)
    for mode in (0, 7, 19):
        acceleration, yaw_rate = shipped_bundle.motion(seen, np.array([mode]))
        np.testing.assert_allclose(ahead.acceleration[:, mode], acceleration, atol=1e-6)
        np.testing.assert_allclose(ahead.yaw_rate[:, mode], yaw_rate, atol=1e-6)
        state = world
        for _ in range(HELD):
            state = advance(state, acceleration, yaw_rate, shipped_bundle.max_speed[:1], DECISION_INTERVAL)
        np.testing.assert_allclose(ahead.speed[0, mode], state.speed[0])
        np.testing.assert_allclose(np.cos(ahead.turn[0, mode]), np.cos(state.heading[0]), atol=1e-6)  # float32


def test_rows_are_looked_at_wherever_they_stand(shipped_bundle: ModelBundle) -> None:
    world = _cars([0.0, 18.0, 60.0, 75.0], [0.0, 0.5, 0.0, 0.0], [8.0, 1.0, 9.0, 2.0])
    every = np.arange(4)
    whole = _rolled_out(shipped_bundle, world, every).columns(PAPER)
    some = np.array([2, 0])
    part = _rolled_out(shipped_bundle, world, some).columns(PAPER)
    np.testing.assert_allclose(part, whole[some], atol=1e-5)
    assert whole[[0, 2], :, 0].max(axis=1).min() > 0


def _walking_past(bundle: ModelBundle, turned: float, yaw_rate: float = 0.0) -> Floats:
    """Collision scores of the modes that go straight on of a person at 1.4 m/s; another one, turned by `turned` (rad),
    stands 1.5 m ahead and 0.45 m beside, or, with a `yaw_rate` (rad/s), comes towards it from 4 m ahead."""
    meets = yaw_rate != 0.0
    world = make_world(
        [0.0, 4.0 if meets else 1.5],
        [0.0, 0.0 if meets else 0.45],
        heading=[0.0, turned],
        speed=[1.4, 1.4 if meets else 0.0],
        yaw_rate=[0.0, yaw_rate],
        type=RoadUserType.PEDESTRIAN,
    )
    rolled_out = _rolled_out(bundle, world, np.array([0]), _context(0.0, desired_speed=1.4))
    straight = (np.abs(rolled_out.turn[0]) < 0.1) & (rolled_out.speed[0] > 1.2)
    assert straight.any()
    return rolled_out.collision[0, straight]


@pytest.mark.parametrize("turned", [0.0, 0.5 * np.pi])
def test_persons_are_met_whichever_way_they_face(shipped_bundle: ModelBundle, turned: float) -> None:
    """0.45 m between centres is a contact; boxes of 0.2 m by 0.5 m across each other did not touch."""
    assert (_walking_past(shipped_bundle, turned) > 0.4).all()


def test_a_person_that_turns_now_is_expected_straight_ahead(shipped_bundle: ModelBundle) -> None:
    """At 3 rad/s it was expected on a circle of 1 m."""
    assert (_walking_past(shipped_bundle, np.pi, yaw_rate=3.0) > 0.4).all()


def _context(*x: float, gap: float = np.inf, leading: float = 0.0, **columns: float) -> RouteContext:
    """Of road users whose places on one path along the x axis are at `x`; all the same otherwise."""
    n = len(x)
    route = make_routes(np.array(x)[:, None] + ALONG, **{"desired_speed": 8.0, **columns})
    none, queues = np.zeros(n), np.zeros(n, np.bool_)
    return RouteContext(
        route, none, none, none, np.full(n, gap), np.full(n, leading), queues, none, none, none, NO_ROWS
    )


def _on_route(bundle: ModelBundle, world: WorldState, context: RouteContext) -> tuple[ModeRollouts, RouteFit]:
    rows = np.arange(len(context.route))
    ahead = _rolled_out(bundle, world, rows, context)
    assert ahead.route is not None
    return ahead, ahead.route


def _after(bundle: ModelBundle, world: WorldState, steps: int) -> list[WorldState]:
    """A single road user after some intervals of each mode."""
    seen = observe(Scene(world, np.array([0]), ROAD), with_image=False)
    states = []
    for mode in range(bundle.config.modes):
        acceleration, yaw_rate = bundle.motion(seen, np.array([mode]))
        state = world
        for _ in range(steps):
            felt = halting(state.speed, acceleration, DECISION_INTERVAL)
            state = advance(state, felt, yaw_rate, bundle.max_speed[world.type], DECISION_INTERVAL)
        states.append(state)
    return states


def _speeds(states: list[WorldState]) -> Floats:
    return np.array([float(state.speed[0]) for state in states])


@pytest.mark.parametrize("beside", [1.5, -1.5, 0.0])
def test_the_best_mode_leads_back_to_the_path(shipped_bundle: ModelBundle, beside: float) -> None:
    world = _cars([0.0], [beside], [6.0])
    ahead, fits = _on_route(shipped_bundle, world, _context(0.0))
    best = int(fits.heading_error[0].argmin())
    if beside:
        assert ahead.turn[0, best] * beside < -0.05
        assert abs(fits.lateral_offset[0, best]) < abs(beside) - 0.05
    else:
        assert abs(ahead.turn[0, best]) < 0.05
        assert abs(fits.lateral_offset[0, best]) < 0.05
    states = _after(shipped_bundle, world, 1)
    aside, heading = (np.array([getattr(s, name)[0] for s in states]) for name in ("y", "heading"))
    assert fits.lateral_offset[0] == pytest.approx(aside, abs=1e-6)
    aim = np.clip(np.arctan(RETURN * aside / (_speeds(states) + SLOW)), -AIM, AIM)
    assert fits.heading_error[0] == pytest.approx(np.abs(heading + aim), abs=1e-6)


def test_the_way_back_is_to_the_path_wherever_it_points(shipped_bundle: ModelBundle) -> None:
    world, context = _cars([0.0], [1.0], [6.0]), _context(0.0)
    _, along = _on_route(shipped_bundle, world, context)
    turned = replace(world, x=np.array([-1.0]), y=np.zeros(1), heading=np.array([0.5 * np.pi]))
    route = replace(context.route, x=np.zeros((1, POINTS)), y=np.array([ALONG]))
    _, north = _on_route(shipped_bundle, turned, replace(context, route=route))
    # The heading itself is a feature, so that modes differ a little.
    assert north.lateral_offset[0] == pytest.approx(along.lateral_offset[0], abs=0.3)
    assert int(north.heading_error[0].argmin()) == int(along.heading_error[0].argmin())


def test_a_closed_line_is_too_near_for_modes_that_speed_up(shipped_bundle: ModelBundle) -> None:
    world = _cars([0.0], [0.0], [6.0])
    first, second = (_speeds(_after(shipped_bundle, world, steps)) for steps in (1, 2))
    # From 6 m/s it needs 9 m, and has 12.5 m less the spare one and what it covers in between.
    ahead, fits = _on_route(shipped_bundle, world, _context(0.0, stop=12.5, line=13.5))
    room = 12.5 - STOP_MARGIN[0] - DECISION_INTERVAL * first
    assert fits.stop_ratio[0] == pytest.approx(first**2 / 4.0 / room, rel=0.01)
    assert (fits.stop_ratio[0, ahead.speed[0] > 6.5] > 1.0).all()
    assert (ahead.speed[0] > 6.5).any()
    assert (fits.stop_ratio[0, first < 5.5] < 1.0).all()
    assert (first < 5.5).any()
    # It wants to be able to stop within a share of the way, and is never asked for more than desired.
    allowed = np.minimum(
        np.sqrt(4.0 * COMFORT_SHARE * (12.5 - STOP_MARGIN[0] - DECISION_INTERVAL * (first + second))), 8.0
    )
    assert fits.speed_error[0] == pytest.approx(np.clip((second - allowed) / allowed, -1.0, 1.0), abs=0.01)
    _, free = _on_route(shipped_bundle, world, _context(0.0))
    assert free.speed_error[0] == pytest.approx(np.clip((second - 8.0) / 8.0, -1.0, 1.0), abs=1e-6)
    assert not free.stop_ratio.any()
    assert not free.follow_ratio.any()


def test_at_the_line_standing_is_required(shipped_bundle: ModelBundle) -> None:
    world = _cars([0.0], [0.0], [1.0])
    second = _speeds(_after(shipped_bundle, world, 2))
    _, fits = _on_route(shipped_bundle, world, _context(0.0, stop=1.2, line=2.2))
    assert fits.speed_error[0] == pytest.approx(np.minimum(second, 1.0), abs=1e-6)
    standing = second == 0.0
    assert standing.any()
    assert (fits.speed_error[0, standing] == 0.0).all()
    assert (fits.speed_error[0, ~standing] > 0.0).all()
    # Beyond it brakes as hard as it can say.
    _, past = _on_route(shipped_bundle, _cars([0.0], [0.0], [8.0]), _context(0.0, stop=-0.5, line=0.5))
    assert past.stop_ratio[0].max() == MAX_RATIO


@pytest.mark.parametrize("leading", [0.0, 8.0])
def test_leaders_are_followed_at_a_distance(shipped_bundle: ModelBundle, leading: float) -> None:
    world = _cars([0.0], [0.0], [6.0])
    first = _speeds(_after(shipped_bundle, world, 1))
    ahead, fits = _on_route(shipped_bundle, world, _context(0.0, gap=14.5, leading=leading))
    # It stops where the leader would, if that braked, less the gap, the headway, and what it covers in between.
    behind = 14.5 - GAP[0] + leading**2 / (2.0 * BRAKES) + leading * DECISION_INTERVAL
    room = behind - (DECISION_INTERVAL + HEADWAY[0]) * first
    assert fits.follow_ratio[0] == pytest.approx(first**2 / 4.0 / room, rel=0.01)
    quick = ahead.speed[0] > 7.0
    assert quick.any()
    assert (fits.follow_ratio[0, quick] > 1.0).all() == (leading == 0.0)
    assert not fits.stop_ratio.any()
    # Pedestrians stand closer.
    walker = replace(world, type=np.array([RoadUserType.PEDESTRIAN], np.int8), speed=np.ones(1))
    step = _speeds(_after(shipped_bundle, walker, 1))
    _, walks = _on_route(shipped_bundle, walker, _context(0.0, gap=2.0))
    quickest = step.argmax()
    room = 2.0 - GAP[2] - (DECISION_INTERVAL + HEADWAY[2]) * step[quickest]
    assert walks.follow_ratio[0, quickest] == pytest.approx(step[quickest] ** 2 / 4.0 / room, rel=0.01)


def test_ratios() -> None:
    room = [10.0, 4.0, 0.31, 0.0, -3.0, np.inf]
    assert [_ratio(2.0, one) for one in room] == pytest.approx([0.2, 0.5, 2 / 0.31, 2 / 0.3, 2 / 0.3, 0.0])
    assert _ratio(9.0, 0.0) == MAX_RATIO
    assert _ratio(0.0, 0.0) == 0.0


def test_junctions_whose_exits_are_taken_are_kept_clear() -> None:
    # Lines at 10 m, exits at 25 m; cars of 5 m need 31.5 m.
    gap = np.array([31.0, 32.0, 9.0, 31.0, 31.0, 31.0, 31.0])
    speed = np.array([0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0])
    line = np.array([10.0, 10.0, 10.0, 10.0, 0.8, np.inf, 10.0])
    out = np.array([25.0, 25.0, 25.0, 25.0, 15.8, np.inf, 25.0])
    stop = np.array([np.inf, np.inf, np.inf, np.inf, np.inf, 50.0, 4.0])
    route = replace(RouteAhead.unknown(7), stop=stop, keep_clear_line=line, keep_clear_exit=out)
    ahead = _leading(gap, speed, np.full(7, 7))
    stop, _ = stop_distances(route, _cars([0.0] * 7, [0.0] * 7, [0.0] * 7), ahead)
    assert (stop + STOP_MARGIN[0]).tolist() == [9.0, np.inf, np.inf, np.inf, np.inf, 50.0, 4.0]


def test_behind_one_that_waits_inside_there_is_room_for_a_whole_vehicle() -> None:
    # Lines at 2 m, waiting positions at 12 m, exits at 25 m; cars of 5 m keep 1.5 m.
    gap = np.array([9.0, 8.0, 14.0, 9.0])
    wait = np.array([12.0, 12.0, 12.0, -np.inf])
    route = replace(
        RouteAhead.unknown(4), keep_clear_line=np.full(4, 2.0), keep_clear_exit=np.full(4, 25.0), waiting_position=wait
    )
    ahead = _leading(gap, np.zeros(4), np.full(4, 4))
    stop, _ = stop_distances(route, _cars([0.0] * 4, [0.0] * 4, [0.0] * 4), ahead)
    # The second one would stand over the line, the third one beyond the position, the fourth one has none.
    assert (stop + STOP_MARGIN[0]).tolist() == [np.inf, 1.0, 1.0, 1.0]


def test_a_leader_that_will_stand_takes_the_exit_as_well() -> None:
    """Three cars one behind the other, the first of which has to stop 20 m ahead: the third has no room beyond."""
    n = 3
    route = replace(
        RouteAhead.unknown(n), stop=np.array([20.0, np.inf, np.inf]), keep_clear_line=np.array([np.inf, np.inf, 4.0])
    )
    route = replace(route, keep_clear_exit=np.array([np.inf, np.inf, 24.0]))
    ahead = _leading(np.array([np.inf, 3.0, 4.0]), np.full(n, 6.0), np.array([-1, 0, 1]))
    still = ahead._replace(gap=np.array([np.inf, 13.0, 14.0]))
    cars = _cars([0.0] * n, [0.0] * n, [6.0] * n)
    # It will stand after 20 + (3 - 1.5) + (4 - 1.5) m = 24 m, and needs 29 m; with 20 m more it has room.
    assert stop_distances(route, cars, ahead)[0][2] + STOP_MARGIN[0] == 3.0
    assert stop_distances(route, cars, still)[0][2] == np.inf


def test_routes_lead_round_corners_to_standing_road_users(shipped_bundle: ModelBundle) -> None:
    # 8 m eastwards, then to the left, where a road user stands; straight on there is none.
    world = _cars([0.0, 8.0], [0.0, 12.0], [7.0, 0.0])
    context = _context(0.0)
    x, y = np.minimum(ALONG, 8.0)[None], np.maximum(ALONG - 8.0, 0.0)[None]
    context = replace(context, route=replace(context.route, x=x, y=y))
    ahead, _ = _on_route(shipped_bundle, world, context)
    quick, slow = ahead.speed[0] > 7.0, ahead.speed[0] < 1.0
    assert (ahead.collision[0, quick] > 0.0).all()
    assert (ahead.collision[0, slow] == 0.0).all()
    assert quick.any()
    assert slow.any()
    rows = np.array([0])
    wandering = _rolled_out(shipped_bundle, world, rows)
    assert (wandering.collision[0, np.abs(ahead.turn[0]) < 0.1] == 0.0).all()


def test_leaving_the_route_straight_on_touches_a_road_user_beyond_the_corner(shipped_bundle: ModelBundle) -> None:
    # 6 m eastwards, then to the left; a road user stands straight ahead, where the path does not lead.
    world = _cars([0.0, 12.0], [0.0, 0.0], [7.0, 0.0])
    x, y = np.minimum(ALONG, 6.0)[None], np.maximum(ALONG - 6.0, 0.0)[None]
    context = _context(0.0)
    context = replace(context, route=replace(context.route, x=x, y=y))
    rows = np.array([0])
    ahead = _rolled_out(shipped_bundle, world, rows, context, off_route=True)
    assert ahead.collision_off_route is not None
    straight = (ahead.speed[0] > 6.0) & (np.abs(ahead.turn[0]) < 0.1)
    assert straight.any()
    assert (ahead.collision[0, straight] == 0.0).all()
    assert (ahead.collision_off_route[0, straight] >= 0.5).all()
    assert (ahead.collision_off_route[0, ahead.speed[0] < 1.0] == 0.0).all()
    assert _rolled_out(shipped_bundle, world, rows, context).collision_off_route is None


def test_leaving_the_ground_at_the_end_of_the_path_is_right(shipped_bundle: ModelBundle) -> None:
    world = _cars([145.0], [0.0], [8.0])
    rows = np.array([0])
    wandering = _rolled_out(shipped_bundle, world, rows)
    ahead, _ = _on_route(shipped_bundle, world, _context(145.0))
    quick = wandering.speed[0] > 7.0
    assert quick.any()
    assert (wandering.off_surface[0, quick] > 0.0).all()
    assert (ahead.off_surface[0, quick] == 0.0).all()
    # Beside the road it is wrong.
    beside = _cars([60.0], [6.0], [8.0])
    off, _ = _on_route(shipped_bundle, beside, _context(60.0))
    assert (off.off_surface[0] > 0.0).all()


def test_columns_belong_to_their_rows_and_are_zero_without_a_route(shipped_bundle: ModelBundle) -> None:
    world = _cars([0.0, 40.0, 80.0], [0.5, 0.0, -0.5], [5.0, 6.0, 7.0])
    context = _context(0.0, 40.0, 80.0, stop=9.0, gap=12.0)
    known = np.array([True, False, True])
    context = replace(context, route=replace(context.route, known=known))
    every = np.arange(3)
    whole = _rolled_out(shipped_bundle, world, every, context).columns(EXTENDED)
    some = np.array([2, 1])
    part = _rolled_out(shipped_bundle, world, some, context).columns(EXTENDED)
    assert whole.shape == (3, shipped_bundle.config.modes, 9)
    np.testing.assert_allclose(part, whole[some], atol=1e-5)
    assert not whole[1, :, 4:].any()
    assert (np.abs(whole[known, :, 4:]).max(axis=1) > 0.0).all()
    without = _rolled_out(shipped_bundle, world, every).columns(EXTENDED)
    assert without.shape == whole.shape
    assert not without[..., 4:].any()
