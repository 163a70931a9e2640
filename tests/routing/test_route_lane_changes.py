"""Lane changes that routes need, on lanes that leave the route soon or late."""

from itertools import pairwise

import pytest

from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.route_lane_changes import CHANGE, LaneChanges, RouteLaneChanges
from slrl_sumo.sumo.network.lanes import Lane

SPEED = 10.0


def _changes(*lengths: float, first_lanes: int = 2) -> LaneChanges:
    """Of a route over edges "0", "1", … of two lanes and these lengths (m); "end" continues the right lane alone."""
    edges = [*map(str, range(len(lengths))), "end"]
    of_edge = {edge: [f"{edge}_0", f"{edge}_1"] for edge in edges[:-1]} | {"end": ["end_0"]}
    allowed = frozenset({"passenger"})
    shape = ((0.0, 0.0), (1.0, 0.0))
    lanes = {
        lane: Lane(lane, edge, shape, 3.2, length, SPEED, allowed, False, Surface.ROAD)
        for edge, length in zip(edges, (*lengths, 100.0), strict=True)
        for lane in of_edge[edge]
    }
    links = {f"{a}_{k}": [(f"{b}_{k}", "")] for a, b in pairwise(edges[:-1]) for k in (0, 1)}
    links[f"{edges[-2]}_0"] = [("end_0", "")]
    return RouteLaneChanges(lanes, of_edge, lambda lane: links.get(lane, []))(tuple(edges), "passenger")


@pytest.mark.parametrize(("lengths", "towards"), [
    ((100.0,), "0_0"),  # The left lane ends with this edge.
    ((100.0, 30.0), "0_0"),  # The next edge takes 3 s, too short for the change.
    ((100.0, 50.0), None),
    ((100.0, 15.0, 15.0, 15.0), None),  # So do the next three edges together: 4.5 s.
    ((100.0, 15.0, 15.0), "0_0"),
])  # fmt: skip
def test_a_lane_that_leaves_the_route_later_than_a_change_takes_is_kept(
    lengths: tuple[float, ...], towards: str | None
) -> None:
    assert 3.0 < CHANGE < 4.5
    changes = _changes(*lengths)
    assert changes.towards("0_1") == towards
    assert changes.towards("0_0") is None


def test_a_change_counts_as_more_the_less_time_there_is() -> None:
    changes = _changes(10.0, 10.0, 10.0)
    assert changes.total["0_0"] == changes.after["0_0"] == 0.0
    assert changes.after["0_1"] == pytest.approx(CHANGE / 2.0)
    assert changes.total["0_1"] == pytest.approx(CHANGE / 3.0)
    assert _changes(10.0).after == {"0_0": 0.0}


def test_without_a_lane_that_continues_vehicles_stay() -> None:
    lane = Lane("a_0", "a", ((0.0, 0.0), (1.0, 0.0)), 3.2, 50.0, SPEED, frozenset({"bus"}), False, Surface.ROAD)
    changes = RouteLaneChanges({"a_0": lane}, {"a": ["a_0"]}, lambda name: [])
    assert changes(("a", "b"), "bus").towards("a_0") is None
    assert changes(("a",), "passenger").total == {}
