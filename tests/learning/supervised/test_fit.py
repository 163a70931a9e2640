from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch

from slrl_sumo.agent.selectors import PriorSelector
from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.learning.supervised import network_training as supervised
from slrl_sumo.learning.supervised.fit import fit as fit_bundle
from slrl_sumo.learning.supervised.windows import windows
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.displacement import SPEED
from slrl_sumo.perception.features import COUNTS, FEATURES, features
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.advance import advance
from slrl_sumo.scene.geometry import from_ego, wrap_angle
from slrl_sumo.scene.types import DECISION_INTERVAL, TYPE_NAMES, RoadUserType

fit = partial(fit_bundle, modes="relative", preset="paper")
"""Clusters, and the state of the paper; test_winner_takes_all.py has the defaults."""


def weights(bundle: ModelBundle) -> dict[str, torch.Tensor]:
    state = {f"displacement.{k}": v for k, v in bundle.displacement.state_dict().items()}
    return state | {f"prior.{k}": v for k, v in bundle.prior.state_dict().items()}


def cruising(kind: int, speed: float, headings: int = 16) -> tuple[torch.Tensor, torch.Tensor]:
    """Vectors of road users at a steady speed that face all directions, with no other around."""
    vector = torch.zeros(headings, len(FEATURES))
    vector[:, SPEED] = speed
    vector[:, FEATURES.index(TYPE_NAMES[kind])] = 1.0
    vector[:, FEATURES.index("heading")] = torch.linspace(-3.1, 3.1, headings)
    return vector, torch.full((headings,), kind)


@pytest.mark.slow
def test_one_step_on_held_out_tracks_is_much_better_than_constant_velocity(learned: ModelBundle) -> None:
    for kind in TYPE_NAMES:
        record = learned.training["types"][kind]
        assert record["displacement_error_m"] < 0.4 * record["constant_velocity_error_m"]
        assert record["held_out_windows"] > 100


def test_record_is_what_the_recordings_hold(learned: ModelBundle, traffic: list[Trajectories]) -> None:
    every = windows(traffic)
    for t in RoadUserType:
        record = learned.training["types"][TYPE_NAMES[t]]
        assert record["tracks"] == 144
        assert record["windows"] == int((every.type == t).sum())
        # Each type has few windows, so it learns from mirrored ones too.
        assert 2 * (record["windows"] - record["held_out_windows"]) == int(learned.mode_counts[t].sum())
        by_mode = record["by_mode"]
        assert sum(by_mode["held_out_windows"]) == record["held_out_windows"]
        for key in ("displacement_error_m", "constant_velocity_error_m"):
            assert np.average(by_mode[key], weights=by_mode["held_out_windows"]) == pytest.approx(record[key], rel=1e-5)
        assert record["held_out_windows"] == pytest.approx(0.1 * record["windows"], rel=0.1)
        fastest = np.percentile(every.vector[every.type == t, SPEED], 99)
        assert learned.max_speed[t] == record["max_speed_mps"] == pytest.approx(fastest, rel=0.05)
    assert learned.training["recordings"][1] == {"source": "made traffic 2", "licence": "CC0-1.0", "tracks": 216}
    assert (learned.training["seed"], learned.training["epochs"]) == (4, 15)
    # 9 m/s * 0.25 and 0.7 of it is how hard the made cars brake and accelerate; 0.08 is their tightest curvature.
    car = learned.training["types"]["car"]
    assert car["acceleration_bounds_mps2"] == pytest.approx([-2.25, 1.575], abs=0.01)
    assert car["max_curvature_per_m"] == pytest.approx(0.08, rel=0.05)
    for t in RoadUserType:
        moving = (every.type == t) & (every.vector[:, SPEED] > 0.2)
        hardest = learned.training["types"][TYPE_NAMES[t]]["hardest_braking_mps2"]
        assert every.acceleration[moving].min() - 0.01 <= hardest < learned.usual_braking[t] + 0.1
        assert learned.hardest_braking[t] <= learned.usual_braking[t]


def test_modes_turn_and_hurry_as_their_destinations_say(learned: ModelBundle) -> None:
    for t, speed in ((RoadUserType.CAR, 7.0), (RoadUserType.BICYCLE, 4.0), (RoadUserType.PEDESTRIAN, 1.2)):
        centres, counts = learned.mode_centres[t], learned.mode_counts[t]
        acceleration, yaw_rate = (z.mean(0).numpy() for z in learned.displacement.motion_all(*cruising(t, speed)))
        # Turning road users are 4.8 s later where their circle leads: compare with modes that such a cruise can reach.
        reachable = (counts > 30) & (np.hypot(*centres.T) > 3.0 * speed) & (np.hypot(*centres.T) < 5.2 * speed)
        bearing = np.arctan2(centres[:, 1], centres[:, 0])
        left, right = reachable & (bearing > 0.3), reachable & (bearing < -0.3)
        straight = reachable & (np.abs(bearing) < 0.1)
        assert left.any()
        assert right.any()
        assert straight.any()
        assert yaw_rate[left].min() > 3 * np.abs(yaw_rate[straight]).max()
        assert yaw_rate[right].max() < -3 * np.abs(yaw_rate[straight]).max()
        halting = (counts > 30) & (np.hypot(*centres.T) < 2.0 * speed) & (np.hypot(*centres.T) > 0.5 * speed)
        assert acceleration[halting].mean() < acceleration[straight].mean() - 0.05 * speed


@pytest.mark.slow
def test_relative_modes_speed_up_brake_and_turn_whatever_the_speed(traffic: list[Trajectories]) -> None:
    bundle = fit(traffic, name="a", seed=4, epochs=15)
    assert bundle.training["modes_by"] == "relative"
    # Bicycles, seen at many speeds, that end up farther behind or ahead than their speed says.
    ahead, left = bundle.mode_centres[1].T
    often = bundle.mode_counts[1] > 30
    for speed in (2.5, 4.0):
        vector, kind = cruising(1, speed)
        acceleration, yaw_rate = (z.mean(0).numpy() for z in bundle.displacement.motion_all(vector, kind))
        kept_up = 0.25 * 4.8 * speed  # what relative modes leave of constant velocity
        slower = often & (ahead < kept_up - 4.0) & (np.abs(left) < 2.0)
        same = often & (np.abs(ahead - kept_up) < 1.5) & (np.abs(left) < 1.0)
        turns = often & (np.abs(left) > 3.0)
        assert slower.any()
        assert same.any()
        assert turns.any()
        assert acceleration[slower].mean() < acceleration[same].mean() - 0.1
        assert (yaw_rate[turns] * np.sign(left[turns])).min() > 3 * np.abs(yaw_rate[same]).max()


def test_prior_learned_that_the_fast_get_far(learned: ModelBundle) -> None:
    for t, speeds in ((0, (0.0, 4.0, 8.5)), (1, (0.0, 2.2, 4.6)), (2, (0.0, 0.8, 1.5))):
        far = np.hypot(*learned.mode_centres[t].T)
        expected = [
            float((torch.softmax(learned.prior.logits(*cruising(t, v)), -1) @ torch.from_numpy(far).float()).mean())
            for v in speeds
        ]
        # Standing ones: some stay for good, others go on within 4.8 s; the rest travel most of 4.8 s at their speed.
        assert expected[0] < 0.5 * expected[1]
        assert expected[1] == pytest.approx(4.8 * speeds[1], rel=0.35)
        assert expected[2] == pytest.approx(4.8 * speeds[2], rel=0.35)
        record = learned.training["types"][TYPE_NAMES[t]]
        assert record["prior_cross_entropy_nats"] < record["frequency_cross_entropy_nats"] - 0.5
        assert record["prior_accuracy"] > record["most_frequent_accuracy"] + 0.05  # left and right look alike


def test_a_recording_that_is_turned_teaches_the_same(traffic: list[Trajectories]) -> None:
    plain = traffic[0]
    x, y = from_ego(plain.x, plain.y, 1.1)
    turned = replace(plain, x=x, y=y, heading=wrap_angle(plain.heading + 1.1))
    one, other = (fit([recording], name="a", seed=1, epochs=3) for recording in (plain, turned))
    np.testing.assert_array_equal(one.mode_centres, other.mode_centres)
    torch.testing.assert_close(weights(one), weights(other), rtol=0, atol=1e-3)


def test_closed_loop_stays_within_what_was_recorded(learned: ModelBundle, traffic: list[Trajectories]) -> None:
    world = traffic[0].world(20)
    every, recorded = np.arange(len(world)), windows(traffic)
    selector = PriorSelector(learned, np.random.default_rng(1).random)
    speeds, turns, start = [], [], world
    for _ in range(200):
        seen = Observation(features(world, every), None, world.type)
        acceleration, yaw_rate = learned.motion(seen, *selector.choose(seen))
        world = advance(world, acceleration, yaw_rate, learned.max_speed[world.type], DECISION_INTERVAL)
        speeds.append(world.speed)
        turns.append(np.abs(world.yaw_rate))
    speed, turn = np.stack(speeds), np.stack(turns)
    assert np.isfinite([world.x, world.y, world.heading]).all()
    assert (np.hypot(world.x - start.x, world.y - start.y) <= 80.0 * learned.max_speed[world.type]).all()
    for t in RoadUserType:
        was = recorded.vector[recorded.type == t, SPEED].mean()
        late = speed[100:, world.type == t]
        assert 0.5 * was < late.mean() < 1.3 * was  # neither do all stop nor do all race
        assert late.max() <= learned.max_speed[t]
        assert turn[:, world.type == t].mean() < 2 * np.abs(recorded.yaw_rate[recorded.type == t]).mean()


def test_same_seed_same_weights_and_random_states_are_left_alone(traffic: list[Trajectories]) -> None:
    before = torch.get_rng_state()
    one = fit(traffic[:1], name="a", seed=1, epochs=2)
    torch.testing.assert_close(torch.get_rng_state(), before, rtol=0, atol=0)
    torch.manual_seed(123)
    same, other = (fit(traffic[:1], name="a", seed=seed, epochs=2) for seed in (1, 2))
    torch.set_rng_state(before)
    torch.testing.assert_close(weights(one), weights(same), rtol=0, atol=0)
    np.testing.assert_array_equal(one.mode_centres, same.mode_centres)
    assert one.training == same.training
    for key, value in weights(one).items():
        if "weight" in key:
            assert not torch.equal(value, weights(other)[key])


def test_a_learned_bundle_survives_its_folder(learned: ModelBundle, tmp_path: Path) -> None:
    learned.save(tmp_path / "b")
    loaded = load_bundle(tmp_path / "b")
    torch.testing.assert_close(weights(loaded), weights(learned), rtol=0, atol=0)
    assert loaded.training == learned.training
    assert loaded.card == learned.card


def without(recording: Trajectories, kind: RoadUserType, keep: int = 0) -> Trajectories:
    """The recording with only the first `keep` tracks of a type."""
    mine = recording.type == kind
    kept = ~mine | (mine & (np.cumsum(mine) <= keep))
    rows = kept[recording.track]
    return replace(
        recording,
        track=(np.cumsum(kept) - 1)[recording.track[rows]],
        ids=tuple(name for name, k in zip(recording.ids, kept, strict=True) if k),
        **{name: getattr(recording, name)[rows] for name in ("frame", "x", "y", "heading", "mode")},
        **{name: getattr(recording, name)[kept] for name in ("type", "length", "width", "parked", "learned")},
    )


def test_errors_are_measured_on_test_recordings_which_teach_nothing(traffic: list[Trajectories]) -> None:
    bundle = fit(traffic[:1], name="a", seed=1, epochs=1, tests=traffic[1:], notice="Say **this**.")
    alone = fit(traffic[:1], name="a", seed=1, epochs=1, tests=[replace(traffic[1], x=0.9 * traffic[1].x)])
    torch.testing.assert_close(weights(bundle), weights(alone), rtol=0, atol=0)
    for t in RoadUserType:
        record = bundle.training["types"][TYPE_NAMES[t]]
        assert record["held_out_windows"] == int((windows(traffic[1:]).type == t).sum())
        assert record["displacement_error_m"] != alone.training["types"][TYPE_NAMES[t]]["displacement_error_m"]
    assert "made traffic 2" in bundle.card.split("## Errors")[1]
    assert "Say **this**." in bundle.card


def test_curved_modes_of_mirrored_traffic_turn_alike(traffic: list[Trajectories]) -> None:
    bundle = fit(traffic, name="a", seed=1, epochs=2, modes="curved", mirror=True, forget=0.5)
    for kind in (RoadUserType.CAR, RoadUserType.BICYCLE):
        root, bend = bundle.mode_centres[kind].T
        assert (root >= 0.0).all()
        # What was seen in the mirror too is as often to the left as to the right.
        assert np.average(bend, weights=bundle.mode_counts[kind]) == pytest.approx(0.0, abs=0.05)
        moving = bundle.training["types"][TYPE_NAMES[kind]]["moving_speed_mps"]
        # Centres are means of roots: their squares are a little less than the mean.
        far = root**2 > 2.4
        assert 0.9 * moving < np.average(root[far] ** 2, weights=bundle.mode_counts[kind][far]) / 4.8 < 1.02 * moving
    assert bundle.training["modes_by"] == "curved"
    assert (bundle.training["forget"], bundle.training["mirrored"]) == (0.5, list(TYPE_NAMES))


def test_modes_of_accelerations_do_the_same_in_company(traffic: list[Trajectories]) -> None:
    bundle = fit(traffic, name="a", seed=1, epochs=1, modes="accelerations")
    vector, kind = cruising(0, 8.0, 1)
    crowded = vector.clone()
    crowded[:, COUNTS:] = torch.tensor([1.0, 2.0, 5.0, 2.0, 4.0, 8.0])
    alone, there = bundle.displacement.motion_all(vector, kind), bundle.displacement.motion_all(crowded, kind)
    assert torch.equal(alone[0], there[0])
    assert torch.equal(alone[1], there[1])
    assert not torch.equal(bundle.prior.logits(vector, kind), bundle.prior.logits(crowded, kind))


def test_every_group_has_its_share_of_an_epoch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervised, "EPOCH_PATHS", 40)
    group = np.repeat([0, 3, 5, 9], [1000, 4, 100, 12])
    some = supervised.some_windows(group, np.random.default_rng(0))
    assert len(set(some.tolist())) == len(some)
    assert np.bincount(group[some])[[0, 3, 5, 9]].tolist() == [10, 4, 10, 10]
    again = supervised.some_windows(group, np.random.default_rng(1))
    assert set(some.tolist()) != set(again.tolist())
    # In a random order, not one group after another.
    assert (np.diff(group[some]) < 0).any()
    # What fits into an epoch is taken whole.
    assert sorted(supervised.some_windows(group[-30:], np.random.default_rng(0)).tolist()) == list(range(30))


@pytest.mark.parametrize("kind", RoadUserType)
def test_a_type_without_enough_tracks_is_left_out(
    traffic: list[Trajectories], kind: RoadUserType, tmp_path: Path
) -> None:
    keep, name = kind % 2, TYPE_NAMES[kind]
    bundle = fit([without(traffic[0], kind, keep)], name="two", seed=1, epochs=1, stride=6)
    others = [t for t in RoadUserType if t != kind]
    assert np.flatnonzero(bundle.types).tolist() == others
    assert list(bundle.training["types"]) == [TYPE_NAMES[t] for t in others]
    assert bundle.training["left_out"][name].startswith(f"{keep} track{'s' * (keep != 1)} of 6 s or longer")
    assert f"**No models of type {name}**" in bundle.card
    bundle.save(tmp_path / "two")  # all weights are finite, or it could not be loaded
    again = load_bundle(tmp_path / "two")
    assert again.types.tolist() == bundle.types.tolist()
    assert again.max_speed[kind] == 0
    assert (again.max_speed[others] > 0.5).all()


def test_a_type_alone_is_enough_and_tests_may_lack_others(traffic: list[Trajectories]) -> None:
    alone = without(without(traffic[0], RoadUserType.CAR, 0), RoadUserType.BICYCLE, 0)
    bundle = fit(traffic[1:], name="one", seed=1, epochs=1, stride=6, tests=[alone])
    assert bundle.types.tolist() == [False, False, True]
    assert "0 to test" in bundle.training["left_out"]["car"]
    assert bundle.card.splitlines()[2].startswith("Learned pedestrians for slrl_sumo")


def test_what_cannot_be_learned_from_is_refused(traffic: list[Trajectories], brief_traffic: Trajectories) -> None:
    with pytest.raises(InputError, match="there is no such clustering; use paths, relative, kmeans, balanced"):
        fit(traffic, name="a", seed=1, modes="k-means")
    for epochs in (0, -1):
        with pytest.raises(InputError, match=f"epochs={epochs}: give a whole number from 1 to"):
            fit(traffic, name="a", seed=1, epochs=epochs)
    with pytest.raises(InputError, match="at least one recording"):
        fit([], name="a", seed=1)
    with pytest.raises(InputError, match=r"made traffic 1 has an interval of 0\.5 s"):
        fit([replace(traffic[0], dt=0.5)], name="a", seed=1)
    still = replace(traffic[0], x=np.zeros(len(traffic[0])), y=np.zeros(len(traffic[0])))
    with pytest.raises(InputError, match="car: 1 distinct destinations"):
        fit([still], name="a", seed=1)
    with pytest.raises(InputError, match="tracks of 6 s or longer"):
        fit([brief_traffic], name="a", seed=1)
