"""Collisions on mode paths, against a look at every box."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_crowd, make_levels, make_world
from numpy.typing import NDArray

from slrl_sumo.lookahead.collision import MARGIN, REACH, WAITING, Others, blame_of, collision_scores
from slrl_sumo.lookahead.first_contact import DEEPER, PAST_STANDING, ROOM, STANDING, Blame
from slrl_sumo.lookahead.forecast import Boxes, path_following, sizes
from slrl_sumo.lookahead.mode_paths import STEPS, ModePaths, mode_paths
from slrl_sumo.lookahead.precedence import precedence
from slrl_sumo.scene.contacts import COLLISION_DISTANCE
from slrl_sumo.scene.geometry import Box, Floats, boxes_overlap, clearance
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

MODES, PEDESTRIAN = 6, RoadUserType.PEDESTRIAN


def drawn_paths(users: WorldState, seed: int) -> ModePaths:
    acceleration, yaw_rate = np.random.default_rng(seed).normal(0.0, 1.5, (2, len(users), MODES))
    return mode_paths(users, acceleration, yaw_rate, np.full(len(users), 9.0), on_route=True)


def along_a_mode(users: WorldState, on: ModePaths) -> Boxes:
    """Boxes of all road users under their first mode."""
    return Boxes(*(column[..., 0].copy() for column in (on.x, on.y, on.cos, on.sin)), sizes(users, MARGIN[users.type]))


def expected(boxes: Boxes, world: WorldState) -> Others:
    """These boxes, of road users without routes."""
    no_users = np.zeros(len(world), np.bool_)
    return Others(boxes, boxes, precedence(None, path_following(None, world), len(world)), no_users)


def blamed(n: int) -> Blame:
    """To blame for everything."""
    return Blame(np.zeros(n, np.bool_), np.ones(n), np.zeros(n, np.bool_))


def every_box(mine: ModePaths, blame: Blame, theirs: Boxes, world: WorldState, rows: NDArray[np.intp]) -> Floats:
    """What `collision_scores` says, by a look at every pair, interval and mode."""
    hits = np.zeros((len(rows), STEPS, MODES), np.bool_)
    for e, me in enumerate(rows):
        for other in range(len(world)):
            if other == me or np.hypot(world.x[other] - world.x[me], world.y[other] - world.y[me]) > REACH:
                continue
            if blame.walks[e]:
                hits[:] |= _walks_into(world, mine, theirs, e, me, other)
                continue
            for step in range(STEPS):
                c, s = mine.cos[e, step], mine.sin[e, step]
                x, y = mine.x[e, step], mine.y[e, step]
                box = np.column_stack([x, y, np.arctan2(s, c), *np.repeat(theirs.size[me][:, None], MODES, 1)])
                heading = np.arctan2(theirs.sin[other, step], theirs.cos[other, step])
                there = _box(theirs.cos[other, step], theirs.sin[other, step], theirs.size[other])
                there_x, there_y = theirs.x[other, step], theirs.y[other, step]
                hit = boxes_overlap(box, np.tile([there_x, there_y, heading, *theirs.size[other]], (MODES, 1)))
                now = _clearance(world, theirs, me, other)
                if now < 0.0:  # in contact: only what brings them closer counts
                    shapes = [
                        clearance(there_x - x[m], there_y - y[m], _box(c[m], s[m], theirs.size[me]), there)
                        for m in range(MODES)
                    ]
                    stands = (theirs.x[other, -1], theirs.y[other, -1]) == (world.x[other], world.y[other])
                    hit &= np.array(shapes) <= now - (PAST_STANDING if stands else DEEPER)
                if blame.in_front[e]:
                    ahead = c * (there_x - x) + s * (there_y - y) > 0.0
                    hit &= ahead | _was_ahead(world, mine, theirs, e, me, other, step)
                hits[e, step] |= hit & ((mine.speed[e, step] > STANDING) | (blame.standing[e] > 0.0))
    counts = np.where(mine.speed > STANDING, 1.0, blame.standing[:, None, None])
    scores = counts * (1.0 - np.arange(STEPS)[:, None] / STEPS)
    first = hits.argmax(axis=1)[:, None]
    return np.where(hits.any(axis=1), np.take_along_axis(scores, first, axis=1)[:, 0], 0.0)


def _walks_into(world: WorldState, mine: ModePaths, theirs: Boxes, e: int, me: int, other: int) -> NDArray[np.bool_]:
    """In which intervals and modes a pedestrian comes too near to another road user: (rows, STEPS, MODES), all but row
    `e` False."""
    hits = np.zeros((len(mine.x), STEPS, MODES), np.bool_)
    stands, person = world.speed[other] < STANDING, world.type[other] == PEDESTRIAN
    keeps = 0.5 * (MARGIN[PEDESTRIAN] + MARGIN[world.type[other]])
    here = world.x[other], world.y[other], np.cos(world.heading[other]), np.sin(world.heading[other])
    away = _room(world, me, other, world.x[me], world.y[me], *here)
    nearest = min(away, 0.0) - 1e-6 if away < keeps else keeps
    for step in range(STEPS):
        there = here if stands else tuple(column[other, step] for column in theirs[:4])
        for m in range(MODES):
            x, y = mine.x[e, step, m], mine.y[e, step, m]
            hits[e, step, m] = _room(world, me, other, x, y, *there) < nearest
            if step == 0 and person and not stands and mine.speed[e, 0, m] > STANDING:
                hits[e, 0, m] |= _room(world, me, other, x, y, *here) < min(away, 0.0) - 1e-6
    return hits


def _room(
    world: WorldState, me: int, other: int, x: float, y: float, there_x: float, there_y: float, cos: float, sin: float
) -> float:
    """m from a pedestrian at (x, y) to another road user at a place, below 0 in contact."""
    if world.type[other] == PEDESTRIAN:
        return float(np.hypot(there_x - x, there_y - y)) - COLLISION_DISTANCE - ROOM
    ahead = abs(cos * (there_x - x) + sin * (there_y - y)) - 0.5 * world.length[other]
    aside = abs(cos * (there_y - y) - sin * (there_x - x)) - 0.5 * world.width[other]
    outside = float(np.hypot(max(ahead, 0.0), max(aside, 0.0)))
    return outside + min(max(ahead, aside), 0.0) - 0.5 * world.width[me] - ROOM


def _box(cos: float, sin: float, size: Floats) -> Box:
    return Box(float(cos), float(sin), float(size[0]), float(size[1]))


def _was_ahead(
    world: WorldState, mine: ModePaths, theirs: Boxes, e: int, me: int, other: int, step: int
) -> NDArray[np.bool_]:
    """Whether the other one was ahead of the centre an interval before."""
    if step == 0:
        dx, dy = world.x[other] - world.x[me], world.y[other] - world.y[me]
        return np.full(MODES, np.cos(world.heading[me]) * dx + np.sin(world.heading[me]) * dy > 0.0)
    dx, dy = theirs.x[other, step - 1] - mine.x[e, step - 1], theirs.y[other, step - 1] - mine.y[e, step - 1]
    return np.asarray(mine.cos[e, step - 1] * dx + mine.sin[e, step - 1] * dy > 0.0)


def _clearance(world: WorldState, theirs: Boxes, me: int, other: int) -> float:
    """m between two road users as they are now, with the margins of `theirs`."""
    shapes = [_box(np.cos(world.heading[i]), np.sin(world.heading[i]), theirs.size[i]) for i in (me, other)]
    dx, dy = world.x[other] - world.x[me], world.y[other] - world.y[me]
    return float(clearance(float(dx), float(dy), *shapes))


@pytest.mark.parametrize("extent", [15.0, 60.0])
def test_circles_leave_out_no_road_user_that_is_hit(extent: float) -> None:
    world = make_crowd(24, 3, extent)
    # Some of all, in another order.
    rows = np.random.default_rng(7).permutation(24)[:17]
    on = drawn_paths(world, 4)
    theirs = along_a_mode(world, on)
    mine = ModePaths(*(column[rows] for column in (on.x, on.y, on.cos, on.sin, on.speed, on.distance)))
    follows = (rows % 3 == 0) & (world.type[rows] != PEDESTRIAN)
    blame = blame_of(world.type[rows], follows, rows % 2 == 0)
    found = collision_scores(mine, blame, expected(theirs, world), world, rows)
    np.testing.assert_array_equal(found, every_box(mine, blame, theirs, world, rows))
    # Some are hit at once, some later, and some modes hit nothing.
    assert len(np.unique(found)) > 4
    assert (found == 0.0).any()
    # Into which others one may drive without blame makes a difference.
    strictly = collision_scores(mine, blamed(17)._replace(walks=blame.walks), expected(theirs, world), world, rows)
    assert (strictly >= found).all()
    assert (strictly > found).any()


def test_a_road_user_excused_at_first_may_be_to_blame_later() -> None:
    """It is hit from behind after one interval, and drives into the one that stands ahead after five."""
    world = replace(make_crowd(3, 1, 1.0), x=np.array([0.0, -5.0, 12.0]), y=np.zeros(3), type=np.zeros(3, np.int8))
    world = replace(world, length=np.full(3, 5.0), width=np.full(3, 1.8))
    every = 1.5 * np.arange(1, STEPS + 1)
    x, one, zero = np.stack([every, every - 5.0, np.full(STEPS, 12.0)]), np.ones((3, STEPS)), np.zeros((3, STEPS))
    theirs = Boxes(x, zero, one, zero, sizes(world, MARGIN[world.type]))
    mine = ModePaths(*(column[:1, :, None].copy() for column in (x, zero, one, zero, 3.75 * one, x)))
    rows = np.zeros(1, np.intp)
    # 5.4 m long with the margin: those behind touch all the time, those ahead from 6.6 m on.
    excused = blame_of(world.type[:1], np.ones(1, np.bool_), np.ones(1, np.bool_))
    assert collision_scores(mine, excused, expected(theirs, world), world, rows).tolist() == [[1.0 - 4 / STEPS]]
    # The one behind is in contact now: that it stays so is no collision, that it comes closer would be.
    assert collision_scores(mine, blamed(1), expected(theirs, world), world, rows).tolist() == [[1.0 - 4 / STEPS]]


def test_without_others_nothing_is_hit() -> None:
    world = make_crowd(3, 5, 50.0)
    far = replace(world, x=np.array([0.0, 200.0, 400.0]))
    for some, n in ((far, 3), (world.take(np.array([1])), 1), (make_crowd(0, 1, 1.0), 0)):
        on = drawn_paths(some, 6)
        alone = collision_scores(on, blamed(n), expected(along_a_mode(some, on), some), some, np.arange(n))
        assert not alone.any()
        assert alone.shape == (n, MODES)


def test_boxes_on_two_levels_do_not_collide() -> None:
    """One drives east and one north; both are at the crossing after three intervals."""
    world = make_world([-12.0, 0.0], [0.0, -12.0], heading=[0.0, 0.5 * np.pi], speed=10.0)
    way, zero, one = 4.0 * np.arange(1, STEPS + 1) - 12.0, np.zeros(STEPS), np.ones(STEPS)
    columns = np.stack([way, zero]), np.stack([zero, way]), np.stack([one, zero]), np.stack([zero, one])
    theirs = Boxes(*columns, sizes(world, MARGIN[world.type]))
    mine = ModePaths(*(column[:1, :, None].copy() for column in (*columns, 10.0 * np.ones((2, STEPS)), columns[0])))
    rows, blame = np.zeros(1, np.intp), blamed(1)
    # Boxes of 5 m meet after the third interval, at the crossing.
    assert collision_scores(mine, blame, expected(theirs, world), world, rows).item() == 1.0 - 2 / STEPS
    assert collision_scores(mine, blame, expected(theirs, world), world, rows, make_levels()).item() == 0.0
    behind = theirs._replace(x=columns[0][[0, 0]] + 3.0, y=np.stack([zero, zero]), cos=np.stack([one, one]))
    behind = behind._replace(sin=np.stack([zero, zero]))
    same = world.take(np.array([0, 0]))
    same = replace(same, x=np.array([-12.0, -6.0]))
    assert collision_scores(mine, blame, expected(behind, same), same, rows, make_levels()).item() > 0.0


def _towards(
    x: float, speeds: list[float], other: float, pace: float, *, standing: bool = False, starts: bool = False
) -> Floats:
    """Scores of modes with steady `speeds` of a pedestrian at `x` m, the later row, towards another one at `other` m
    that comes nearer at `pace`. `standing`: it stands now; `starts`: the other one may start."""
    now = 0.0 if standing or starts else 1.0
    world = make_world(
        [other, x], heading=[np.pi if other > x else 0.0, 0.0], speed=[abs(pace), now], type=PEDESTRIAN,
    )  # fmt: skip
    world = replace(world, length=np.full(2, 0.5), width=np.full(2, 0.5))
    seconds, one, zero = DECISION_INTERVAL * np.arange(1, STEPS + 1), np.ones((2, STEPS)), np.zeros((2, STEPS))
    theirs = Boxes(
        np.stack([other - pace * seconds, x + seconds]), zero, np.stack([-one[0], one[1]]), zero,
        sizes(world, np.where(world.speed < STANDING, 0.0, MARGIN[PEDESTRIAN])),
    )  # fmt: skip
    columns = (x + seconds[:, None] * speeds, 0.0, 1.0, 0.0, np.array(speeds), seconds[:, None] * speeds)
    shape = (1, STEPS, len(speeds))
    mine = ModePaths(*(np.broadcast_to(column, shape).astype(np.float64) for column in columns))
    yes, others = np.ones(1, np.bool_), expected(theirs, world)._replace(starts=np.array([starts, False]))
    return collision_scores(mine, blame_of(world.type[1:], ~yes, yes), others, world, np.ones(1, int))


def test_a_pedestrian_that_stands_is_walked_into_with_half_the_blame() -> None:
    """With all of it, two that came towards each other walked on: no mode avoided the other one."""
    stands, walks = _towards(0.0, [0.0, 1.0], 1.1, 1.0)[0]
    assert walks == 1.0
    # It is there after two intervals instead of one.
    assert stands == WAITING * (1.0 - 1 / STEPS)
    # Not where the other one stands: it has walked into that one, at less than STANDING in the end.
    assert _towards(0.0, [0.15], 0.8, 0.0).item() == 1.0 - 3 / STEPS


@pytest.mark.parametrize(
    ("other", "step", "passes"),
    [
        # Within the margin of one that stands, but not in contact: it may come nearer, not into contact.
        (0.56, 0.03, False),
        # Nor farther than it is in contact already, or near to it.
        (0.54, 0.03, False),
        (0.41, 0.03, False),
        (-0.41, 0.03, True),
    ],
)
def test_a_pedestrian_does_not_walk_into_contact_with_one_that_stands(other: float, step: float, passes: bool) -> None:
    assert (_towards(0.0, [step / DECISION_INTERVAL], other, 0.0)[0, 0] == 0.0) == passes


def test_a_pedestrian_does_not_walk_to_where_one_that_walks_ahead_is_now() -> None:
    """It walks away as fast, but may stop."""
    assert _towards(0.0, [1.0, 0.4], 0.8, -1.0).tolist() == [[1.0, 0.0]]
    # One that stands is judged where it stands, and one farther ahead not at all.
    assert _towards(0.0, [1.0, 0.4], 1.2, -1.0).tolist() == [[0.0, 0.0]]


def test_in_contact_a_vehicle_goes_by_one_that_stands_beside_its_path() -> None:
    """The other one is expected a little aside, on its path, but stands."""
    world = make_world([0.0, 4.9], 0.0, speed=[0.5, 0.0])
    one, zero = np.ones((2, STEPS)), np.zeros((2, STEPS))
    theirs = Boxes(one * [[0.0], [4.9]], one * [[0.0], [0.01]], one, zero, sizes(world, np.zeros(2)))
    columns = (np.full((STEPS, 1), 0.2), 0.0, 1.0, 0.0, 0.5, 0.2)
    mine = ModePaths(*(np.broadcast_to(column, (1, STEPS, 1)).astype(np.float64) for column in columns))
    yes, row = np.ones(1, np.bool_), np.zeros(1, int)
    blame = blame_of(world.type[:1], yes, yes)
    assert collision_scores(mine, blame, expected(theirs, world), world, row).item() == 0.0
    drives = replace(world, speed=np.array([0.5, 1.0]))
    assert collision_scores(mine, blame, expected(theirs, drives), drives, row).item() == 1.0


def _crossing(*, starts: bool, aside: float = 0.45) -> Floats:
    """Scores of walking and standing of two persons that stand, one to the east and one to the south of it to the
    north, both `aside` m from where their ways cross."""
    world = make_world([-aside, 0.0], [0.0, -aside], heading=[0.0, np.pi / 2], speed=0.0, type=PEDESTRIAN)
    world = replace(world, length=np.full(2, 0.5), width=np.full(2, 0.5))
    x, y = (np.repeat(place[:, None], STEPS, axis=1) for place in (world.x, world.y))
    cos, sin = (np.repeat(f(world.heading)[:, None], STEPS, axis=1) for f in (np.cos, np.sin))
    boxes = Boxes(x, y, cos, sin, sizes(world, np.zeros(2)))
    first = np.arange(STEPS) == 0  # one step of 0.15 m, then a stand: what is judged is the start
    covered, speed = np.full(STEPS, 0.15), np.where(first, 0.4, 0.0)
    walk = [x + covered * cos, y + covered * sin, cos, sin, np.stack([speed, speed]), np.stack([covered, covered])]
    stand = [x, y, cos, sin, 0.0 * x, 0.0 * x]
    mine = ModePaths(*(np.stack(pair, axis=2) for pair in zip(walk, stand, strict=True)))
    others = expected(boxes, world)._replace(starts=np.full(2, starts))
    yes = np.ones(2, np.bool_)
    return collision_scores(mine, blame_of(world.type, ~yes, yes), others, world, np.arange(2))


def test_of_two_persons_that_stand_the_later_one_leaves_the_other_one_the_way() -> None:
    """Each expects the other one to go on standing: both started at once, into each other."""
    assert _crossing(starts=True).tolist() == [[0.0, 0.0], [1.0, 0.0]]
    # Not before a red light, where the other one stays, nor where there is room for both.
    assert not _crossing(starts=False).any()
    assert not _crossing(starts=True, aside=0.8).any()


def test_a_person_that_walks_away_from_the_one_behind_is_not_in_its_way() -> None:
    """With the place of its start alone as the measure, both stood for ever."""
    scores = _towards(0.52, [1.0], 0.0, 0.0, starts=True)
    assert scores.item() == 0.0


def test_a_person_that_creeps_into_another_one_does_not_stand() -> None:
    """At less than STANDING it counted as standing, with half the blame, and came into contact."""
    creeps, stands = _towards(0.0, [0.15, 0.0], 0.9, 1.0, standing=True)[0]
    assert stands < creeps == 1.0


def test_a_car_that_stands_beside_its_path_is_met_where_it_stands() -> None:
    world = make_world([0.0, 0.0], [-1.4, 0.0], heading=0.0, speed=[1.0, 0.0], type=[PEDESTRIAN, RoadUserType.CAR])
    world = replace(world, length=np.array([0.5, 5.0]), width=np.array([0.5, 1.8]))
    seconds, one, zero = DECISION_INTERVAL * np.arange(1, STEPS + 1), np.ones((2, STEPS)), np.zeros((2, STEPS))
    on_path = Boxes(np.stack([seconds, zero[1]]), one * [[-1.4], [-0.4]], one, zero, sizes(world, np.zeros(2)))
    columns = (seconds[:, None], -1.4, 1.0, 0.0, 1.0, seconds[:, None])
    mine = ModePaths(*(np.broadcast_to(column, (1, STEPS, 1)).astype(np.float64) for column in columns))
    yes, row = np.ones(1, np.bool_), np.zeros(1, int)
    blame = blame_of(world.type[:1], ~yes, yes)
    assert collision_scores(mine, blame, expected(on_path, world), world, row).item() == 0.0
    drives = replace(world, speed=np.array([1.0, 1.0]))
    assert collision_scores(mine, blame, expected(on_path, drives), drives, row).item() == 1.0


def test_persons_on_two_levels_do_not_wait_for_each_other() -> None:
    """One walks on the bridge to the east, and one under it to the north, both at its middle."""
    world = make_world([-0.8, 0.0], [0.0, -0.3], heading=[0.0, 0.5 * np.pi], speed=1.0, type=PEDESTRIAN)
    world = replace(world, length=np.full(2, 0.5), width=np.full(2, 0.5))
    seconds, zero, one = DECISION_INTERVAL * np.arange(1, STEPS + 1), np.zeros(STEPS), np.ones(STEPS)
    columns = (
        np.stack([seconds - 0.8, zero]),
        np.stack([zero, seconds - 0.3]),
        np.stack([one, zero]),
        np.stack([zero, one]),
    )
    theirs = Boxes(*columns, sizes(world, MARGIN[world.type]))
    mine = ModePaths(*(column[:1, :, None].copy() for column in (*columns, np.ones((2, STEPS)), columns[0])))
    yes, row = np.ones(1, np.bool_), np.zeros(1, np.intp)
    blame = blame_of(world.type[:1], ~yes, yes)
    assert collision_scores(mine, blame, expected(theirs, world), world, row).item() == 1.0
    assert collision_scores(mine, blame, expected(theirs, world), world, row, make_levels()).item() == 0.0
