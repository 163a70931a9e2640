"""Which learned vehicles stand in a queue."""

import numpy as np
import pytest
from builders import ALONG, make_routes, make_world

from slrl_sumo.perception.route_context import route_context

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
