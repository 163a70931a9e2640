"""The model card: what a bundle is, for the people who use it."""

from typing import Any

from slrl_sumo.scene.types import TYPE_NAMES

FEW = 2000
"""Training windows below which the card warns."""

MODES_BY_TEXT = {
    "relative": "K-Means of the position after 4.8 s relative to the own speed (three quarters of the way that "
    "constant velocity leads are taken out)",
    "kmeans": "K-Means of the position after 4.8 s",
    "balanced": "K-Means of the position after 4.8 s, balanced between turning and going straight",
    "curved": "K-Means of the distance after 4.8 s and the curvature of the first 2 s (pedestrians: of the position "
    "after 4.8 s), balanced between turning and going straight; models are trained over those 2 s",
}
"""How modes are found, by the names that `slrl-sumo fit --modes` knows."""


def model_card(name: str, training: dict[str, Any]) -> str:
    """Markdown text of the model card of bundle `name`, from its training record (see learning.supervised.fit)."""
    kinds = training["types"]
    tracks: dict[tuple[str, str], list[int]] = {}
    for recording in training["recordings"]:
        key = (recording["source"] or "not stated", recording["licence"] or "not stated")
        tracks.setdefault(key, []).append(recording["tracks"])
    recordings = [
        f"| {source} | {licence} | {len(counts)} | {sum(counts)} |" for (source, licence), counts in tracks.items()
    ]
    sizes = [
        f"| {kind} | {kinds[kind]['tracks']} | {kinds[kind]['windows']} "
        f"| {kinds[kind]['held_out_windows']} | {kinds[kind]['smallest_mode']} |"
        for kind in TYPE_NAMES
    ]
    errors = [
        f"| {kind} | {kinds[kind]['displacement_error_m']:.3f} | {kinds[kind]['constant_velocity_error_m']:.3f} "
        f"| {kinds[kind]['destination_error_m']:.2f} "
        f"| {kinds[kind]['prior_cross_entropy_nats']:.2f} | {kinds[kind]['frequency_cross_entropy_nats']:.2f} "
        f"| {kinds[kind]['prior_accuracy']:.2f} | {kinds[kind]['most_frequent_accuracy']:.2f} |"
        for kind in TYPE_NAMES
    ]
    bounds = []
    for kind in TYPE_NAMES:
        brake, gas = kinds[kind]["acceleration_bounds_mps2"]
        right, left = kinds[kind]["yaw_rate_bounds_radps"]
        curvature = f"{kinds[kind]['max_curvature_per_m']:.3f}"
        bounds.append(
            f"| {kind} | {brake:.2f} to {gas:.2f} | {right:.2f} to {left:.2f} | {curvature} "
            f"| {kinds[kind]['max_speed_mps']:.1f} |"
        )
    few = [
        f"{kind} ({count})"
        for kind in TYPE_NAMES
        if (count := kinds[kind]["windows"] - kinds[kind]["held_out_windows"]) < FEW
    ]
    scarce = (
        f"**Few windows to learn from**, fewer than {FEW}: {', '.join(few)}. Windows of successive moments overlap, so "
        "these are a handful of road users: what the bundle makes of the type is hardly more than a guess.\n\n"
        if few
        else ""
    )
    every = "" if training["stride"] == 1 else f" (of one in {training['stride']} frames)"
    if training["tests"]:
        held_out = f"Measured on recordings that nothing was learned from: {', '.join(training['tests'])}."
    else:
        held_out = f"{training['held_out_share']:.0%} of the tracks of each type were kept out of training."
    return "\n".join(
        [
            f"# Model bundle `{name}`",
            "",
            "Learned cars, bicycles and pedestrians for slrl_sumo, after the SLRL method: per type, "
            f"{training['modes']} modes with a displacement model each, and a prior that chooses among them.",
            "",
            "## Data",
            "",
            "| source | licence | recordings | tracks |",
            "|---|---|---|---|",
            *recordings,
            "",
            *([training["notice"].strip(), ""] if training["notice"] else []),
            f"One window per recorded moment{every}, with 0.8 s before, 4.8 s after.",
            "",
            "| type | tracks | windows | of them held out | windows in the smallest mode |",
            "|---|---|---|---|---|",
            *sizes,
            "",
            "## Errors on held-out tracks",
            "",
            f"{held_out} One step error: "
            "mean distance to the recorded position after 0.4 s, with the mode that the recorded destination has; "
            "beside it the error of constant velocity. Destination: the same after 4.8 s in that mode. "
            "Cross-entropy and accuracy: of the prior's mode, beside those of the modes' frequencies and "
            "of always taking the most frequent one.",
            "",
            "| type | one step (m) | constant velocity (m) | destination (m) | cross-entropy (nats) "
            "| of frequencies | accuracy | of the most frequent |",
            "|---|---|---|---|---|---|---|---|",
            *errors,
            "",
            "Errors over 6.4 s in closed loop, against constant velocity: `slrl-sumo evaluate FILE --bundle BUNDLE`; "
            "those of the bundles that ship are in docs/prediction.md.",
            "",
            "## Limits",
            "",
            "What the models can do is bounded by what was recorded (1st to 99th percentile of road users in motion, "
            "for yaw rates of those that turn, 99th of all for the top speed). Everybody turns at most by the given "
            "curvature per metre.",
            "",
            "| type | acceleration (m/s²) | yaw rate (rad/s) | curvature (1/m) | top speed (m/s) |",
            "|---|---|---|---|---|",
            *bounds,
            "",
            f"{scarce}The models see speed, acceleration, type, heading and counts of neighbours: neither lanes, "
            "traffic lights nor where anybody wants to go. Do not use them for safety assessment, and expect behaviour "
            "outside the recorded range of density and speed to be a guess.",
            "",
            "## How it was made",
            "",
            f"`slrl-sumo fit`, seed {training['seed']}, {training['epochs']} epochs of Adam; modes: "
            f"{MODES_BY_TEXT[training['modes_by']]}; displacement models trained on the path of "
            "the bounded motion over these 4.8 s; "
            "headings turned at random in training; taught by mirrored windows too: "
            f"{', '.join(training['mirrored']) or 'no type'}. "
            f"slrl_sumo {training['versions']['slrl_sumo']}, torch {training['versions']['torch']}, "
            f"scikit-learn {training['versions']['scikit_learn']}.",
            "",
        ]
    )
