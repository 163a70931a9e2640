"""A bundle with its trained selector: record of the training as JSON and as a section of the model card."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.version import __version__

HEADING = "\n## Selector\n"
OBSERVES = {
    "paper": "It observes 32 m ahead and neither destination, traffic light nor right of way. Measured: "
    "docs/measurements/selectors.md.",
    "image": "It observes 32 m ahead, the last 2 s, the nearest road users and its route with the signals and the "
    "right of way on it, and does not look ahead. Measured: docs/measurements/training.md.",
    "extended": "It observes 40 m of its route with the signals and the right of way on it. Measured: "
    "docs/measurements/routes.md.",
}
WITHOUT_ROUTE = "\nWithout a route its heads and scorers count by shares learned from"
LAST = 20
"""Number of updates over which the closing figures are averaged."""


def with_selector(
    bundle: ModelBundle, policy: Policy, record: dict[str, Any], log: list[dict[str, float]]
) -> ModelBundle:
    """`bundle` with a trained `policy`; `record`: settings of the training, `log`: figures of each update.

    If the training started from the selector of `bundle`, the record of that selector is kept as `before`.
    """
    last = {name: _mean([row[name] for row in log[-LAST:]]) for name in (log[-1] if log else {})}
    wanted = ("episode/", "reward/", "motion/")
    figures = {name: value for name, value in last.items() if name.startswith(wanted)}
    # Of a folder its name: the path is that of the machine on which it was trained.
    training = {**record, "bundle": Path(record["bundle"]).name, "slrl_sumo": __version__, "last_updates": figures}
    if record.get("goes_on") and bundle.policy_training:
        training.setdefault("before", bundle.policy_training)
    card = bundle.card.split(HEADING)[0].rstrip("\n") + "\n" + HEADING + _section(training, figures)
    card += shares_without_route(training)
    return replace(bundle, policy=policy.requires_grad_(False).eval(), policy_training=training, card=card)


def shares_without_route(training: dict[str, Any]) -> str:
    """The sentence of the card on the shares of the selector without a route; '' without such shares."""
    if "without_route" not in training:
        return ""
    text = f"{WITHOUT_ROUTE} {training['without_route_from']}: {_by_type(training['without_route'])}."
    if "expected_route" in training:
        text += f" On routes that are expected along the lanes: {_by_type(training['expected_route'])}."
    return f"{text}\n"


def _by_type(shares: list[list[float]]) -> str:
    """Shares of heads and scorers, (3, 2), in words."""
    each = zip(TYPE_NAMES, shares, strict=True)
    return ", ".join(f"{name} {heads:.2f} and {scorers:.2f}" for name, (heads, scorers) in each)


def _command(training: dict[str, Any]) -> str:
    """The command of a training, in Markdown."""
    source = "--from" if training.get("goes_on") else "--bundle"
    return (
        f"`slrl-sumo train {training['scenarios']} {source} {training['bundle']} --steps {training['steps']} "
        f"--workers {training['workers']} --seed {training['seed']}`"
    )


def _section(record: dict[str, Any], figures: dict[str, float]) -> str:
    settings = record["settings"]
    commands = [_command(record)]
    while "before" in record:
        record = record["before"]
        commands.insert(0, _command(record))
    weights = ", ".join(f"{name} {value:g}" for name, value in settings["reward"].items() if value)
    lines = [
        "",
        "Chooses the modes from the observation (`--selector greedy` or `sampled`). Trained by PPO: "
        f"{', then '.join(commands)},",
        f"{settings['arena']['agents']} learned road users in each simulation, with background traffic; settings: "
        "selector.json.",
        "",
        f"Weights of the reward's terms (slrl_sumo.learning.rewards.terms): {weights}.",
        "",
        f"Means over the last {LAST} updates of training, with modes sampled from the policy:",
        "",
        "| type | mean speed (m/s) | standing | contacts or losses per 1,000 steps |",
        "|---|---|---|---|",
    ]
    for name in TYPE_NAMES:
        speed, standing = figures.get(f"motion/mean_speed_{name}_mps"), figures.get(f"motion/standing_{name}")
        ends = figures.get(f"episode/ends_per_1000_steps_{name}")
        if speed is not None and standing is not None and ends is not None:
            lines.append(f"| {name} | {speed:.2f} | {standing:.1%} | {ends:.2f} |")
    lines += ["", OBSERVES[settings["policy"]["preset"]], ""]
    return "\n".join(lines)


def _mean(values: list[float]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else 0.0
