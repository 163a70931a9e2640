"""The model card of a bundle: data, errors and limits, for its users."""

from typing import Any

from slrl_sumo.scene.types import TYPE_NAMES

FEW_WINDOWS = 2000
"""Number of training windows below which the card contains a warning."""

MODES_BY_TEXT = {
    "relative": "K-Means of the position after 4.8 s, less three quarters of the displacement at constant velocity",
    "kmeans": "K-Means of the position after 4.8 s",
    "balanced": "K-Means of the position after 4.8 s, balanced between turning and going straight",
    "curved": "K-Means of the distance after 4.8 s and the curvature of the first 2 s (pedestrians: of the position "
    "after 4.8 s), balanced between turning and going straight",
    "paths": "each the recorded paths of 6.4 s that its model predicts best of all modes, beginning with K-Means of "
    "the position after 4.8 s, less three quarters of the displacement at constant velocity",
    "accelerations": "K-Means of acceleration and lateral acceleration over the first 1.2 s, relative to what "
    "was recorded at that speed (pedestrians: of the position after 4.8 s), balanced",
}
"""Clustered quantity by the names of `slrl-sumo fit --modes`."""

OBSERVED = {
    "paper": "speed, acceleration, type, heading and numbers of neighbours",
    "history": "speed and yaw rate of the last 2 s, acceleration, type, the nearest road users and numbers of others",
}
"""Inputs of the models, by preset."""

LEARNED = {"paths": "6.4 s", "curved": "the first 2 s", "accelerations": "the first 1.2 s"}
"""Part of the windows that the models learn, if it is not the whole window."""
TOP_SPEED_PERCENTILE_NAME = {"paths": "99.9th"}
"""Percentile of the recorded speeds that is the top speed, if it is not the 99th (see bounds.TOP_SPEED_PERCENTILE)."""
NOT_OBSERVED = {"accelerations": " (others only the prior, not the displacement models)"}
"""Data that only some of the models observe."""


def model_card(name: str, training: dict[str, Any]) -> str:
    """Markdown text of the model card of bundle `name`, from its training record (see learning.supervised.fit)."""
    kinds = training["types"]
    names = [kind for kind in TYPE_NAMES if kind in kinds]
    subjects = " and ".join(f"{kind}s" for kind in names) if len(names) < 3 else "cars, bicycles and pedestrians"
    left_out = [
        f"**No models of type {kind}**: {reason}. Such road users stay SUMO's."
        for kind, reason in training.get("left_out", {}).items()
    ]
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
        for kind in names
    ]
    errors = [
        f"| {kind} | {kinds[kind]['displacement_error_m']:.3f} | {kinds[kind]['constant_velocity_error_m']:.3f} "
        f"| {kinds[kind]['destination_error_m']:.2f} "
        f"| {kinds[kind]['prior_cross_entropy_nats']:.2f} | {kinds[kind]['frequency_cross_entropy_nats']:.2f} "
        f"| {kinds[kind]['prior_accuracy']:.2f} | {kinds[kind]['most_frequent_accuracy']:.2f} |"
        for kind in names
    ]
    bounds = []
    for kind in names:
        brake, gas = kinds[kind]["acceleration_bounds_mps2"]
        right, left = kinds[kind]["yaw_rate_bounds_radps"]
        need = kinds[kind].get("hardest_braking_mps2")
        hardest = "not measured" if need is None else f"{need:.2f}"
        curvature = f"{kinds[kind]['max_curvature_per_m']:.3f}"
        bounds.append(
            f"| {kind} | {brake:.2f} to {gas:.2f} | {hardest} | {right:.2f} to {left:.2f} | {curvature} "
            f"| {kinds[kind]['max_speed_mps']:.1f} |"
        )
    ranges = []
    for kind in names:
        slow, fast = kinds[kind]["speed_percentiles_mps"]
        least, most = kinds[kind].get("within_20_m_percentiles", (None, None))
        company = "not measured" if most is None else f"{least:.0f} to {most:.0f}"
        ranges.append(f"| {kind} | {slow:.1f} to {fast:.1f} | {company} |")
    few = [
        f"{kind} ({count})"
        for kind in names
        if (count := kinds[kind]["windows"] - kinds[kind]["held_out_windows"]) < FEW_WINDOWS
    ]
    scarce = (
        f"**Little training data**, fewer than {FEW_WINDOWS} windows: {', '.join(few)}. Windows of successive moments "
        "overlap, so these are a handful of road users, and the models of these types are unreliable.\n\n"
        if few
        else ""
    )
    every = "" if training["stride"] == 1 else f" (of one in {training['stride']} frames)"
    if training["tests"]:
        held_out = f"Measured on recordings that were not used in training: {', '.join(training['tests'])}."
    else:
        held_out = f"{training['held_out_share']:.0%} of the tracks of each type were not used in training."
    return "\n".join(
        [
            f"# Model bundle `{name}`",
            "",
            f"Learned {subjects} for slrl_sumo, after the SLRL method: per type, "
            f"{training['modes']} modes with one displacement model each, and a prior that chooses among them.",
            "",
            "## Data",
            "",
            "| source | licence | recordings | tracks |",
            "|---|---|---|---|",
            *recordings,
            "",
            *([training["notice"].strip(), ""] if training["notice"] else []),
            f"One window per recorded moment{every}, with 0.8 s before it and 4.8 s after it.",
            "",
            "| type | tracks | windows | held-out windows | windows in the smallest mode |",
            "|---|---|---|---|---|",
            *sizes,
            "",
            *(line for text in left_out for line in (text, "")),
            "## Errors on held-out tracks",
            "",
            f"{held_out} One step: mean distance to the recorded position after 0.4 s, in the mode of the recorded "
            "path, and the same for constant velocity. Destination: mean distance after 4.8 s in that mode. "
            "Cross-entropy and accuracy of the prior, and for comparison those of the modes' frequencies and of the "
            "most frequent mode.",
            "",
            "| type | one step (m) | constant velocity (m) | destination (m) | cross-entropy (nats) "
            "| cross-entropy of frequencies | accuracy | accuracy of the most frequent mode |",
            "|---|---|---|---|---|---|---|---|",
            *errors,
            "",
            "`slrl-sumo evaluate FILE --bundle BUNDLE` measures errors over 6.4 s in closed loop against constant "
            "velocity; docs/measurements/prediction.md lists those of the shipped bundles.",
            "",
            "## Limits",
            "",
            "The output of the models is bounded by the recorded range: accelerations by the 1st and 99th percentile "
            "of moving road users, yaw rates by those of turning road users, the top speed by the "
            f"{TOP_SPEED_PERCENTILE_NAME.get(training['modes_by'], '99th')} percentile of all. The curvature of a path "
            "is bounded as well. With the constraint `braking_residual` the mode that brakes hardest does so with the "
            "0.2nd percentile, where that was measured.",
            "",
            "| type | acceleration (m/s²) | hardest braking | yaw rate (rad/s) | curvature (1/m) | top speed (m/s) |",
            "|---|---|---|---|---|---|",
            *bounds,
            "",
            "Speeds and numbers of other road users within 20 m that they were learned from, 1st to 99th percentile; "
            "`slrl-sumo evaluate FILE` notes where those of a recording lie outside:",
            "",
            "| type | speed (m/s) | others within 20 m |",
            "|---|---|---|",
            *ranges,
            "",
            f"{scarce}The models observe {OBSERVED[training.get('preset', 'paper')]}"
            f"{NOT_OBSERVED.get(training['modes_by'], '')}, but neither lanes, traffic lights nor destinations. Do "
            "not use them for safety assessment. Outside the recorded range of density and speed their behaviour is an "
            "extrapolation.",
            "",
            "## Training",
            "",
            f"`slrl-sumo fit`, seed {training['seed']}, {training['epochs']} epochs of Adam. Modes: "
            f"{MODES_BY_TEXT[training['modes_by']]}. Displacement models: trained on the path of the bounded motion "
            f"over {LEARNED.get(training['modes_by'], '4.8 s')}, with random headings. "
            f"Mirrored windows added: {', '.join(training['mirrored']) or 'none'}. "
            f"slrl_sumo {training['versions']['slrl_sumo']}, torch {training['versions']['torch']}, "
            f"scikit-learn {training['versions']['scikit_learn']}.",
            "",
        ]
    )
