"""When a vehicle entered the junction that it is in: others inside wait for vehicles that entered before them."""

import math

import numpy as np
import pytest

from slrl_sumo.routing.lane_path import JunctionEntry, LanePath
from slrl_sumo.routing.polyline import Polyline
from slrl_sumo.routing.vehicle_track import VehicleTrack
from tests.builders import make_track

FIRST = JunctionEntry(20.0, "in_0", ":a_14_0", "out_0", 50.0)
INSIDE = JunctionEntry(28.0, ":a_14_0", ":a_22_0", "out_0", 50.0)
NEXT = JunctionEntry(50.0, "out_0", ":b_3_0", "far_0", 70.0)


@pytest.fixture
def track() -> VehicleTrack:
    along = np.array([0.0, 100.0])
    line = Polyline(along, np.zeros(2), along)
    path = LanePath(("in_0", ":a_14_0"), (20.0, 100.0), (FIRST, INSIDE, NEXT), line)
    return make_track(path, 10.0, 5.0)


def entered(track: VehicleTrack, *places: tuple[float, float]) -> list[float]:
    """When it entered, at each of the times, at m along the path."""
    times = []
    for time, track.s in places:
        track.history.observe(time, track.speed)
        track.observe_junction(5.0)
        times.append(track.history.entered)
    return times


def test_a_vehicle_that_rolls_over_the_line_inside_entered_at_the_first_one(track: VehicleTrack) -> None:
    """An oncoming vehicle that has entered in between waits for it: with a new time both waited for each other."""
    assert entered(track, (1.0, 10.0), (2.0, 22.0), (3.0, 29.0), (4.0, 40.0)) == [math.inf, 2.0, 2.0, 2.0]


def test_a_vehicle_that_has_halted_inside_enters_anew(track: VehicleTrack) -> None:
    assert entered(track, (2.0, 22.0)) == [2.0]
    track.history.halted = INSIDE.via
    assert entered(track, (9.0, 29.0)) == [9.0]


def test_the_next_junction_is_entered_anew(track: VehicleTrack) -> None:
    assert entered(track, (2.0, 22.0), (5.0, 52.0), (9.0, 90.0)) == [2.0, 5.0, math.inf]


def test_a_moment_that_is_observed_twice_counts_once(track: VehicleTrack) -> None:
    """An environment looks twice at the moment at which one episode ends and the next one begins."""
    history = track.history
    for time in (1.0, 1.4, 1.4, 1.8, 1.8, 1.8):
        history.observe(time, 0.0)
        history.observe_signal(red=False)
    assert (history.standing_time, history.idle_time) == pytest.approx((1.2, 1.2))
    history.observe(2.2, 0.0)
    history.observe_signal(red=True)
    assert (history.standing_time, history.idle_time) == pytest.approx((1.6, 0.0))
    history.observe(2.6, 1.0)
    assert history.standing_time == 0.0


def test_a_vehicle_is_held_from_the_first_moment_without_red(track: VehicleTrack) -> None:
    history, held = track.history, []
    for k, red in enumerate((True, True, False, True, True, False)):
        history.observe(1.0 + 0.4 * k, 0.0)
        history.observe_signal(red=red)
        held.append(history.held_time)
    assert held == pytest.approx([0.0, 0.0, 0.4, 0.8, 1.2, 1.6])
    history.observe(3.4, 1.0)
    history.observe_signal(red=False)
    assert history.held_time == 0.0


def test_a_vehicle_that_entered_a_junction_blocks_no_further_one(track: VehicleTrack) -> None:
    track.history.blocks = FIRST.via
    entered(track, (1.0, 10.0))
    assert track.history.blocks == FIRST.via
    entered(track, (2.0, 22.0))
    assert track.history.blocks == ""
