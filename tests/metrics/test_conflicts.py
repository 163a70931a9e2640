"""Conflicts found in hand-made trajectories, and against every pair asked for one by one."""

from collections.abc import Sequence

import numpy as np
import pytest
from builders import make_levels, make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.metrics.conflicts import boxes, pet_conflicts, ttc_conflicts, velocities
from slrl_sumo.metrics.surrogate_safety import crossing_angle, post_encroachment_time, time_to_collision

DT = 0.4
NORTH, WEST = 0.5 * np.pi, np.pi


def scene(
    *ways: tuple[Sequence[float], Sequence[float], float], first: int = 0, kinds: Sequence[int] = ()
) -> Trajectories:
    """Cars of 4 by 2 m on ways given as x and y at each frame, with a heading; from the frame `first` on."""
    return make_recording(
        *ways, first=first, type=kinds or 0, length=4.0, width=2.0, ids=[f"car{i}" for i in range(len(ways))]
    )


def straight(
    x: float, y: float, heading: float, speed: float, frames: int = 20
) -> tuple[np.ndarray, np.ndarray, float]:
    way = speed * DT * np.arange(frames)
    return x + way * np.cos(heading), y + way * np.sin(heading), heading


def test_a_head_on_encounter_counts_once_with_its_smallest_time_and_place() -> None:
    x = np.array([0.0, 4.0, 8.0, 12.0, 16.0, 16.5, 16.5, 16.5])
    t = scene((x, 0 * x, 0.0), (43.0 - x, 0 * x, WEST))
    found = ttc_conflicts(t)
    # Bumpers are 43 - 2 x - 4 m apart: 15 m at frame 3, at 20 m/s, 0.75 s; 7 m at frame 4, 0.35 s; 6 m at frame 5, at
    # 2.5 m/s, 2.4 s; and from then on they stand.
    assert (len(found), found.a.tolist(), found.b.tolist()) == (1, [0], [1])
    assert found.value == pytest.approx([0.35])
    assert found.time == pytest.approx([1.6])
    assert (found.x[0], found.y[0]) == pytest.approx((21.5, 0.0))
    assert found.closing == pytest.approx([20.0])
    assert found.angle == pytest.approx([np.pi])
    assert len(pet_conflicts(t)) == 0


def test_road_users_on_different_levels_have_no_conflicts() -> None:
    # Where a bridge leads over a street, both pass at the same time; two followers on the bridge do meet.
    t = scene(straight(-40.0, 0.0, 0.0, 10.0), straight(0.0, -40.0, NORTH, 10.0), straight(-46.0, 0.0, 0.0, 16.0))
    for find in (ttc_conflicts, pet_conflicts):
        assert (0, 1) in {*zip(*(each.tolist() for each in (find(t).a, find(t).b)), strict=True)}
    assert {*ttc_conflicts(t, levels=make_levels()).b.tolist()} == {2}
    assert len(pet_conflicts(t, levels=make_levels())) == 0


def test_a_pair_that_meets_again_later_has_two_encounters() -> None:
    there = np.arange(0.0, 13.0, 4.0)
    x = np.concatenate([there, np.full(8, 12.5), there + 12.5, [24.5]])
    standing = np.concatenate([np.full(12, 20.0), np.full(5, 33.0)])
    t = scene((x, 0 * x, 0.0), (standing, 0 * x, 0.0))
    found = ttc_conflicts(t)
    assert found.time == pytest.approx([1.2, 6.0])
    # 4 m between bumpers at 10 m/s, and 4.5 m.
    assert found.value == pytest.approx([0.4, 0.45])


@pytest.mark.parametrize(
    "ways",
    [
        pytest.param([straight(0, 0, 0, 10), straight(10, 0, 0, 10)], id="following"),
        pytest.param([straight(0, 0, 0, 10), straight(0, 2.5, 0, 12)], id="parallel"),
        pytest.param([straight(0, 0, 0, 10), straight(80, 2.5, WEST, 10)], id="oncoming on the other lane"),
        pytest.param([straight(0, 0, 0, 0), straight(5, 0, 0, 0)], id="standing"),
        pytest.param([straight(0, 0, 0, 0), straight(3, 0, NORTH, 0)], id="overlapping from the start"),
        pytest.param([straight(0, 0, 0, 10)], id="alone"),
        pytest.param(
            [(np.array([1.0]), np.array([0.0]), 0.0), (np.array([9.0]), np.array([0.0]), 0.0)], id="one frame"
        ),
    ],
)
def test_no_conflicts(ways: list[tuple[np.ndarray, np.ndarray, float]]) -> None:
    assert len(ttc_conflicts(scene(*ways))) == 0
    assert len(pet_conflicts(scene(*ways))) == 0


def test_a_crash_is_a_conflict_of_both_kinds_with_the_value_zero() -> None:
    t = scene(straight(0, 0, 0, 10), straight(20, -20, NORTH, 10))
    ttc, pet = ttc_conflicts(t), pet_conflicts(t)
    assert (ttc.value.tolist(), pet.value.tolist()) == ([0.0], [0.0])
    # Front against flank after 1.7 s: seen at 2.0 s, and between the frames at 1.7 or 1.8 s.
    assert ttc.time == pytest.approx([2.0])
    assert pet.time[0] == pytest.approx(1.75, abs=0.06)


def test_post_encroachment_between_frames_is_that_of_the_ways() -> None:
    # As worked out in test_surrogate: left after 2.3 s, reached after 3.0 s.
    t = scene(straight(-20, 0, 0, 10), straight(0, -18, NORTH, 5), first=7)
    found = pet_conflicts(t)
    assert len(found) == 1
    assert 0.7 - 1e-9 <= found.value[0] < 0.9
    assert found.time[0] == pytest.approx(7 * DT + 3.0, abs=0.11)
    assert abs(found.x[0]) < 3
    assert found.angle == pytest.approx([NORTH])
    assert len(pet_conflicts(t, below=0.6)) == 0


def test_following_closely_has_a_headway_and_no_post_encroachment_time() -> None:
    t = scene(straight(0, 0, 0, 10), straight(6, 0, 0, 10))
    assert len(pet_conflicts(t)) == 0


def test_every_pair_asked_for_one_by_one_gives_the_same() -> None:
    rng = np.random.default_rng(5)
    ways = []
    for _ in range(30):
        heading = rng.uniform(-np.pi, np.pi)
        ways.append(straight(*rng.uniform(-50, 50, 2), heading, rng.uniform(2, 12), int(rng.integers(3, 25))))
    t = scene(*ways)
    found, pets = ttc_conflicts(t, below=2.0), pet_conflicts(t)
    assert len(found) > 10
    assert len(pets) > 5
    smallest, crossed = {}, {}
    box, velocity = boxes(t), velocities(t)
    fine = np.arange(25 * 4) / 10
    for a in range(30):
        for b in range(a + 1, 30):
            rows = [np.arange(t.starts[k], t.starts[k + 1]) for k in (a, b)]
            both = min(map(len, rows))
            i, j = rows[0][:both], rows[1][:both]
            ttc = time_to_collision(a=box[i], b=box[j], velocity_a=velocity[i], velocity_b=velocity[j])
            if ttc.min() < 2.0 and ttc[0] > 0.0:
                smallest[a, b] = ttc.min()
            ends = [fine[fine <= (len(r) - 1) * DT + 1e-9] for r in rows]
            moved = []
            for r, times in zip(rows, ends, strict=True):
                way = np.column_stack([np.interp(times, DT * np.arange(len(r)), box[r, k]) for k in (0, 1)])
                moved.append(np.column_stack([way, np.tile(box[r[0], 2:], (len(times), 1))]))
            pet = post_encroachment_time(a=moved[0], b=moved[1], times_a=ends[0], times_b=ends[1])
            wide = crossing_angle(box[i[:1], 2], box[j[:1], 2])[0] >= np.radians(30)
            if pet is not None and pet[0] < 1.0 - 1e-9 and wide and ttc[0] != 0.0:
                crossed[a, b] = pet[0]
    # Straight ways at constant speed: no pair meets twice.
    assert dict(zip(zip(found.a.tolist(), found.b.tolist(), strict=True), found.value, strict=True)) == pytest.approx(
        smallest
    )
    assert dict(zip(zip(pets.a.tolist(), pets.b.tolist(), strict=True), pets.value, strict=True)) == pytest.approx(
        crossed
    )


def test_pedestrians_among_themselves_can_be_left_out() -> None:
    t = scene(
        straight(0, 0, 0, 2), straight(8, 0, WEST, 2), straight(0, 9, 0, 2), straight(8, 9, WEST, 2), kinds=(2, 2, 0, 2)
    )
    found = ttc_conflicts(t)
    assert len(found) == 2
    assert found.with_vehicles(t).a.tolist() == [2]


def test_the_size_of_the_parts_that_are_searched_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(6)
    t = scene(*(straight(*rng.uniform(-30, 30, 2), rng.uniform(-3, 3), rng.uniform(2, 12), 15) for _ in range(12)))
    whole = ttc_conflicts(t), pet_conflicts(t)
    assert all(len(found) > 0 for found in whole)
    monkeypatch.setattr("slrl_sumo.metrics.neighbours.ROWS_AT_ONCE", 7)
    for found, before in zip((ttc_conflicts(t), pet_conflicts(t)), whole, strict=True):
        assert found.value.tolist() == before.value.tolist()
        assert found.time.tolist() == before.time.tolist()


def test_without_road_users_there_are_no_conflicts() -> None:
    no_users = scene()
    assert (len(ttc_conflicts(no_users)), len(pet_conflicts(no_users))) == (0, 0)
    assert len(ttc_conflicts(no_users).with_vehicles(no_users)) == 0
