"""What models can do, against rolling them out by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from builders import make_world

from slrl_sumo.models import capability
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.capability import MAX_DECISIONS, PROBED_NEIGHBOURS, SPEEDS, STOPPING, Capability, capability_of
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.scene.advance import advance, halting
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

CAR, BICYCLE, PEDESTRIAN = (int(kind) for kind in RoadUserType)


def users(*rows: tuple[int, float]) -> WorldState:
    """Types and speeds; all at the origin."""
    kind, speed = zip(*rows, strict=True)
    return make_world(speed=speed, type=kind, length=5.0, width=1.8)


def motions(bundle: ModelBundle, kind: int, speed: float, acceleration: float, others: int) -> tuple[Floats, Floats]:
    """Of all modes of one road user with some others within 20 m."""
    features = dict.fromkeys(FEATURES, 0.0)
    features |= {"speed": speed, "acceleration": acceleration, RoadUserType(kind).name.lower(): 1.0}
    features |= {"vru_20": others, "other_20": others}
    with torch.inference_mode():
        a, yaw = bundle.displacement.motion_all(
            torch.tensor([list(features.values())], dtype=torch.float32), torch.tensor([kind])
        )
    return a[0].double().numpy(), yaw[0].double().numpy()


@pytest.fixture(scope="module")
def usual(shipped_bundle: ModelBundle) -> Capability:
    # Where processors are shared, torch's threads wait for each other in many small products: 10 s instead of 0.5 s.
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    found = capability_of(shipped_bundle)
    torch.set_num_threads(before)
    return found


@pytest.mark.parametrize(("kind", "speed"), [(CAR, 8.0), (CAR, 1.0), (BICYCLE, 5.0), (PEDESTRIAN, 1.25)])
def test_ways_to_a_stand_are_those_of_the_models(
    shipped_bundle: ModelBundle, usual: Capability, kind: int, speed: float
) -> None:
    state = replace(users((kind, speed)), heading=np.array([1.0]))
    for _ in range(MAX_DECISIONS):
        hardest = [
            motions(shipped_bundle, kind, state.speed[0], state.acceleration[0], others)[0].min()
            for others in PROBED_NEIGHBOURS
        ]
        braking = halting(state.speed, np.array([np.median(hardest)]), DECISION_INTERVAL)
        state = advance(state, braking, np.zeros(1), np.array([50.0]), DECISION_INTERVAL)
    assert state.speed[0] == 0.0
    way = float(np.hypot(state.x[0], state.y[0]))
    # A touch more, so that faster is always farther.
    assert usual.stopping[kind, np.searchsorted(STOPPING, speed)] == pytest.approx(way + 1e-3 * speed, abs=1e-3)
    assert way < 0.5 * speed**2 / 1.0 + 2.0 * speed * DECISION_INTERVAL + 0.5


def test_the_sharpest_curves_are_those_of_modes_that_do_not_brake_hard(
    shipped_bundle: ModelBundle, usual: Capability
) -> None:
    assert (np.diff(usual.sharpest, axis=2) <= 0.0).all()
    assert (np.diff(usual.stopping, axis=1) > 0.0).all()
    for kind in (CAR, BICYCLE):
        best = np.zeros((2, len(SPEEDS)))
        for i, speed in enumerate(SPEEDS):
            sides = []
            for others in PROBED_NEIGHBOURS:
                acceleration, yaw_rate = motions(shipped_bundle, kind, speed, 0.0, others)
                after = np.maximum(speed + DECISION_INTERVAL * acceleration, 0.5)
                curves = [0.0, *(yaw_rate / after)[acceleration > -1.5]]
                sides.append([-min(curves), max(curves)])
            best[:, i] = np.median(sides, axis=0)
        # What is possible at some speed is so at any lower one.
        for i in (8, 20, 40, len(SPEEDS) - 1):
            assert usual.sharpest[kind, :, i] == pytest.approx(best[:, i:].max(axis=1), abs=1e-5)


def test_what_was_probed_is_read_again(bundle: ModelBundle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capability, "cache_folder", lambda: tmp_path)
    first = capability.capability_of(bundle)
    (file,) = tmp_path.iterdir()
    monkeypatch.setattr(capability, "probed", lambda _: pytest.fail("it was probed again"))
    again = capability.capability_of(bundle)
    assert np.array_equal(first.sharpest, again.sharpest)
    assert np.array_equal(first.stopping, again.stopping)
    monkeypatch.undo()
    monkeypatch.setattr(capability, "cache_folder", lambda: tmp_path)
    file.write_bytes(b"damaged")
    assert np.array_equal(capability.capability_of(bundle).stopping, first.stopping)
    assert list(tmp_path.iterdir()) == [file]
    other = replace(bundle, weights={k: v + (k == "displacement.max_curvature") for k, v in bundle.weights.items()})
    assert not np.array_equal(capability.capability_of(other).sharpest, first.sharpest)
    assert len(list(tmp_path.iterdir())) == 2
