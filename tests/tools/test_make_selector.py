"""The recipe of the selectors compares their predictions with the prior's."""

from pathlib import Path
from typing import Any

import pytest
from builders import make_bundle, make_recording

from slrl_sumo.learning.rl.train import TrainRequest
from slrl_sumo.learning.rl.training_settings import TrainSettings
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


def test_the_selector_of_a_bundle_is_trained_further_without_a_teacher(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[TrainRequest, TrainSettings]] = []

    def trained(request: TrainRequest, settings: TrainSettings, *, resume: bool) -> int:
        asked.append((request, settings))
        return 3

    monkeypatch.setattr(make_selector, "train_with_progress", trained)
    for words in ([], ["--go-on"]):
        arguments = [
            "make_selector.py",
            "intersection",
            *words,
            "--out",
            str(tmp_path / "made"),
            "--work",
            str(tmp_path),
        ]
        monkeypatch.setattr("sys.argv", arguments)
        with pytest.raises(SystemExit, match="3"):
            make_selector.main()
    (first, usual), (further, refined) = asked
    assert (first.goes_on, usual.ppo.only) == (False, ())
    assert usual.ppo.teacher_first > 0
    assert (further.goes_on, refined.ppo.only) == (True, ("pedestrian",))
    assert (refined.ppo.kl_coef, refined.ppo.teacher_first) == (0.0, 0)
    assert refined.arena == usual.arena
    assert further.bundle == first.bundle == "intersection"
