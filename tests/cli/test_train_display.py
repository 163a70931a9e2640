"""The figures of a training in one line."""

import math

from slrl_sumo.cli.train_display import _text
from slrl_sumo.learning.rl.training_log import Figures

BEGIN: Figures = {
    "speed/agent_steps_per_s": 812.4,
    "episode/return": math.nan,
    "episode/completed": math.nan,
    "reward/total": -0.0004,
}


def test_what_has_not_happened_yet_is_a_dash_and_zero_has_no_sign() -> None:
    assert _text("training", BEGIN) == "812 steps/s  return –  reward 0.000  completed –"
    trips = BEGIN | {"trips/reached": math.nan, "trips/clean": math.nan}
    trips |= {"reward/contact": 0.0, "reward/off_surface": 0.0}
    assert _text("training", trips) == (
        "812 steps/s  return –  reward 0.000  – reached  – of them clean  contacts 0.00  "
        "off-surface penalty 0.0 per 1,000 steps"
    )


def test_figures_are_shown_with_their_signs() -> None:
    figures = BEGIN | {"episode/return": -3.256, "reward/total": 0.5, "trips/reached": 0.25, "trips/clean": 0.915}
    figures |= {"reward/contact": -0.002, "reward/off_surface": -0.0125}
    assert _text("training", figures) == (
        "812 steps/s  return -3.26  reward 0.500  25% reached  91.5% of them clean  contacts 2.00  "
        "off-surface penalty 12.5 per 1,000 steps"
    )
