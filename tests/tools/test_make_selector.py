"""The recipe of the selectors compares their predictions with the prior's."""

from typing import Any

import pytest
from builders import make_bundle, make_recording

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
