"""The recipe of the selectors refuses one that predicts worse than the prior."""

from typing import Any

import pytest
from builders import make_bundle, make_recording

from tools import make_selector


def test_types_that_the_selector_predicts_worse_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    made = [make_recording(([0.0], 0.0, 0.0), source=name) for name in ("one", "two")]
    errors = {
        # Mean errors and numbers of the prior and of the selector: cars are worse in one and better in two.
        "one": {"car": (1.0, 1.2, 10), "pedestrian": (0.5, 0.6, 10)},
        "two": {"car": (1.0, 0.9, 30), "pedestrian": (0.5, 0.5, 30)},
    }

    def evaluated(recording: Any, bundle: Any, selectors: list[str]) -> dict[str, Any]:
        return {
            "rows": [
                {"type": kind, "selector": name, "step": step, "ade_m": error * step / make_selector.STEPS, "n": n}
                for kind, (*both, n) in errors[recording.source].items()
                for name, error in zip(selectors, both, strict=True)
                for step in range(1, make_selector.STEPS + 1)
            ]
        }

    monkeypatch.setattr(make_selector, "evaluate", evaluated)
    assert make_selector.worse_than_prior(make_bundle(), made) == ["pedestrian"]
