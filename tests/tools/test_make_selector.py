"""The recipe of the selectors trains them in parts, and compares their predictions with the prior's."""

import argparse
import shutil
from pathlib import Path
from typing import Any

import pytest
from builders import make_bundle, make_recording

from slrl_sumo.learning.rl.train import TrainRequest
from slrl_sumo.learning.rl.training_settings import TrainSettings
from slrl_sumo.models.bundle_folder import find_bundle
from slrl_sumo.routing.expected_routes import ExpectedRoutes
from tools import make_selector


def test_errors_of_all_recordings_count_by_their_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    routes = ExpectedRoutes((), {})
    made = [make_selector.Traffic(make_recording(([0.0], 0.0, 0.0), source=name), routes) for name in ("one", "two")]
    given = []
    errors = {
        # Mean errors and numbers of the prior and of the selector: cars are worse in one and better in two.
        "one": {"car": (1.0, 1.2, 10), "pedestrian": (0.5, 0.6, 10)},
        "two": {"car": (1.0, 0.9, 30), "pedestrian": (0.5, 0.5, 30)},
    }

    def evaluated(recording: Any, bundle: Any, selectors: list[str], routes: ExpectedRoutes | None) -> dict[str, Any]:
        given.append(routes)
        return {
            "rows": [
                {"type": kind, "selector": name, "step": step, "ade_m": error * step / make_selector.STEPS, "n": n}
                for kind, (*both, n) in errors[recording.source].items()
                for name, error in zip(selectors, both, strict=True)
                for step in range(1, make_selector.STEPS + 1)
            ]
        }

    monkeypatch.setattr(make_selector, "evaluate", evaluated)
    for on_routes in (False, True):
        found = make_selector.relative_errors(make_bundle(), made, on_routes)
        assert found == pytest.approx({"car": 39.0 / 40.0, "pedestrian": 21.0 / 20.0})
    assert given == [None, None, routes, routes]


@pytest.mark.parametrize("further", [False, True])
def test_the_second_part_goes_on_from_the_first(further: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def trained(request: TrainRequest, settings: TrainSettings, *, resume: bool) -> int:
        asked.append((request, settings))
        shutil.copytree(find_bundle("intersection"), request.out)
        return 0

    monkeypatch.setattr(make_selector, "train_with_progress", trained)
    arguments = argparse.Namespace(
        name="intersection", further=further, work=tmp_path, steps=7000, seed=None, resume=False
    )
    last = make_selector.trained(arguments, ())
    *first, (request, settings) = asked
    assert last == str(request.out) == str(tmp_path / "intersection-further")
    assert request.goes_on
    assert settings.reward.contact == 250.0  # of the first part
    assert settings.ppo.learning_rate == 3e-4
    if further:
        assert (first, request.bundle, request.steps) == ([], "intersection", 7000)
    else:
        assert (first[0][0].goes_on, first[0][0].steps) == (False, 7000)
        assert (request.bundle, request.steps) == (
            str(first[0][0].out),
            make_selector.TRAININGS["intersection"][-1].steps,
        )
