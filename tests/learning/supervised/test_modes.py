import numpy as np
import pytest
from sklearn.cluster import KMeans

from slrl_sumo.errors import InputError
from slrl_sumo.learning.supervised import modes
from slrl_sumo.learning.supervised.goals import trained_ranges
from slrl_sumo.learning.supervised.modes import (
    BEND_WEIGHT,
    GENTLE,
    acceleration_ranges,
    assign,
    balance,
    balance_accelerations,
    cluster,
    curved,
    relative_accelerations,
)
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType


def blobs(random: np.random.Generator, middles: list[tuple[float, float]], each: int = 200) -> Floats:
    return np.concatenate([random.normal(middle, 0.1, (each, 2)) for middle in middles])


def test_clusters_are_found_and_sorted_by_distance_then_angle() -> None:
    middles = [(0.0, 0.0), (5.0, 0.0), (12.0, -8.0), (12.0, 8.0), (30.0, 0.0)]
    points = blobs(np.random.default_rng(0), middles)
    points[:200] = 0.0  # exactly one place, as of road users that stand
    shuffled = np.random.default_rng(1).permutation(points)
    centres = cluster(shuffled, 5, seed=3)
    near = np.hypot(*centres.T)
    assert (np.diff(near) > -1e-12).all()
    centres[2:4] = centres[2:4][np.argsort(centres[2:4, 1])]  # about equally far: either may come first
    np.testing.assert_allclose(centres, middles, atol=0.05)
    np.testing.assert_array_equal(assign(points, centres), np.repeat(np.arange(5), 200))
    np.testing.assert_array_equal(cluster(np.array([[3.0, 4], [5, 0], [0, 5], [0, -5]]), 4, 0)[:, 1], [-5, 0, 4, 5])


def test_balanced_modes_give_turns_more_than_their_share() -> None:
    random = np.random.default_rng(0)
    straight = np.stack([random.uniform(0, 40, 9800), random.normal(0, 0.5, 9800)], -1)
    turning = np.stack([random.uniform(5, 15, 200), random.uniform(5, 15, 200) * random.choice([-1, 1], 200)], -1)
    points = np.concatenate([straight, turning])
    plain, balanced = (cluster(points, 20, 1, weigh=how) for how in (None, balance))
    far = [np.abs(np.arctan2(centres[:, 1], centres[:, 0])) > 0.4 for centres in (plain, balanced)]
    assert far[1].sum() >= far[0].sum() + 3
    # The few that turn are nearer to their mode, those that go straight not much farther from theirs.
    off = [np.hypot(*(points - centres[assign(points, centres)]).T) for centres in (plain, balanced)]
    assert off[1][9800:].mean() < 0.7 * off[0][9800:].mean()
    assert off[1][:9800].mean() < 2.0 * off[0][:9800].mean()


def test_balance_weighs_by_what_is_rare() -> None:
    # Nine go straight and one turns, all at one speed: weights 9^-1/2 and 1^-1/2; a count counts like so many rows.
    points = np.array([[10.0, 0.0]] * 9 + [[6.0, 8.0]])
    np.testing.assert_allclose(balance(points, np.ones(10, np.int64)), [1 / 3] * 9 + [1])
    np.testing.assert_allclose(balance(points[8:], np.array([9, 1])), [3, 1])


@pytest.mark.parametrize("kind", [RoadUserType.CAR, RoadUserType.BICYCLE])
def test_curved_is_distance_and_curvature_of_the_first_circle(kind: RoadUserType) -> None:
    radius, turned = 10.0, np.array([0.5, 1.0])
    circle = np.stack([radius * np.sin(turned), radius * (1.0 - np.cos(turned))], -1)
    far = np.array([[25.0, 0.0], [3.0, 4.0]])
    root, bend = curved(far, circle, kind).T
    assert root == pytest.approx(np.sqrt([25.0, 5.0]))
    assert bend == pytest.approx(0.1 * np.array([25.0, 5.0]) ** GENTLE[kind] / BEND_WEIGHT[kind])
    # Right is left in a mirror, straight on is no curve, and standing still is neither far nor bent.
    assert curved(far, circle * [1.0, -1.0], kind)[:, 1] == pytest.approx(-bend)
    still = np.zeros((1, 2))
    assert curved(np.array([[25.0, 0.0]]), np.array([[10.0, 0.0]]), kind).tolist() == [[5.0, 0.0]]
    assert curved(still, still, kind).tolist() == [[0.0, 0.0]]
    assert abs(curved(np.array([[0.001, 0.002]]), np.array([[0.001, 0.002]]), kind)[0, 1]) < 0.5


def test_curved_modes_tell_slow_turns_apart() -> None:
    # Mostly straight on at all speeds; some come 5 m far, in turns of 8 m radius to either side.
    random = np.random.default_rng(0)
    straight = np.stack([random.uniform(0, 40, 9600), random.normal(0, 0.05, 9600)], -1)
    turn = random.normal(5.0, 0.2, 400) / 8.0
    left = random.choice([-1, 1], 400)

    def on_circle(angle: Floats) -> Floats:
        return np.stack([8.0 * np.sin(angle), left * 8.0 * (1.0 - np.cos(angle))], -1)

    points = np.concatenate([straight, on_circle(turn)])
    first = np.concatenate([0.4 * straight, on_circle(0.5 * turn)])
    for goal, apart in ((points, False), (curved(points, first, RoadUserType.CAR), True)):
        mode = assign(goal, cluster(goal, 20, 1, weigh=balance if apart else None))
        one, other = set(mode[9600:][left > 0].tolist()), set(mode[9600:][left < 0].tolist())
        assert (not one & other and not (one | other) & set(mode[:9600].tolist())) == apart


def test_same_seed_same_centres() -> None:
    points = np.random.default_rng(0).normal(0, 10, (3000, 2))
    np.testing.assert_array_equal(cluster(points, 20, 1), cluster(points, 20, 1))
    assert (cluster(points, 20, 1) != cluster(points, 20, 2)).any()


def test_too_few_distinct_destinations_name_type_and_count() -> None:
    random = np.random.default_rng(0)
    points = np.repeat(np.round(random.normal(0, 10, (19, 2)), 2), 50, 0)
    points += random.normal(0, 1e-9, points.shape)  # rounding errors make no new destination
    with pytest.raises(InputError, match=r"bicycle: 19 distinct destinations .* 20 modes"):
        cluster(points, 20, 0, "bicycle")


def test_a_share_is_enough_where_there_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    middles = [(0.0, 0.0), (10.0, 0.0), (20.0, 5.0)]
    points = blobs(np.random.default_rng(0), middles, 2000)
    seen = []
    real = KMeans.fit

    def fit(self: KMeans, x: Floats, sample_weight: Floats) -> KMeans:
        seen.append(len(x))
        return real(self, x, sample_weight=sample_weight)

    monkeypatch.setattr(modes, "ENOUGH", 500)
    monkeypatch.setattr(KMeans, "fit", fit)
    np.testing.assert_allclose(cluster(points, 3, 0), middles, atol=0.05)
    assert seen == [500]


def accelerated(speed: Floats, forward: Floats, yaw_rate: Floats) -> Floats:
    """Paths (N, 12, 2) at constant acceleration and yaw rate, as SUMO and `advance` move vehicles."""
    after = np.arange(1, 13) * DECISION_INTERVAL
    distance = np.maximum(speed[:, None] + forward[:, None] * after, 0.0) * DECISION_INTERVAL
    heading = yaw_rate[:, None] * (after - 0.5 * DECISION_INTERVAL)
    return np.stack([distance * np.cos(heading), distance * np.sin(heading)], -1).cumsum(axis=1)


def test_relative_accelerations_are_shares_of_what_was_recorded_at_that_speed() -> None:
    rng = np.random.default_rng(0)
    speed = rng.uniform(2.0, 14.0, 40_000)
    # What is possible falls with speed: 3 m/s² at 2 m/s, 1 m/s² at 14 m/s; sideways 2 m/s² everywhere.
    most = 3.0 - (speed - 2.0) / 6.0
    share, aside = rng.uniform(-1.0, 1.0, (2, len(speed)))
    path = accelerated(speed, share * most, 2.0 * aside / speed)
    known = acceleration_ranges(speed, path)
    found = relative_accelerations(speed, path, known)
    assert found[:, 0] == pytest.approx(share, abs=0.2)
    gentle = np.abs(share) < 0.2
    # The circle through a place after 1.2 s is a little wider than the first one.
    assert found[gentle, 1] == pytest.approx(np.sign(aside[gentle]) * np.sqrt(np.abs(aside[gentle])), abs=0.4)
    assert np.corrcoef(found[:, 1], np.sign(aside) * np.sqrt(np.abs(aside)))[0, 1] > 0.97
    assert known.to_json().keys() == {"speeds", "forward", "braking", "lateral"}


def test_modes_of_accelerations_accelerate_and_steer_at_every_speed() -> None:
    """Nine of ten go straight on at constant speed: modes for the others are there all the same."""
    rng = np.random.default_rng(1)
    speed = rng.uniform(2.0, 14.0, 20_000)
    rare = rng.random(20_000) < 0.1
    forward, lateral = np.where(rare, rng.uniform(-3.0, 2.0, 20_000), 0.0), np.where(rare, rng.normal(0, 1, 20_000), 0)
    path = accelerated(speed, forward, lateral / speed)
    goal = relative_accelerations(speed, path, acceleration_ranges(speed, path))
    mode = assign(goal, cluster(goal, 20, 1, weigh=balance_accelerations))
    for slow, fast in ((2.0, 5.0), (11.0, 14.0)):
        here = (speed > slow) & (speed < fast)
        means = np.array([[v[here & (mode == k)].mean() for v in (forward, lateral)] for k in set(mode[here].tolist())])
        assert (means[:, 0] > 1.3).any()
        assert (means[:, 0] < -2.0).any()
        without_braking = means[np.abs(means[:, 0]) < 0.7, 1]
        assert (np.abs(without_braking) > 1.2).any()
        assert ((np.abs(without_braking) > 0.1) & (np.abs(without_braking) < 0.8)).any()


def test_ranges_come_back_from_the_training_record() -> None:
    speed = np.random.default_rng(2).uniform(2.0, 14.0, 5_000)
    known = acceleration_ranges(speed, accelerated(speed, 0.1 * speed, 1.0 / speed))
    (back,) = trained_ranges({"acceleration_ranges": {"car": known.to_json()}}).items()
    assert back[0] == RoadUserType.CAR
    assert back[1].to_json() == known.to_json()
    assert trained_ranges({"modes_by": "kmeans"}) == {}
