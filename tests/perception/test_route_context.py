"""Which learned vehicles stand in a queue, and where they have to stop for one."""

from dataclasses import replace

import numpy as np
import pytest
from builders import ALONG, make_routes, make_world

from slrl_sumo.perception.route_context import BEFORE, STOP_MARGIN, RouteContext, route_context
from slrl_sumo.scene.geometry import Floats

WEST = np.pi


@pytest.mark.parametrize(
    ("heading", "back", "queues"),
    [
        (0.0, False, True),
        (0.6, False, True),  # turned by 34 degrees, as in a lane change
        (1.0, False, False),
        (WEST, False, False),
        (0.3, True, False),  # each is in the way of the other
    ],
)
def test_a_queue_is_behind_one_that_goes_the_same_way(heading: float, back: bool, queues: bool) -> None:
    # Both stand, 7 m apart; with `back`, the path of the second one leads to where the first one stands.
    world = make_world(x=np.array([0.0, 7.0]), heading=np.array([0.0, heading]), ids=("one", "two"))
    x = np.array([ALONG, 7.0 - ALONG if back else 7.0 + ALONG])
    context = route_context(make_routes(x, np.zeros_like(x)), world)
    assert context.queues.tolist() == [queues, False]


def test_without_a_leader_there_is_no_queue() -> None:
    world = make_world(x=np.array([0.0, -30.0]), ids=("one", "two"))
    assert not route_context(make_routes(ALONG[None], np.zeros((1, len(ALONG)))), world).queues.any()


def queued(
    places: Floats, keep: Floats, speed: Floats, *, ring: float = 0.0, stop: Floats | float = np.inf
) -> RouteContext:
    """Of cars of 5 m one behind the other, the first one in front, all on one path to the east. `keep`: m to a junction
    that each has to keep clear, 10 m long; `stop`: m to a line before which it has to stop. With `ring` (m round), the
    last one leads the first one."""
    n = len(places)
    if ring:
        angle, radius = places / ring * 2.0 * np.pi, ring / (2.0 * np.pi)
        world = make_world(radius * np.sin(angle), radius * (1.0 - np.cos(angle)), heading=angle, speed=speed)
        along = (places[:, None] + ALONG) / ring * 2.0 * np.pi
        routes = make_routes(radius * np.sin(along), radius * (1.0 - np.cos(along)))
    else:
        world = make_world(places, np.zeros(n), speed=speed)
        routes = make_routes(places[:, None] + ALONG, np.zeros((n, len(ALONG))))
    lines = replace(routes, keep_clear_line=keep, line=keep, keep_clear_exit=keep + 10.0, stop=np.zeros(n) + stop)
    return route_context(lines, world)


def test_a_junction_is_kept_clear_where_the_exit_is_taken() -> None:
    # The exit is 14 m ahead of the second car, and 17.5 m of room: too little for its own 5 m.
    held = queued(np.array([22.0, 0.0]), np.array([np.inf, 4.0]), np.zeros(2))
    assert held.stop_distance[1] == pytest.approx(4.0 - BEFORE - STOP_MARGIN[0])
    # With room for all of it, or where nothing crosses, it goes on.
    assert queued(np.array([27.0, 0.0]), np.array([np.inf, 4.0]), np.zeros(2)).stop_distance[1] == np.inf
    assert queued(np.array([22.0, 0.0]), np.full(2, np.inf), np.zeros(2)).stop_distance[1] == np.inf


def test_a_left_turner_does_not_enter_where_the_exit_is_taken() -> None:
    """Its stop inside hid the queue behind the exit: ten cars of a tester stood in junctions, for up to 300 s."""
    keep, stop = np.array([np.inf, 4.0]), np.array([np.inf, 10.0])
    held = queued(np.array([22.0, 0.0]), keep, np.zeros(2), stop=stop)
    assert held.stop_distance[1] == pytest.approx(4.0 - BEFORE - STOP_MARGIN[0])
    # With room behind the exit it waits inside.
    free = queued(np.array([27.0, 0.0]), keep, np.zeros(2), stop=stop)
    assert free.stop_distance[1] == pytest.approx(10.0 - STOP_MARGIN[0])


def test_a_leader_that_moves_will_stop_before_the_next_junction_that_is_taken() -> None:
    # The first one stands behind the second junction, too near for the second one, which comes there at 5 m/s. The
    # third one would stand in the first junction, behind the second one that waits.
    places, keep = np.array([42.0, 22.0, 0.0]), np.array([np.inf, 4.0, 4.0])
    context = queued(places, keep, np.array([0.0, 5.0, 5.0]))
    assert context.stop_distance[1:] == pytest.approx(4.0 - BEFORE - STOP_MARGIN[0])
    free = queued(places, np.array([np.inf, np.inf, 4.0]), np.array([0.0, 5.0, 5.0]))
    assert free.stop_distance.tolist() == [np.inf] * 3


@pytest.mark.parametrize(("moving", "held"), [(0.0, False), (3.0, True)])
def test_in_a_circle_of_road_users_that_stand_a_junction_is_not_kept_clear(moving: float, held: bool) -> None:
    # Six on a ring of 60 m: each is the leader of the one behind it, 10 m away.
    places, keep = 10.0 * np.arange(6.0), np.array([2.0] + [np.inf] * 5)
    speed = np.zeros(6)
    speed[3] = moving
    context = queued(places, keep, speed, ring=60.0)
    assert (context.stop_distance[0] < np.inf) == held
