from dataclasses import replace

import numpy as np
from builders import make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.learning.supervised.windows import OWN_SPEED, mirrored, reversing, windows
from slrl_sumo.perception.features import FEATURES


def recording(lengths: list[int], kinds: list[int], first: list[int]) -> Trajectories:
    """Tracks along +y from (10 i, 0), that cover 0.4 m, 0.8 m, 1.2 m … per interval, turning left all the time."""
    counts = [np.arange(n) for n in lengths]
    ways = [(10.0 * i, 0.2 * n * (n + 1), np.pi / 2 + 0.02 * n) for i, n in enumerate(counts)]
    return make_recording(*ways, first=first, type=kinds)


def test_windows_of_a_known_track() -> None:
    # 17 rows: rows 2, 3 and 4 have 2 rows before and 12 after them. A pedestrian walks beside, 10 m to the right.
    found = windows([recording([17, 17], [0, 2], [5, 5])])
    assert len(found) == 6
    car = found.take(found.type == 0)
    np.testing.assert_array_equal(car.track, 0)
    for i, k in enumerate((2, 3, 4)):
        heading = np.pi / 2 + 0.02 * k
        seen = dict(zip(FEATURES, car.vector[i], strict=True))
        # In interval k the car covers 0.4 k m: speed k m/s, and 2.5 m/s² from one to the next.
        np.testing.assert_allclose([seen["speed"], seen["acceleration"], seen["heading"]], [k, 2.5, heading], rtol=1e-5)
        assert (seen["car"], seen["bicycle"], seen["pedestrian"]) == (1, 0, 0)
        assert [seen[f"vru_{r}"] for r in (5, 10, 20)] == [0, 1, 1]
        assert [seen[f"other_{r}"] for r in (5, 10, 20)] == [0, 0, 0]
        np.testing.assert_allclose([car.acceleration[i], car.yaw_rate[i]], [2.5, 0.05])
        # Straight north is ahead and, as the heading is turned left by 0.02 k, somewhat to the right.
        ahead = np.array([np.cos(0.02 * k), -np.sin(0.02 * k)])
        np.testing.assert_allclose(car.displacement[i], 0.4 * (k + 1) * ahead)
        np.testing.assert_allclose(car.destination[i], 0.2 * ((k + 12) * (k + 13) - k * (k + 1)) * ahead)
    walker = found.take(found.type == 2)
    np.testing.assert_array_equal(walker.vector[:, FEATURES.index("other_10")], 1)


def test_no_window_reaches_into_another_track() -> None:
    # The second track goes on where and when the first ends, as a track split at a gap does.
    short = windows([recording([14, 14], [0, 0], [0, 15])])
    assert len(short) == 0
    assert short.vector.shape == (0, 12)
    found = windows([recording([15, 14, 16], [0, 0, 0], [0, 15, 30])])
    np.testing.assert_array_equal(found.track, [0, 2, 2])


def test_parked_road_users_are_seen_and_teach_nothing() -> None:
    both = recording([17, 17], [0, 2], [5, 5])
    found = windows([replace(both, parked=np.array([True, False]))])
    np.testing.assert_array_equal(found.track, [1, 1, 1])
    np.testing.assert_array_equal(found.vector[:, FEATURES.index("other_10")], 1)


def test_cars_that_reverse_teach_nothing_then() -> None:
    # Forwards by 0.8 m up to row 20, backwards to row 26, still to row 40; a walker beside does the same.
    step = np.r_[0.0, np.full(20, 0.8), np.full(6, -0.6), np.zeros(14)]
    made = recording([41, 41], [0, 2], [0, 0])
    beside = np.repeat([0.0, 5.0], 41)
    made = replace(made, x=np.tile(np.cumsum(step), 2), y=beside, heading=np.zeros(82))
    np.testing.assert_array_equal(np.flatnonzero(reversing(made)), np.arange(21, 27))
    found = windows([made])
    walker = found.take(found.track == 1)
    car = found.take(found.track == 0)
    assert len(walker) == 27  # rows 2 to 28
    # Row 19 is the last whose next interval is forwards; 28 the first with two intervals behind it that do not reverse.
    assert len(car) == 18 + 1
    assert car.path[:, 0, 0].min() >= 0.0
    assert walker.path[:, 0, 0].min() < -0.5
    # Steps of noise do not count.
    slow = replace(made, x=np.tile(np.cumsum(np.where(step < 0, -0.1, step)), 2))
    assert len(windows([slow])) == 2 * 27


def test_relative_destinations_lack_most_of_the_own_way() -> None:
    found = windows([recording([17], [0], [5])])
    speed = found.vector[:, 0].astype(np.float64)
    expected = found.destination - np.stack([OWN_SPEED * 4.8 * speed, 0 * speed], -1)
    np.testing.assert_allclose(found.relative, expected)
    assert 0 < OWN_SPEED <= 1


def test_the_mirror_swaps_left_and_right() -> None:
    found = windows([recording([17, 17], [0, 2], [5, 5])])
    seen = mirrored(found)
    np.testing.assert_array_equal(seen.path[..., 0], found.path[..., 0])
    np.testing.assert_array_equal(seen.path[..., 1], -found.path[..., 1])
    np.testing.assert_array_equal(seen.yaw_rate, -found.yaw_rate)
    np.testing.assert_array_equal(seen.vector[:, 5], -found.vector[:, 5])
    np.testing.assert_array_equal(np.delete(seen.vector, 5, 1), np.delete(found.vector, 5, 1))
    np.testing.assert_array_equal(seen.acceleration, found.acceleration)


def test_stride_and_recordings() -> None:
    both = [recording([30], [1], [0]), recording([20], [2], [3])]
    found = windows(both)
    assert np.bincount(found.recording).tolist() == [16, 6]
    np.testing.assert_array_equal(found.type, 1 + found.recording)
    thinned = windows(both, stride=4)  # frames 4, 8, 12 and 16 of the first, frame 8 (row 5) of the second
    np.testing.assert_array_equal(thinned.recording, [0, 0, 0, 0, 1])
    np.testing.assert_allclose(thinned.vector[:, FEATURES.index("speed")], [4, 8, 12, 16, 5], rtol=1e-6)
