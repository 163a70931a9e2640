from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.resampling.resample import SMOOTHING, Samples, resample
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType


def samples(time: Any, x: Any, y: Any, **changes: Any) -> Samples:
    """One pedestrian, 25 rows per second, without headings."""
    time, x, y = np.broadcast_arrays(np.asarray(time, float), np.asarray(x, float), np.asarray(y, float))
    fields: dict[str, Any] = {
        "file": "f.csv",
        "source": "made up",
        "user": np.zeros(len(time), np.int64),
        "time": time,
        "x": x,
        "y": y,
        "heading": np.full(len(time), np.nan),
        "period": 0.04,
        "ids": ("a",),
        "type": np.array([RoadUserType.PEDESTRIAN], np.int8),
        "length": np.array([0.3]),
        "width": np.array([0.5]),
        "still": np.array([0.7]),
    }
    return Samples(**(fields | changes))


def car(**changes: Any) -> dict[str, Any]:
    return {"type": np.array([RoadUserType.CAR], np.int8), **changes}


def test_interpolates_between_neighbouring_rows() -> None:
    time = np.arange(0, 51) * 0.3
    t = resample(samples(time, 2 * time, 1 - time, period=0.3))
    due = np.arange(len(t)) * DECISION_INTERVAL
    assert len(t) == 38  # 15 s hold 37 whole intervals
    np.testing.assert_allclose(t.x, 2 * due, atol=1e-9)
    np.testing.assert_allclose(t.y, 1 - due, atol=1e-9)
    np.testing.assert_allclose(t.heading, np.arctan2(-1, 2), atol=1e-6)
    np.testing.assert_allclose(t.speed, np.sqrt(5), atol=1e-9)


def test_time_starts_with_the_first_row() -> None:
    time = np.r_[np.arange(100, 200), np.arange(110, 200)] * 0.04
    user = np.repeat([0, 1], [100, 90])
    two = {"ids": ("a", "b"), "type": np.array([2, 2], np.int8), "still": np.zeros(2)}
    sizes = {"length": np.ones(2), "width": np.ones(2)}
    t = resample(samples(time, time, user * 5.0, user=user, **two, **sizes))
    assert t.t0 == 4.0
    assert [t.frame[start] for start in t.starts[:-1]] == [0, 1]
    np.testing.assert_allclose(t.x, t.t0 + t.frame * t.dt)


def test_never_bridges_a_gap() -> None:
    time = np.arange(251) * 0.04
    kept = (time < 3.9) | (time > 6.1)
    t = resample(samples(time[kept], time[kept], 0.0))
    assert t.ids == ("a", "a#1")
    frames = [t.frame[s:e].tolist() for s, e in zip(t.starts[:-1], t.starts[1:], strict=True)]
    assert frames == [list(range(10)), list(range(16, 26))]  # 3.6 s is the last before, 6.4 s the first after
    np.testing.assert_allclose(t.x, t.frame * t.dt, atol=1e-9)


def test_splits_at_jumps_that_the_type_cannot_make() -> None:
    time = np.arange(251) * 0.04
    x = time + np.where(time > 5, 3.0, 0.0)
    assert resample(samples(time, x, 0.0)).ids == ("a", "a#1")
    assert resample(samples(time, x, 0.0, **car())).ids == ("a",)  # 76 m/s, but only 0.2 m more than a car could


def test_rows_that_mostly_follow_after_a_gap_have_wrong_times() -> None:
    time = np.r_[np.arange(10) * 0.04, 10.0 + np.arange(11)]  # 9 close pairs, 11 others
    with pytest.raises(InputError, match=r"f\.csv: .* follow each other every 1 s \(median\) instead of 0\.04 s"):
        resample(samples(time, 0.0, 0.0))
    assert len(resample(samples(time[:-2], 0.0, 0.0)).ids) > 1  # 9 and 9


def mixed(*rates: float, seconds: float = 20.0, **changes: Any) -> Samples:
    """Two cars and two pedestrians, each with rows at a rate of its own, 1/s."""
    times = [np.arange(round(seconds * rate) + 1) / rate for rate in rates]
    user = np.repeat(np.arange(4), [len(time) for time in times])
    time = np.concatenate(times)
    fields: dict[str, Any] = {
        "user": user,
        "period": 0.1,
        "ids": ("c", "d", "p", "q"),
        "type": np.array([0, 0, 2, 2], np.int8),
        "length": np.ones(4),
        "width": np.ones(4),
        "still": np.zeros(4),
    }
    return samples(time, 1.5 * time, user * 5.0, **(fields | changes))


@pytest.mark.parametrize("rates", [(5, 5, 10, 10), (10, 5, 10, 2.5), (2, 2.5, 25, 10)])
def test_the_period_of_each_road_user_tells_its_gaps(rates: tuple[float, ...]) -> None:
    whole = resample(mixed(*rates))
    assert whole.ids == ("c", "d", "p", "q")
    assert len(whole) == 4 * 51
    assert not whole.notes
    some = mixed(*rates)
    kept = (some.user % 2 == 0) | (some.time < 8.1) | (some.time > 10.1)
    thinned = replace(some, **{name: getattr(some, name)[kept] for name in ("user", "time", "x", "y", "heading")})
    t = resample(thinned)
    assert t.ids == ("c", "d", "d#1", "p", "q", "q#1")
    assert t.notes == ("2 of 4 road users split at gaps or jumps",)


def test_a_type_whose_times_are_in_another_unit_is_told() -> None:
    some = mixed(10, 10, 10, 10)
    wrong = replace(some, time=np.where(some.type[some.user] == 0, 1000.0 * some.time, some.time))
    with pytest.raises(
        InputError, match=r"f\.csv: rows of a car follow each other every 100 s \(median\) instead of 0\.1 s"
    ):
        resample(wrong)


def test_what_is_split_or_left_out_is_counted() -> None:
    time = np.r_[0.0, 0.04, 0.5, 0.54, 0.8, 0.84, np.arange(10) * 0.04 + 1.21]
    t = resample(samples(time, 0.0, 0.0))
    assert t.notes == ("1 of 1 road users split at gaps or jumps; 2 pieces shorter than 0.4 s left out",)
    user = np.r_[np.zeros(20, np.int64), 1, 1]
    two = {"ids": ("a", "b"), "type": np.array([2, 2], np.int8), "still": np.zeros(2)}
    sizes = {"length": np.ones(2), "width": np.ones(2)}
    t = resample(samples(np.r_[np.arange(20) * 0.04, 0.5, 0.54], 0.0, 0.0, user=user, **two, **sizes))
    assert t.ids == ("a",)
    assert t.notes == ("1 piece shorter than 0.4 s left out (1 road user altogether)",)


def test_speeds_in_another_unit_are_told() -> None:
    def notes(speeds: list[float], kind: int) -> tuple[str, ...]:
        time = np.tile(np.arange(251) * 0.04, len(speeds))
        user = np.repeat(np.arange(len(speeds)), 251)
        n = len(speeds)
        return resample(
            samples(
                time,
                np.array(speeds)[user] * time,
                user * 5.0,
                user=user,
                ids=tuple(f"u{i}" for i in range(n)),
                type=np.full(n, kind, np.int8),
                length=np.ones(n),
                width=np.ones(n),
                still=np.zeros(n),
            )
        ).notes

    walk = [1.2, 1.4, 1.1, 0.0, 0.0, 0.0, 0.0]
    assert not notes(walk, 2)
    for factor, shown in ((0.001, "0.0012"), (1 / 21.1857, "0.057"), (3.28, "3.9")):
        (note,) = notes([factor * speed for speed in walk], 2)
        assert note.startswith(f"pedestrians that move do so at {shown} m/s (median), usual are 0.4 to 3.7; check that")
    assert not notes([10.0, 14.0, 0.0], 0)
    assert not notes([36.0, 33.0, 40.0], 0)  # a motorway
    assert len(notes([0.01, 0.014, 0.012], 0)) == 1
    assert not notes([4.0, 5.0, 6.0], 1)
    assert len(notes([13.0, 14.0, 12.0], 1)) == 1
    assert not notes([0.001, 0.001], 2)  # too few to tell


def test_pieces_between_two_frames_are_dropped_and_single_rows_kept() -> None:
    t = resample(samples([0.0, 0.04, 0.5, 0.54, 0.8], 0.0, 0.0))
    assert t.ids == ("a", "a#1")
    assert t.frame.tolist() == [0, 2]
    np.testing.assert_allclose(t.heading, 0.7)  # never moves


def test_order_of_rows_does_not_matter() -> None:
    time = np.arange(100) * 0.04
    shuffled = np.random.default_rng(0).permutation(100)
    a = resample(samples(time, time**2, -time))
    b = resample(samples(time[shuffled], time[shuffled] ** 2, -time[shuffled]))
    np.testing.assert_array_equal(a.x, b.x)
    np.testing.assert_array_equal(a.heading, b.heading)


def test_headings_of_the_data_go_the_short_way_round() -> None:
    time = np.arange(26) * 0.3
    angle = np.radians(170 + 10 * time)  # over 180 degrees
    heading = np.arctan2(np.sin(angle), np.cos(angle))
    t = resample(samples(time, 0.0, 0.0, heading=heading, period=0.3, **car()))
    due = np.radians(170 + 10 * t.frame * t.dt)
    np.testing.assert_allclose(np.cos(t.heading - due), 1.0, atol=1e-12)


@pytest.mark.parametrize("kind", list(RoadUserType))
def test_curves_keep_place_speed_and_yaw_rate(kind: RoadUserType) -> None:
    time = np.arange(0, 601) / 30
    rate, radius = 0.3, 6.0
    x, y = radius * np.cos(rate * time), radius * np.sin(rate * time)
    noise = np.random.default_rng(1).normal(0, 0.03, (2, len(time)))
    t = resample(
        samples(time, x + noise[0], y + noise[1], period=1 / 30, smoothing=SMOOTHING, type=np.array([kind], np.int8))
    )
    due = t.frame * t.dt
    off = np.hypot(t.x - radius * np.cos(rate * due), t.y - radius * np.sin(rate * due))
    inner = slice(4, -4)
    assert off.max() < 0.05
    np.testing.assert_allclose(t.speed[inner], rate * radius, rtol=0.05)
    np.testing.assert_allclose(t.yaw_rate[inner], rate, atol=0.1)
    wrong = np.abs(np.sin(t.heading - (rate * due + np.pi / 2)))
    assert wrong.max() < 0.2  # at the ends, where a curve seems less bent
    assert wrong[inner].max() < 0.05


def test_noise_of_a_slow_car_does_not_become_yaw_rate() -> None:
    time = np.arange(0, 121) * 0.5
    x = np.where(time < 20, 2 * time, np.where(time < 40, 40 + 0.1 * (time - 20), 42 + 2 * (time - 40)))
    noise = np.random.default_rng(2).normal(0, 0.08, (2, len(time)))
    t = resample(samples(time, x + noise[0], noise[1], period=0.5, smoothing=SMOOTHING, **car()))
    plain = np.arctan2(np.diff(noise[1]), np.diff(x + noise[0]))
    assert np.abs(np.diff(plain) / 0.5).max() > 3  # what the directions of raw steps would give
    assert np.abs(t.yaw_rate).max() < 0.25
    assert np.abs(t.heading).max() < 0.15


def test_heading_is_held_while_standing() -> None:
    time = np.arange(0, 1001) * 0.04
    x, y = np.minimum(time, 10.0), np.maximum(time - 30.0, 0.0)  # east, 20 s still, then north
    t = resample(samples(time, x, y))
    stands = (t.speed < 0.01) & (t.frame > 27) & (t.frame < 73)
    assert np.ptp(t.heading[stands]) < 0.15
    assert abs(t.heading[0]) < 0.1
    assert abs(t.heading[-1] - np.pi / 2) < 0.1


def test_a_car_that_reverses_keeps_its_heading_and_others_turn() -> None:
    time = np.arange(0, 1001) * 0.04
    x = np.where(time < 25, 2 * time, 50 - (time - 25))  # 50 m forwards, 15 m back
    backwards = resample(samples(time, x, 0.0, **car()))
    assert np.abs(backwards.heading).max() < 0.01
    walker = resample(samples(time, x, 0.0))
    assert abs(walker.heading[0]) < 0.1
    assert abs(abs(walker.heading[-1]) - np.pi) < 0.1


def test_only_cars_and_bicycles_that_never_leave_are_parked() -> None:
    time = np.arange(0, 501) * 0.04
    jitter = 0.05 * np.sin(time)
    for kind, parked in ((0, True), (1, True), (2, False)):
        assert resample(samples(time, jitter, 0.0, type=np.array([kind], np.int8))).parked.tolist() == [parked]
    assert not resample(samples(time, np.maximum(time - 18, 0), 0.0, **car())).parked.any()  # drives off at last
    assert not resample(samples(time[:50], 0.0, 0.0, **car())).parked.any()  # two seconds do not tell


def test_positions_in_other_units_are_refused() -> None:
    time = np.arange(0, 101) * 0.04
    with pytest.raises(InputError, match=r"f\.csv: 'a' \(pedestrian\) and others move 2\.8 m within 0\.04 s; check"):
        resample(samples(time, 70 * time, 0.0))


def test_headings_in_other_units_are_refused() -> None:
    time = np.arange(0, 101) * 0.04
    with pytest.raises(InputError, match=r"f\.csv: headings and motion differ by 90 degrees"):
        resample(samples(time, 0.0, 5 * time, heading=np.zeros(101), **car()))


def test_no_track_is_in_two_places() -> None:
    with pytest.raises(InputError, match=r"f\.csv: 'a' is twice at 0\.04 s"):
        resample(samples([0, 0.04, 0.04], [0, 1, 2], 0.0))


def test_a_recording_of_one_row_keeps_it() -> None:
    t = resample(samples([3.0], 1.0, 2.0))
    assert (t.x.tolist(), t.y.tolist(), t.heading.tolist()) == ([1.0], [2.0], [0.7])
