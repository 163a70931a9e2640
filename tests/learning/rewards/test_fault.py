"""Which road users moved into a contact."""

import pytest

from slrl_sumo.learning.environments.arena import touching
from slrl_sumo.learning.rewards.fault import at_fault
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from tests.builders import make_world

CAR, PEDESTRIAN = RoadUserType.CAR, RoadUserType.PEDESTRIAN


def blamed(before: WorldState, after: WorldState) -> list[bool]:
    """Which of two road users are at fault; they must be in contact only `after`."""
    assert not touching(before)
    pairs = touching(after)
    assert len(pairs) == 1
    found = at_fault(pairs, before, after)
    return [name in found for name in after.ids]


@pytest.mark.parametrize(
    ("kind", "before", "after", "fault"),
    [
        # One walks into one that stands.
        ([PEDESTRIAN, PEDESTRIAN], [0.0, 0.8], [0.4, 0.8], [True, False]),
        # Both walk towards each other: neither step alone would have been enough.
        ([PEDESTRIAN, PEDESTRIAN], [0.0, 1.2], [0.4, 0.8], [True, True]),
        # Head on, each alone would have met the other.
        ([CAR, CAR], [0.0, 6.0], [4.0, 2.0], [True, True]),
        # The one ahead drives on, and is driven into from behind.
        ([CAR, CAR], [0.0, 6.0], [5.0, 8.0], [True, False]),
        # A person walks into the side of a car that stands.
        ([CAR, PEDESTRIAN], [0.0, 3.0], [0.0, 2.6], [False, True]),
    ],
)
def test_those_are_at_fault_that_moved_into_the_other(
    kind: list[RoadUserType], before: list[float], after: list[float], fault: list[bool]
) -> None:
    then = make_world(before, [0.0, 0.0], type=kind)
    now = make_world(after, [0.0, 0.0], type=kind)
    assert blamed(then, now) == fault


def test_one_that_was_not_there_before_is_not_at_fault_nor_the_one_that_stood() -> None:
    """SUMO inserts persons beside those that wait."""
    there = make_world(0.0, type=PEDESTRIAN, ids=["waiting"])
    then = make_world([0.0, 0.3], type=PEDESTRIAN, ids=["waiting", "new"])
    assert at_fault({("new", "waiting")}, there, then) == set()
