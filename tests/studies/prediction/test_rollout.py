from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch
from builders import make_bundle, make_recording

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.mask import everywhere_road
from slrl_sumo.ground.road_map import Area, RoadMap, Surface, SurfaceShapes
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.perception.features import features
from slrl_sumo.perception.observation import Observation
from slrl_sumo.studies.prediction.evaluate import evaluate
from slrl_sumo.studies.prediction.long_rollout import long_rollout, long_rollout_figures
from slrl_sumo.studies.prediction.predictors import (
    PriorRanked,
    constant_velocity,
    held_mode,
    policy_chosen,
    prior_sampled,
    step_oracle,
)
from slrl_sumo.studies.prediction.rollout import STEPS, Moment, Motion, cast_of, rollout
from slrl_sumo.studies.prediction.rollout_realism import recorded
from slrl_sumo.studies.prediction.selector_rollouts import SAMPLES, stratified

Path = tuple[int, np.ndarray]
"""First frame, and x, y, heading per row, (n, 3)."""


NOWHERE = RoadMap(SurfaceShapes(()))


def recording(paths: list[Path], kinds: list[int]) -> Trajectories:
    poses, first = [path.T for _, path in paths], [first for first, _ in paths]
    return make_recording(*poses, first=first, type=kinds, length=1.0, width=1.0, source="by hand")


def straight(rows: int, speed: float, y: float = 0.0, first: int = 0) -> Path:
    return first, np.stack([0.4 * speed * np.arange(rows), np.full(rows, y), np.zeros(rows)], -1)


def circle(rows: int, speed: float, yaw_rate: float, y: float = 0.0) -> Path:
    """As `advance` would go: the displacement of an interval has the mean heading of its ends."""
    heading = 0.4 * yaw_rate * np.arange(rows)
    middle = heading[:-1] + 0.2 * yaw_rate
    xy = np.concatenate([[[0.0, 0.0]], np.cumsum(0.4 * speed * np.stack([np.cos(middle), np.sin(middle)], -1), 0)])
    return 0, np.column_stack([xy[:, 0], xy[:, 1] + y, np.angle(np.exp(1j * heading))])


def test_constant_velocity_is_exact_on_a_straight_track() -> None:
    made = recording([straight(40, 1.5), straight(40, 7.0, y=30)], [2, 0])
    errors = rollout(made, cast_of(made, np.arange(0, 40, 3)), constant_velocity)
    assert errors.steps.max() == STEPS
    np.testing.assert_allclose(errors.error, 0.0, atol=1e-9)


def test_on_a_circle_constant_velocity_errs_as_the_formula_says() -> None:
    speed, yaw_rate = 5.0, 0.3
    made = recording([circle(30, speed, yaw_rate)], [0])
    errors = rollout(made, cast_of(made, np.array([4])), constant_velocity)
    k = np.arange(1, STEPS + 1)
    # Chords of 0.4 v that turn by 0.4 w each, seen from the heading at the start.
    turned = 0.4 * yaw_rate * (k - 0.5)
    true = np.cumsum(0.4 * speed * np.exp(1j * turned))
    np.testing.assert_allclose(errors.error[0], np.abs(0.4 * speed * k - true), rtol=1e-9)


def test_what_is_seen_lies_in_memory_as_in_a_run() -> None:
    made, seen = recording([straight(40, 1.5), straight(40, 7.0, y=30)], [2, 0]), []

    def look(moment: Moment) -> Motion:
        seen.append(moment.world)
        still = np.zeros(len(moment.rows))
        return still, still, still

    rollout(made, cast_of(made, np.arange(0, 40, 3)), look)
    # What is compiled for runs is not compiled once more.
    assert len(seen) == STEPS
    assert all(world.x.flags.c_contiguous and world.speed.flags.c_contiguous for world in seen)


def test_tracks_count_from_their_first_to_their_last_frame() -> None:
    # Frames 0..39; 5..39: comes later; 0..11: leaves; 10..11: too short. The bus stands parked.
    paths = [straight(40, 1.0), straight(35, 1.0, 9, first=5), straight(12, 1.0, 18), straight(2, 1.0, 27, first=10)]
    made = recording([*paths, straight(40, 0.0, 36)], [2, 1, 2, 2, 0])
    made = replace(made, parked=np.arange(5) == 4)
    seen: list[tuple[int, int, int]] = []

    def watch(moment: Moment) -> Motion:
        seen.append((moment.step, len(moment.world), len(moment.rows)))
        return constant_velocity(moment)

    errors = rollout(made, cast_of(made, np.array([2])), watch)
    # From frame 2: the first for 16 intervals; the second appears at frame 5 and is simulated from frame 7 to 18,
    # which is 11 intervals; the third ends at frame 11 after 9; the fourth never has two intervals behind it.
    np.testing.assert_array_equal(errors.steps, [16, 11, 9, 0, 0])
    assert [(n, m) for _, n, m in seen] == [
        *[(3, 2)] * 3,  # frames 2, 3, 4: first, third and the parked one
        *[(4, 2)] * 2,  # 5, 6: the second is there as recorded
        *[(4, 3)] * 3,  # 7, 8, 9
        (5, 3),  # 10: the fourth
        (5, 2),  # 11: the third's track ends
        *[(3, 2)] * 6,
    ]


def test_cars_that_reverse_are_there_as_recorded(bundle: ModelBundle) -> None:
    # Backwards from frame 20 to 24. The bicycle with the same path is simulated: it has turned, not reversed.
    made = recording([straight(60, 1.0), straight(60, 1.0, 9)], [0, 1])
    back = np.where((made.frame >= 20) & (made.frame < 25), -0.4, 0.4)
    made = replace(made, x=np.r_[np.cumsum(back[:60]), np.cumsum(back[60:])])
    cast = cast_of(made, np.array([0, 3, 4, 20, 25, 26]))
    # From frame 4 on the last interval of 16 is backwards; at frame 26 the two before are forwards again.
    assert cast.reverses.tolist() == [False, False, False, False, True, False, True, False, True, False, False, False]
    errors = rollout(made, cast, constant_velocity)
    assert errors.steps.tolist() == [14, 14, 16, 16, 0, 16, 0, 16, 0, 16, 16, 16]
    assert evaluate(made, bundle, starts_every=1)["reversing"] == 26 - 4


def test_scenes_do_not_see_each_other_and_batches_do_not_matter(bundle: ModelBundle) -> None:
    random = np.random.default_rng(3)
    paths = [circle(int(n), v, w, y) for n, v, w, y in zip(
        random.integers(20, 60, 12), random.uniform(0.5, 5, 12), random.uniform(-0.2, 0.2, 12), np.arange(12) * 2.0,
        strict=True)]  # fmt: skip
    made = recording(paths, [0, 1, 2] * 4)
    for move in (partial(step_oracle, ground=NOWHERE), drawn_alike):
        starts = np.arange(0, 40, 7)
        whole = rollout(made, cast_of(made, starts), move(bundle)).error
        single = [rollout(made, cast_of(made, starts[i : i + 1]), move(bundle)).error for i in range(len(starts))]
        # Products over other numbers of rows differ in the last digit, which grows over 16 steps.
        np.testing.assert_allclose(whole, np.concatenate(single), rtol=1e-3, atol=2e-3)
    one, many = (evaluate(made, bundle, starts_every=11, batch=batch) for batch in (1, 64))
    assert one["rows"] == [
        {key: pytest.approx(value, rel=1e-3) if isinstance(value, float) else value for key, value in row.items()}
        for row in many["rows"]
    ]


def drawn_alike(bundle: ModelBundle) -> Callable[[Moment], Motion]:
    return prior_sampled(bundle, NOWHERE, np.full((10_000, STEPS, 2), 0.4))


def test_the_step_oracle_takes_the_nearest_of_all_modes(bundle: ModelBundle) -> None:
    made = recording([circle(30, 4.0, 0.2), circle(30, 1.2, -0.5, y=8)], [1, 2])
    cast = cast_of(made, np.arange(2, 12))

    def fixed(mode: int) -> Callable[[Moment], Motion]:
        def move(moment: Moment) -> Motion:
            kind = moment.world.type[moment.rows]
            seen = Observation(features(moment.world, moment.rows, moment.scene), None, kind)
            acceleration, yaw_rate = bundle.motion(seen, np.full(len(kind), mode))
            return acceleration, yaw_rate, bundle.max_speed[kind]

        return move

    best = rollout(made, cast, step_oracle(bundle, NOWHERE)).error[:, 0]
    each = np.stack([rollout(made, cast, fixed(mode)).error[:, 0] for mode in range(20)])
    np.testing.assert_allclose(best, each.min(0), rtol=1e-4)
    assert (best < each.mean(0)).all()


def test_samples_of_the_prior_hold_different_modes_and_include_the_best_one(bundle: ModelBundle) -> None:
    made = recording([circle(30, 4.0, 0.2), circle(30, 1.2, -0.5, y=90)], [1, 2])
    cast = cast_of(made, np.arange(2, 12))
    held = np.stack([rollout(made, cast, held_mode(bundle, NOWHERE, mode)).error for mode in range(20)])
    ranked = np.stack(
        [rollout(made, cast, PriorRanked(bundle, NOWHERE, np.full(len(cast), rank))).error for rank in range(20)]
    )
    assert (np.abs(np.sort(held, 0) - np.sort(ranked, 0)) < 1e-3).all()  # every mode, each once
    rows = {(row["selector"], row["type"]): row for row in evaluate(made, bundle)["rows"] if row["step"] == STEPS}
    for kind in ("bicycle", "pedestrian"):
        floor = rows["mode-oracle", kind]
        assert floor["ade_m"] == floor["min_ade_m"] == pytest.approx(rows["prior", kind]["min_ade_m"], rel=1e-3)
        assert rows["step-oracle", kind]["ade_m"] != pytest.approx(floor["ade_m"], rel=1e-2)


def test_stratified_numbers_fill_all_strata() -> None:
    numbers = stratified(np.random.default_rng(1).random((SAMPLES, 7, STEPS, 2)))
    strata = np.sort((numbers * SAMPLES).astype(int), axis=0)
    assert (strata == np.arange(SAMPLES)[:, None, None]).all()
    assert len(np.unique(numbers[:, 0, 0] * SAMPLES % 1)) == SAMPLES


def test_tables_count_all_tracks_and_the_best_sample_is_no_worse_than_the_mean(bundle: ModelBundle) -> None:
    made = recording([straight(30, 1.2), circle(24, 4.0, 0.2, y=6)], [2, 1])
    result = evaluate(made, bundle, starts_every=3)
    rows = {(row["selector"], row["type"], row["step"]): row for row in result["rows"]}
    starts = np.arange(0, 30, 3)
    for kind, last in (("pedestrian", 29), ("bicycle", 23)):
        # Tracks that start at frame 0 are simulated from frame 2 on.
        steps = np.minimum(last, starts + STEPS) - np.maximum(starts, 2)
        for step in range(1, STEPS + 1):
            for selector in ("constant-velocity", "prior", "step-oracle", "mode-oracle"):
                assert rows[selector, kind, step]["n"] == int((steps >= step).sum())
    np.testing.assert_allclose(rows["constant-velocity", "pedestrian", 16]["fde_m"], 0, atol=1e-9)
    # The mean error is over the steps so far, of tracks that are simulated at least that long.
    cast = cast_of(made, starts)
    plain = rollout(made, cast, constant_velocity)
    bicycles = (plain.type == 1) & (plain.steps >= 5)
    row = rows["constant-velocity", "bicycle", 5]
    assert row["ade_m"] == row["min_ade_m"] == pytest.approx(plain.error[bicycles, :5].mean())
    assert row["fde_m"] == row["min_fde_m"] == pytest.approx(plain.error[bicycles, 4].mean())
    # The bicycle turns by 0.08 rad each interval, so over 16 of them by more than 20 degrees.
    assert {row["type"] for row in result["bends"]} == {"bicycle"}
    assert evaluate(made, bundle, starts_every=3) == result
    assert evaluate(made, bundle, starts_every=3, seed=2)["driving"] != result["driving"]
    assert result["samples"] == SAMPLES == 20


def test_the_best_of_all_samples_is_kept_for_each_road_user(
    bundle: ModelBundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = recording([straight(30, 1.2), straight(30, 1.2, y=50)], [2, 2])
    calls = []

    def made_up(bundle: ModelBundle, ground: RoadMap, rank: np.ndarray) -> Callable[[Moment], Motion]:
        def move(moment: Moment) -> Motion:
            # Sample s drives with acceleration s - 7: the eighth sample is exact.
            calls.append(len(moment.rows))
            sample = rank[moment.users]
            n = len(moment.rows)
            return sample.astype(np.float64) - 7.0, np.zeros(n), np.full(n, np.inf)

        return move

    monkeypatch.setattr("slrl_sumo.studies.prediction.selector_rollouts.PriorRanked", made_up)
    rows = evaluate(made, bundle, selectors=["prior"], starts_every=5)["rows"]
    assert max(row["min_ade_m"] for row in rows) < 1e-9
    assert max(row["min_fde_m"] for row in rows) < 1e-9
    assert max(row["ade_m"] for row in rows) > 0.1
    assert max(calls) >= 2 * SAMPLES


def test_a_trained_selector_sees_the_ground_and_its_own_scene(bundle: ModelBundle) -> None:
    torch.manual_seed(3)
    policy = Policy(PolicyConfig())
    with torch.no_grad():  # trained ones are not zero
        for actor in policy.actors:
            list(actor.parameters())[-2].normal_()
    trained = replace(bundle, policy=policy)
    made = recording([circle(30, 4.0, 0.2), circle(30, 1.2, -0.3, y=8), straight(30, 1.0, -6)], [1, 2, 2])
    everywhere = everywhere_road(made.x, made.y)
    starts = np.array([2, 6, 9])
    moved = {
        name: rollout(made, cast_of(made, starts), policy_chosen(trained, ground, None)).error
        for name, ground in (("road", everywhere), ("nothing", NOWHERE))
    }
    assert np.abs(moved["road"] - moved["nothing"]).max() > 0.01
    single = [
        rollout(made, cast_of(made, starts[i : i + 1]), policy_chosen(trained, everywhere, None)) for i in range(3)
    ]
    np.testing.assert_allclose(moved["road"], np.concatenate([one.error for one in single]), rtol=1e-3, atol=1e-3)
    result = evaluate(made, trained, starts_every=6)
    assert list(dict.fromkeys(row["selector"] for row in result["rows"])) == [
        "constant-velocity", "prior", "step-oracle", "mode-oracle", "greedy", "sampled",
    ]  # fmt: skip
    drawn = [row for row in result["rows"] if row["selector"] == "sampled" and row["step"] == STEPS]
    assert all(row["min_ade_m"] < row["ade_m"] for row in drawn)


@pytest.mark.parametrize("preset", ["paper", "extended"])
@pytest.mark.parametrize("lookahead", [True, False])
def test_policies_of_every_preset_predict_recordings(bundle: ModelBundle, preset: str, lookahead: bool) -> None:
    """A recording has no routes: what a policy of the preset `extended` reads of them is zero."""
    trained = replace(bundle, policy=Policy(PolicyConfig(preset=preset, lookahead=lookahead)))
    made = recording([circle(30, 4.0, 0.2), straight(30, 1.0, -6)], [1, 2])
    rows = evaluate(made, trained, selectors=["greedy", "sampled"], starts_every=10)["rows"]
    assert {row["selector"] for row in rows} == {"greedy", "sampled"}
    assert all(np.isfinite(row["ade_m"]) for row in rows)


def test_steps_off_the_road_are_counted_with_a_map_only(bundle: ModelBundle) -> None:
    # A bicycle goes 1.6 m per step along +x; the road ends at 20 m.
    made = recording([straight(30, 4.0)], [1])
    road = RoadMap(SurfaceShapes((Area(Surface.ROAD, np.array([[-5.0, -9], [20, -9], [20, 9], [-5, 9]])),)))
    result = evaluate(made, bundle, selectors=["constant-velocity"], roadmap=road, surface="by hand", starts_every=30)
    # It is at 1.6 m times the frame. Simulated are frames 3 to 16, off the road 13 to 16; recorded off are 13 to 29.
    assert result["off_surface"] == [
        {"selector": "recorded", "type": "bicycle", "share": 17 / 30, "steps": 30},
        {"selector": "constant-velocity", "type": "bicycle", "share": pytest.approx(4 / 14), "steps": 14},
    ]
    assert result["surface"] == "by hand"
    plain = evaluate(made, bundle, selectors=["constant-velocity"], starts_every=30)
    assert plain["off_surface"] == []
    assert plain["surface"].startswith("everything is road")


def test_a_long_rollout_moves_all_that_are_present(bundle: ModelBundle) -> None:
    made = recording([straight(30, 2.0), circle(30, 4.0, 0.25, y=9), straight(20, 1.0, 18, first=10)], [2, 1, 2])
    drive = long_rollout(made, np.array([5]), lambda cast: constant_velocity)
    np.testing.assert_array_equal(drive.type, [2, 1])  # the third comes later
    np.testing.assert_allclose(drive.distance, [64 * 0.4 * 2.0, 64 * 0.4 * 4.0])
    np.testing.assert_allclose(drive.sideslip, 0, atol=1e-9)
    np.testing.assert_allclose(drive.nearest[0], drive.nearest[1])  # there are two

    def spin(moment: Moment) -> Motion:
        n = len(moment.rows)
        return np.full(n, 1.0), np.full(n, 0.5), np.full(n, 3.0)

    drive = long_rollout(made, np.array([5]), lambda cast: spin)
    np.testing.assert_allclose(drive.speed[0, :3], [2.4, 2.8, 3.0])
    np.testing.assert_allclose(drive.yaw_rate, 0.5)
    np.testing.assert_allclose(drive.sideslip, 0.1)  # half of the turn of 0.2 rad


def test_long_rollouts_are_compared_with_what_was_recorded(bundle: ModelBundle) -> None:
    """Of three pedestrians two walk and one stands."""
    made = recording([straight(90, 1.25), straight(90, 1.25, 2.0), straight(90, 0.0, 30)], [2, 2, 2])

    def stand(moment: Moment) -> Motion:
        n = len(moment.rows)
        return np.full(n, -9.0), np.zeros(n), np.full(n, 3.0)

    drives = {"straight": long_rollout(made, np.array([5]), lambda cast: constant_velocity)}
    drives["stand"] = long_rollout(made, np.array([5]), lambda cast: stand)
    truth = recorded(made)
    [same], [stands] = (long_rollout_figures(name, [drive], bundle, truth) for name, drive in drives.items())
    assert same["js"] == pytest.approx(dict.fromkeys(("speed", "acceleration", "yaw_rate", "nearest"), 0.0), abs=0.1)
    assert same["standing"] == pytest.approx(same["recorded_standing"], abs=0.01) == pytest.approx(1 / 3, abs=0.01)
    assert stands["standing"] == 1.0
    assert stands["js"]["speed"] > 0.5


def test_what_cannot_be_evaluated_is_refused(bundle: ModelBundle) -> None:
    made = recording([straight(30, 1.2)], [2])
    with pytest.raises(
        InputError, match="--selectors best: no such selector; use constant-velocity, prior, step-oracle"
    ):
        evaluate(made, bundle, selectors=["prior", "best"])
    with pytest.raises(InputError, match="--selectors greedy: bundle random has no trained selector"):
        evaluate(made, bundle, selectors=["greedy"])
    with pytest.raises(InputError, match="--starts 0"):
        evaluate(made, bundle, starts_every=0)
    with pytest.raises(InputError, match="no road user of the recording can be simulated"):
        evaluate(recording([straight(2, 1.2)], [2]), bundle)


def test_models_that_read_the_past_predict_by_it() -> None:
    trained = make_bundle("history")
    random = np.random.default_rng(3)
    ways = [(int(n), v, w, y) for n, v, w, y in zip([40, 35, 50], random.uniform(1, 5, 3), (-0.2, 0.1, 0.2), (0, 4, 8),
                                                    strict=True)]  # fmt: skip
    made = recording([circle(*way) for way in ways], [0, 1, 2])
    starts = np.arange(0, 30, 7)
    whole = rollout(made, cast_of(made, starts), held_mode(trained, NOWHERE, 3)).error
    single = [rollout(made, cast_of(made, starts[i : i + 1]), held_mode(trained, NOWHERE, 3)) for i in range(5)]
    np.testing.assert_allclose(whole, np.concatenate([one.error for one in single]), rtol=1e-3, atol=2e-3)
    seen: list[Moment] = []

    def watch(moment: Moment) -> Motion:
        seen.append(moment)
        return constant_velocity(moment)

    rollout(made, cast_of(made, np.array([10])), watch)
    # At first the past is the recorded one; after 4 intervals it is that of the rollout, which goes straight.
    np.testing.assert_allclose(seen[0].past[0, :, 1], -0.2, atol=1e-9)
    np.testing.assert_allclose(seen[2].past[0, :, 1], [0.0, -0.2, -0.2, -0.2], atol=1e-9)
    np.testing.assert_allclose(seen[5].past[0, :, 1], 0.0, atol=1e-9)
    rows = evaluate(made, trained, starts_every=10)["rows"]
    assert {row["type"] for row in rows} == {"car", "bicycle", "pedestrian"}


def test_speeds_that_the_bundle_was_not_learned_from_are_noted(bundle: ModelBundle) -> None:
    made = recording([straight(30, 1.2), straight(30, 9.0, y=20)], [2, 1])
    known = {
        "types": {"bicycle": {"speed_percentiles_mps": [0.0, 7.0]}, "pedestrian": {"speed_percentiles_mps": [0, 2]}}
    }
    result = evaluate(made, replace(bundle, training=known), selectors=["constant-velocity"])
    [note] = result["notes"]
    assert note.startswith("bicycle: 100% of the recorded speeds lie outside 0.0 to 7.0 m/s")
    assert evaluate(made, bundle, selectors=["constant-velocity"])["notes"] == []


def test_denser_traffic_than_the_bundle_was_learned_from_is_noted(bundle: ModelBundle) -> None:
    # Three abreast, 2 m apart, and one 50 m away.
    made = recording([straight(30, 1.2, y=y) for y in (0, 2, 4, 50)], [2, 2, 2, 1])
    known = {"types": {name: {"within_20_m_percentiles": [0.0, 1.0]} for name in ("bicycle", "pedestrian")}}
    [note] = evaluate(made, replace(bundle, training=known), selectors=["constant-velocity"])["notes"]
    assert note.startswith("pedestrian: 100% of the recorded numbers of others within 20 m lie outside 0 to 1, from")
