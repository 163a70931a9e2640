"""Realism of rollouts: what was recorded scores best, and cheats score badly."""

from collections.abc import Sequence

import numpy as np
import pytest
from builders import make_bundle, make_recording

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.road_map import Area, RoadMap, Surface, SurfaceShapes
from slrl_sumo.metrics.realism_features import FEATURES
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.studies.prediction.evaluate import evaluate
from slrl_sumo.studies.prediction.predictors import constant_velocity
from slrl_sumo.studies.prediction.rollout import STEPS, Cast, Moment, Motion, Move, cast_of, rollout
from slrl_sumo.studies.prediction.rollout_realism import realism_rows, recorded, rollout_scores

STARTS = np.arange(2, 40, 4)


def shared_space(frames: int = 60) -> Trajectories:
    """Pedestrians in a square of 20 m: pairs side by side, some of which stop for a while, and some that stand."""
    random = np.random.default_rng(4)
    ways = []
    for group in range(8):
        speed = np.full(frames, random.uniform(0.9, 1.6))
        if group % 3 == 0:
            speed[20 + group : 34 + group] = 0.0
        if group == 7:
            speed[:] = 0.0
        heading = random.uniform(-np.pi, np.pi) + np.cumsum(random.normal(0.0, 0.03, frames) * (speed > 0.0))
        x = random.uniform(0, 20) + np.cumsum(0.4 * speed * np.cos(heading))
        y = random.uniform(0, 20) + np.cumsum(0.4 * speed * np.sin(heading))
        ways += [(x, y, heading), (x - 0.8 * np.sin(heading[0]), y + 0.8 * np.cos(heading[0]), heading)]
    return make_recording(*ways, type=2)


def stand(moment: Moment) -> Motion:
    n = len(moment.rows)
    return np.full(n, -20.0), np.zeros(n), np.full(n, 2.0)


def flee(moment: Moment) -> Motion:
    """Away from the middle of all others of the scene, at 2 m/s."""
    world, rows = moment.world, moment.rows
    turn = np.zeros(len(rows))
    for i, row in enumerate(rows):
        others = (moment.scene == moment.scene[row]) & (np.arange(len(world)) != row)
        if not others.any():
            continue
        dx, dy = world.x[row] - world.x[others].mean(), world.y[row] - world.y[others].mean()
        turn[i] = np.angle(np.exp(1j * (np.arctan2(dy, dx) - world.heading[row]))) / 0.4
    return np.full(len(rows), 1.0), np.clip(turn, -1.5, 1.5), np.full(len(rows), 2.0)


def as_recorded(made: Trajectories, cast: Cast) -> Floats:
    rows = np.minimum(cast.row[:, None] + np.arange(STEPS + 1), len(made) - 1)
    return np.stack([made.x[rows], made.y[rows], made.heading[rows]], -1)


def score(made: Trajectories, cast: Cast, paths: Sequence[Floats], roadmap: RoadMap | None = None) -> dict[str, float]:
    kind = made.type[cast.track]
    [row] = realism_rows("one", kind, rollout_scores(recorded(made, roadmap), cast, np.stack(paths)))
    return {"score": row["score"], **row["groups"], **row["features"]}


def test_what_was_recorded_scores_best_and_cheats_badly() -> None:
    made = shared_space()
    cast = cast_of(made, STARTS)
    random = np.random.default_rng(1)
    true = as_recorded(made, cast)

    def noisy() -> Floats:
        """Speeds and directions that are off by a tenth, as of a good predictor."""
        steps = np.diff(true[..., 0] + 1j * true[..., 1], axis=1)
        off = np.exp(random.normal(0.0, 0.1, (len(steps), 1)) + 1j * random.normal(0.0, 0.1, (len(steps), 1)))
        place = (true[:, :1, 0] + 1j * true[:, :1, 1]) + np.concatenate(
            [np.zeros((len(steps), 1)), (steps * off).cumsum(1)], 1
        )
        return np.stack([place.real, place.imag, true[..., 2]], -1)

    moves: dict[str, Move] = {"stand": stand, "flee": flee, "straight": constant_velocity}
    found = {name: score(made, cast, [rollout(made, cast, move).path]) for name, move in moves.items()}
    found["copy"] = score(made, cast, [true] * 3)
    found["sampled"] = score(made, cast, [noisy() for _ in range(20)])
    assert found["copy"] == pytest.approx(dict.fromkeys(found["copy"], 1.0))
    ranked = sorted(found, key=lambda name: found[name]["score"])
    assert set(ranked[:2]) == {"stand", "flee"}
    assert ranked[2:] == ["straight", "sampled", "copy"]
    # Less than half of what a good predictor reaches.
    assert max(found[name]["score"] for name in ranked[:2]) < 0.5 * found["sampled"]["score"]
    assert found["stand"]["standing"] < 0.5
    assert found["flee"]["speed"] < 0.2


def test_the_scores_of_a_road_user_are_its_own() -> None:
    made = shared_space()
    cast = cast_of(made, STARTS)
    true, gone = as_recorded(made, cast), rollout(made, cast, stand).path
    one = int(np.flatnonzero((cast.track == 2) & (cast.scene == 1))[0])
    scores = rollout_scores(
        recorded(made), cast, np.where((np.arange(len(cast)) == one)[:, None, None], gone, true)[None]
    )
    kinematic = [i for i, name in enumerate(FEATURES) if FEATURES[name].group == "kinematic"]
    assert scores[one, list(FEATURES).index("speed")] < 0.1
    assert np.delete(scores, one, 0)[:, kinematic] == pytest.approx(1.0)
    assert np.isnan(scores[:, list(FEATURES).index("road_edge")]).all()


def test_leaving_the_road_counts_where_the_ground_is_known() -> None:
    made = make_recording((0.4 * 4.0 * np.arange(30), 0.0, 0.0), type=1)
    road = RoadMap(SurfaceShapes((Area(Surface.ROAD, np.array([[-9.0, -3], [60, -3], [60, 3], [-9, 3]])),)))
    cast = cast_of(made, np.array([3]))

    def aside(moment: Moment) -> Motion:
        return np.zeros(1), np.full(1, 0.2), np.full(1, 9.0)

    on, off = (score(made, cast, [rollout(made, cast, move).path], road) for move in (constant_velocity, aside))
    assert on["map"] == pytest.approx(1.0)
    assert off["off_surface"] < 0.2
    assert off["map"] < on["map"]


def test_evaluate_scores_each_selector_and_type_the_same_in_any_batch() -> None:
    made, bundle = shared_space(), make_bundle()
    chosen = {"selectors": ["constant-velocity", "prior"], "starts_every": 9}
    one, many = (evaluate(made, bundle, batch=batch, **chosen)["realism"] for batch in (1, 64))  # type: ignore[arg-type]
    assert [(row["selector"], row["type"]) for row in one] == [
        ("constant-velocity", "pedestrian"),
        ("prior", "pedestrian"),
    ]
    for a, b in zip(one, many, strict=True):
        assert a["n"] == b["n"] > 0
        assert set(a["features"]) == set(FEATURES) - {"road_edge", "off_surface"}
        assert a["score"] == pytest.approx(b["score"], rel=1e-2)
        assert 0.0 < a["score"] < 1.0
