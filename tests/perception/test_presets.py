"""Presets say what is observed, and which vector models and selector need together."""

import pytest

from slrl_sumo.perception.features import STATES
from slrl_sumo.perception.presets import PRESETS, vector_for


@pytest.mark.parametrize(
    ("models", "preset", "vector"),
    [
        ("paper", "paper", "paper"),
        ("paper", "extended", "paper"),
        ("paper", "image", "history"),
        ("history", "paper", "history"),
        ("history", "image", "history"),
    ],
)
def test_the_vector_has_what_both_read(models: str, preset: str, vector: str) -> None:
    assert vector_for(models, preset) == vector
    for state in (models, PRESETS[preset].state):
        assert STATES[vector][: len(STATES[state])] == STATES[state]
