"""Paths and speeds that ask no more of models than they can do, against a second way to draw them."""

from dataclasses import replace

import numpy as np
import pytest
from builders import ALONG, make_routes, make_world

from slrl_sumo.agent.path_smoothing import (
    BEST_TURNING,
    BRAKING,
    CHORD,
    COMFORT,
    FOLLOWED,
    NEIGHBOURS,
    PASSES,
    REACTION,
    ROUNDED,
    SLOWEST,
    SPARE,
    STRAIGHT,
    TIGHT,
    smooth_paths,
)
from slrl_sumo.models.capability import SPEEDS, STOPPING, Capability
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import AHEAD, HERE, POINTS, SPACING, RouteAhead, spacing_at
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

CAR, BICYCLE, PEDESTRIAN = (int(kind) for kind in RoadUserType)


def fitted(route: RouteAhead, users: WorldState, capability: Capability) -> RouteAhead:
    """Smoothed paths, where they are reported as changed exactly if they are."""
    smoothed, changed = smooth_paths(route, users, capability)
    moved = (
        (smoothed.x != route.x).any(1)
        | (smoothed.y != route.y).any(1)
        | (smoothed.desired_speed != route.desired_speed)
    )
    np.testing.assert_array_equal(changed, moved)
    return smoothed


def users(*rows: tuple[int, float]) -> WorldState:
    """Types and speeds; all at the origin."""
    kind, speed = zip(*rows, strict=True)
    return make_world(speed=speed, type=kind, length=5.0, width=1.8)


def routes(*points: tuple[Floats, Floats], desired_speed: float = 13.0) -> RouteAhead:
    x, y = zip(*points, strict=True)
    return make_routes(x, y, desired_speed=desired_speed, stop=np.arange(len(points)))


def corner(turn: float, after: float = 15.0) -> tuple[Floats, Floats]:
    """Eastwards, and `after` m on by `turn` to the left."""
    beyond = np.maximum(ALONG - after, 0.0)
    return np.minimum(ALONG, after) + beyond * np.cos(turn), beyond * np.sin(turn)


def circle(radius: float) -> tuple[Floats, Floats]:
    """Eastwards through the origin; radius > 0: to the left."""
    return radius * np.sin(ALONG / radius), radius - radius * np.cos(ALONG / radius)


def straight(heading: float) -> tuple[Floats, Floats]:
    return ALONG * np.cos(heading), ALONG * np.sin(heading)


def curvature(route: RouteAhead) -> Floats:
    """How sharply the paths turn to the left, 1/m, (n, POINTS): from one chord to the next, over their mean length."""
    path = route.x + 1j * route.y
    chord = path[:, CHORD:] - path[:, :-CHORD]
    turn = np.angle(chord[:, CHORD:] * chord[:, :-CHORD].conj())
    sharp = np.zeros(path.shape)
    sharp[:, CHORD:-CHORD] = turn / np.maximum(0.5 * np.abs(chord[:, CHORD:]) + 0.5 * np.abs(chord[:, :-CHORD]), 0.1)
    return sharp


def test_curvatures() -> None:
    signed = curvature(routes(straight(2.0), circle(12.0), circle(-30.0), corner(np.pi / 3, after=10.0)))
    inner = slice(CHORD, -CHORD)
    assert signed[0] == pytest.approx(0.0, abs=1e-9)
    # Chords of 3 m are shorter than their arcs: 1 part in 400 on a radius of 12 m.
    assert signed[1, inner] == pytest.approx(1 / 12, rel=5e-3)
    assert signed[2, inner] == pytest.approx(-1 / 30, rel=5e-3)
    assert np.abs(signed[:, :CHORD]).max() == np.abs(signed[:, -CHORD:]).max() == 0.0
    # A corner is spread over the chords beside it, and nothing of it is lost.
    sharp = np.flatnonzero(np.abs(signed[3]) > 1e-9)
    assert sharp.min() >= HERE + 10 - CHORD
    assert sharp.max() <= HERE + 10 + CHORD
    assert signed[3].argmax() == HERE + 10
    assert signed[3].sum() * SPACING == pytest.approx(np.pi / 3, rel=0.15)
    assert signed[3].max() == pytest.approx(np.pi / 3 / CHORD)


def able(right: float, left: float, fade: float = 0.0) -> Capability:
    """All types can take such curves (1/m) at 1 m/s, and `fade` less for each m/s more; 1 m a stand for each m/s."""
    sides = np.maximum(np.array([right, left])[:, None] - fade * (SPEEDS - SPEEDS[0]), 0.0)
    return Capability(np.broadcast_to(sides, (3, 2, len(SPEEDS))), np.broadcast_to(STOPPING, (3, len(STOPPING))))


def test_corners_become_as_round_as_they_can_be_driven() -> None:
    limit = 0.135
    before = routes(corner(np.pi / 5), corner(-np.pi / 5), corner(np.pi / 5, after=20.0))
    after = fitted(before, users((CAR, 5.0), (BICYCLE, 5.0), (CAR, 5.0)), able(limit, limit))
    assert np.abs(curvature(before)).max(axis=1).min() > 1.5 * limit
    assert np.abs(curvature(after)).max() <= SPARE * limit + 1e-12
    # No rounder than it must be, and the whole turn is still there.
    assert np.abs(curvature(after)).max(axis=1).min() > 0.7 * limit
    for path in (after.x, after.y):
        start = before.x if path is after.x else before.y
        np.testing.assert_array_equal(path[:, [0, -1]], start[:, [0, -1]])
        # 8 m before the corner, and as far behind it, nothing has changed.
        np.testing.assert_array_equal(path[:, : HERE + 5], start[:, : HERE + 5])
        np.testing.assert_array_equal(path[:, HERE + 30 :], start[:, HERE + 30 :])
    # Corners are cut on their inside.
    assert after.x[0, HERE + 15] < 14.9
    assert after.y[0, HERE + 15] > 0.2
    # Where a circle of that radius touched both legs, it passed 0.052 of it from the corner.
    assert np.hypot(after.x - before.x, after.y - before.y).max() < 1.3 * 0.052 / (SPARE * limit)
    # Everything else is kept, and what was given is left alone.
    assert after.stop.tolist() == [0.0, 1.0, 2.0]
    assert before.x[0, HERE + 15] == 15.0


def test_ends_of_paths_stay_however_near_a_corner_is() -> None:
    before = routes(corner(0.8, after=-4.0), corner(0.8, after=36.0), corner(-0.8, after=-4.0))
    after = fitted(before, users((CAR, 5.0), (CAR, 5.0), (CAR, 5.0)), able(0.2, 0.2))
    assert (np.hypot(after.x - before.x, after.y - before.y).max(axis=1) > 0.2).all()
    np.testing.assert_array_equal(after.x[:, [0, -1]], before.x[:, [0, -1]])
    np.testing.assert_array_equal(after.y[:, [0, -1]], before.y[:, [0, -1]])


def test_only_what_is_too_sharp_to_that_side_is_rounded_and_never_walks() -> None:
    shapes = [corner(0.0), corner(0.5), corner(-0.5), circle(9.0), corner(-1.5), corner(1.5)]
    before = routes(*shapes)
    before = replace(before, known=np.array([True, True, True, True, True, False]))
    kinds = (CAR, CAR, CAR, BICYCLE, PEDESTRIAN, CAR)
    after = fitted(before, users(*((kind, 4.0) for kind in kinds)), able(right=0.1, left=0.25))
    moved = np.hypot(after.x - before.x, after.y - before.y).max(axis=1)
    assert (moved > 0.0).tolist() == [False, False, True, False, False, False]
    assert -curvature(after)[2].min() <= SPARE * 0.1 + 1e-12
    # A corner of 0.5 rad is 0.5 / CHORD sharp.
    assert curvature(after)[1].max() == pytest.approx(0.5 / CHORD)
    assert after.desired_speed[4:].tolist() == [13.0, 13.0]


def test_speeds_in_curves() -> None:
    # 1/m: 0.3 at 1 m/s, and 0.02 less for each m/s more; a radius of 8 m needs 0.125 of 0.95 of it: 9.4 m/s and less.
    limits = able(0.3, 0.3, fade=0.02)
    around = routes(circle(8.0), circle(-8.0), circle(60.0), corner(0.0))
    after = fitted(around, users(*[(CAR, 6.0)] * 4), limits)
    sharp = np.abs(curvature(around)[0, HERE])
    possible = SPEEDS[limits.sharpest[0, 0] * SPARE >= sharp].max()
    assert possible == 9.0
    # What is uncomfortable comes first: 3 m/s² across are 4.9 m/s there, and 13.4 m/s with a radius of 60 m.
    assert after.desired_speed[:2] == pytest.approx(np.sqrt(COMFORT * 8.0), rel=0.01)
    assert after.desired_speed[2:].tolist() == [13.0, 13.0]
    # Where less is possible, that counts.
    after = fitted(around, users(*[(CAR, 6.0)] * 4), able(0.3, 0.3, fade=0.05))
    assert after.desired_speed[:2].tolist() == [4.0, 4.0]
    # Sides differ, and the least speed is that of a walk.
    uneven = fitted(around, users(*[(BICYCLE, 6.0)] * 4), able(0.15, 0.3, fade=0.05))
    assert uneven.desired_speed[:2].tolist() == [4.0, SLOWEST]
    slow = fitted(routes(circle(1.5), circle(2.0)), users((CAR, 6.0), (CAR, 6.0)), able(0.01, 0.01))
    assert (slow.desired_speed >= SLOWEST).all()
    assert (slow.desired_speed <= np.sqrt(COMFORT * 2.0)).all()
    # Too sharp at any speed: the highest of those at which they turn best, for slower ones do not help.
    keen = fitted(routes(corner(2.5)), users((CAR, 6.0)), able(0.05, 0.05))
    assert keen.desired_speed[0] > SLOWEST


def banded(path: Floats, right: float, left: float) -> tuple[Floats, Floats]:
    """One path (x + iy) drawn like an elastic band as the text says it, all points at once, and its curvature."""
    for _ in range(PASSES):
        curve = curvature(routes((path.real, path.imag)))[0]
        sharp = (curve > left) | (curve < -right)
        if not sharp.any():
            break
        moved = [k for k in range(1, POINTS - 1) if sharp[max(k - NEIGHBOURS, 0) : k + NEIGHBOURS + 1].any()]
        path = path.copy()
        path[moved] += 0.25 * (path[[k + 1 for k in moved]] - 2.0 * path[moved] + path[[k - 1 for k in moved]])
    return path, curvature(routes((path.real, path.imag)))[0]


def test_crooked_paths_and_their_speeds_against_a_second_way() -> None:
    rng = np.random.default_rng(2)
    n = 40
    turns = np.where(
        rng.random((n, POINTS)) < 0.08, rng.uniform(-1.6, 1.6, (n, POINTS)), rng.normal(0, 2e-3, (n, POINTS))
    )
    heading = turns.cumsum(axis=1)
    before = routes(
        *zip(np.cos(heading).cumsum(axis=1), np.sin(heading).cumsum(axis=1), strict=True), desired_speed=40.0
    )
    kinds, speeds = rng.integers(0, 2, n), rng.uniform(0.0, 15.0, n)
    limits = able(0.2, 0.3, fade=0.02)
    after = fitted(before, users(*zip(kinds.tolist(), speeds.tolist(), strict=True)), limits)
    possible, tight = SPARE * limits.sharpest[0], 0
    for i in range(n):
        drawn = before.x[i] + 1j * before.y[i]
        path, _ = banded(drawn, *possible[:, 0])
        # A turn that would be cut too much is followed as it is.
        far = np.abs(path - drawn)[HERE:].max() > FOLLOWED
        tight += far
        path = banded(drawn, TIGHT, TIGHT)[0] if far else path
        assert np.abs(after.x[i] + 1j * after.y[i] - path).max() < 1e-9
        least = np.inf
        for way, curve in enumerate(driven(path)[HERE:]):
            can = possible[int(curve > 0.0)]
            fast = SPEEDS[(can >= np.abs(curve)) | (can >= BEST_TURNING * can[0])].max()
            allowed = SPEEDS[-1] if abs(curve) < STRAIGHT else min(fast, np.sqrt(COMFORT / abs(curve)))
            early = max(way * SPACING - REACTION * speeds[i], 0.0)
            least = min(least, np.sqrt(max(allowed, SLOWEST) ** 2 + 2.0 * BRAKING[kinds[i]] * early))
        assert after.desired_speed[i] == pytest.approx(least)
    assert 3 < tight < n - 3


def turnaround(after: float, radius: float = 1.6) -> tuple[Floats, Floats]:
    """Eastwards, and `after` m on in half a circle to the left into the next lane."""
    beyond = ALONG - after
    around, back = np.clip(beyond / radius, 0.0, np.pi), np.maximum(beyond - np.pi * radius, 0.0)
    return np.minimum(ALONG, after) + radius * np.sin(around) - back, radius - radius * np.cos(around)


def test_turns_that_no_vehicle_can_take_are_followed_as_they_are_drawn() -> None:
    far, here, gone = turnaround(20.0), turnaround(0.0), turnaround(-10.0)
    before = routes(far, here, gone, corner(np.pi / 5))
    after = fitted(before, users(*[(CAR, 2.0)] * 4), able(0.135, 0.135))
    # Rounded as models turn, they would lead into another street.
    np.testing.assert_array_equal(after.x[:2], before.x[:2])
    np.testing.assert_array_equal(after.y[:2], before.y[:2])
    assert np.abs(after.x[3] - before.x[3]).max() > 0.0
    # Steering has to be as sharp as the turn only in it.
    assert after.tight_curvature[[0, 2, 3]].tolist() == [0.0, 0.0, 0.0]
    assert after.tight_curvature[1] == pytest.approx(np.abs(curvature(before)[1]).max())
    assert after.tight_curvature[1] > 0.5
    assert np.sqrt(COMFORT / after.tight_curvature[1]) <= after.desired_speed[1] < 3.0


def driven(path: Floats) -> Floats:
    """Curvatures of one path (x + iy) that has no sharp corners, each over the length over which a circle that leaves a
    corner by ROUNDED joins its legs."""
    curves = curvature(routes((path.real, path.imag)))[0]
    for k in range(CHORD, POINTS - CHORD):
        usual = path[[k - CHORD, k, k + CHORD]]
        turn = abs(np.angle((usual[2] - usual[1]) * (usual[1] - usual[0]).conj()))
        # The middle of an arc of length L that turns by a is L * a / 8 from the corner of its tangents.
        length = np.inf if turn < 1e-9 else 8.0 * ROUNDED / turn
        reach = min(int(min(length, POINTS * SPACING) / SPACING), k, POINTS - 1 - k)
        while reach > CHORD:
            before, after = path[k] - path[k - reach], path[k + reach] - path[k]
            size, angle = 0.5 * (abs(before) + abs(after)), np.angle(after * before.conj())
            if abs(angle) * size <= 8.0 * ROUNDED:
                curves[k] = min(curves[k], angle / size, key=abs)
                break
            reach = 3 * reach // 4
    return curves


def test_a_corner_of_a_fast_road_slows_a_queue_no_more_than_free_traffic() -> None:
    # Lanes of the motorway A10KW turn by 0.076 rad from piece to piece; SUMO drives 25 m/s there.
    speeds = np.array([5.0, 15.0, 25.0])
    spacing = np.array([spacing_at(v) for v in speeds])
    x = np.minimum(ALONG, 15.0) + np.maximum(ALONG - 15.0, 0.0) * np.cos(0.076)
    y = np.maximum(ALONG - 15.0, 0.0) * np.sin(0.076)
    before = routes(*[(x * each, y * each) for each in spacing], desired_speed=40.0)
    before = replace(before, spacing=spacing)
    after = fitted(before, users(*((CAR, v) for v in speeds)), able(0.3, 0.3))
    assert after.desired_speed.min() > 27.0
    # An arc as long as the view is no corner: 1/100 m allows 20 m/s whatever the speed.
    long = routes(*[tuple(each * p for p in circle(100.0 / each)) for each in spacing], desired_speed=40.0)
    bent = fitted(replace(long, spacing=spacing), users(*((CAR, v) for v in speeds)), able(0.3, 0.3))
    assert bent.desired_speed == pytest.approx(20.0, rel=0.03)


def test_corners_of_streets_are_cut_by_as_much_as_fits_into_the_lane() -> None:
    # Streets of OpenStreetMap turn by 10 to 20 degrees in one point: 0.5 m beside it fits a circle of 83 m.
    x = np.minimum(ALONG, 15.0) + np.maximum(ALONG - 15.0, 0.0) * np.cos(0.22)
    y = np.maximum(ALONG - 15.0, 0.0) * np.sin(0.22)
    # A bend of 0.5 rad with a radius of 30 m moves by 0.9 m where it is cut as a whole, and by ROUNDED with 45 m.
    turned = np.clip((ALONG - 10.0) / 30.0, 0.0, 0.5)
    before, beyond = np.minimum(ALONG, 10.0), np.maximum(ALONG - 25.0, 0.0)
    bend = (
        before + 30.0 * np.sin(turned) + beyond * np.cos(0.5),
        30.0 - 30.0 * np.cos(turned) + beyond * np.sin(0.5),
    )
    found = fitted(routes((x, y), bend, desired_speed=30.0), users((CAR, 12.0), (CAR, 12.0)), able(0.3, 0.3))
    slowest = found.desired_speed**2 - 2.0 * BRAKING[CAR] * np.array([15.0 - 9.6, 10.0 - 9.6])
    assert np.sqrt(slowest[0]) == pytest.approx(np.sqrt(COMFORT * 8.0 * ROUNDED) / 0.22, rel=0.1)
    wider = 30.0 + ROUNDED / (1.0 / np.cos(0.25) - 1.0)
    assert np.sqrt(COMFORT * 30.0) < np.sqrt(slowest[1]) < np.sqrt(COMFORT * wider)


@pytest.mark.parametrize("kind", [CAR, BICYCLE])
def test_curves_ahead_are_approached_by_braking_gently(kind: int) -> None:
    # Straight on for 20 m, then a circle of 10 m to the left, for 6.3 m/s at most; it looks 1 m sharp before.
    beyond = np.maximum(ALONG - 20.0, 0.0)
    x, y = np.minimum(ALONG, 20.0) + 10.0 * np.sin(beyond / 10.0), 10.0 - 10.0 * np.cos(beyond / 10.0)
    limits = able(0.5, 0.5)
    speeds = np.array([2.0, 8.0])
    after = fitted(routes((x, y), (x, y), desired_speed=25.0), users(*((kind, v) for v in speeds)), limits)
    way = np.arange(AHEAD + 1.0)
    allowed = np.sqrt(COMFORT / np.maximum(np.abs(driven(after.x[0] + 1j * after.y[0])[HERE:]), 1e-6))
    early = np.maximum(way - REACTION * speeds[:, None], 0.0)
    expected = np.sqrt(allowed**2 + 2.0 * BRAKING[kind] * early).min(axis=1)
    assert after.desired_speed == pytest.approx(expected)
    # By hand: full curvature where a chord that cuts by ROUNDED lies on the circle.
    roughly = np.sqrt(COMFORT * 10.0 + 2.0 * BRAKING[kind] * (20.0 + np.sqrt(8.0 * ROUNDED * 10.0) - REACTION * speeds))
    assert after.desired_speed == pytest.approx(roughly, rel=0.04)
    # None is asked to be faster than it wants.
    assert fitted(routes((x, y), desired_speed=3.0), users((kind, 2.0)), limits).desired_speed.tolist() == [3.0]


def test_road_users_without_a_route_are_left_alone() -> None:
    none = replace(routes(corner(1.5), corner(1.5)), known=np.zeros(2, np.bool_))
    after = fitted(none, users((CAR, 5.0), (CAR, 5.0)), able(0.1, 0.1))
    np.testing.assert_array_equal(after.x, none.x)
    assert after.desired_speed.tolist() == [13.0, 13.0]
