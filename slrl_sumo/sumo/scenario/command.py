"""The command line that starts SUMO, and its changes to the user's scenario."""

from pathlib import Path

from slrl_sumo.errors import InputError
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.sumo.scenario.configuration import Scenario
from slrl_sumo.sumo.scenario.options import LOG_OPTIONS, is_output
from slrl_sumo.sumo.sublanes import OPTIONS, on_two_lanes


def sumo_step_length(scenario: Scenario, wanted: float | None) -> tuple[float, list[str]]:
    """The length of a SUMO step (s), and notices for the user.

    It must divide the decision interval of 0.4 s; a `wanted` length that does not raises InputError. If the scenario's
    length does not (SUMO's default is 1 s), the step is 0.4 s; this changes the traffic, hence the notice.
    """
    if wanted is not None:
        if not divides_interval(wanted):
            raise InputError(
                f"the decision interval of {DECISION_INTERVAL:g} s is no multiple of it; use 0.4, 0.2, 0.1 or 0.05",
                argument="step_length",
                value=wanted,
            )
        return wanted, []
    own = scenario.seconds("step-length")
    own = 1.0 if own is None else own
    if divides_interval(own):
        return own, []
    return DECISION_INTERVAL, [
        f"SUMO step {DECISION_INTERVAL:g} s instead of the scenario's {own:g} s, "
        "because decisions are taken every 0.4 s; this changes background traffic slightly"
    ]


def divides_interval(step: float) -> bool:
    """Whether a SUMO step (s) divides the decision interval."""
    if step < 0.001:
        return False
    ratio = DECISION_INTERVAL / step
    # SUMO counts time in whole milliseconds, so a step of 0.4 / 3 would drift.
    return ratio >= 0.999 and abs(ratio - round(ratio)) < 1e-6 and abs(step * 1000 - round(step * 1000)) < 1e-6


def start_command(
    scenario: Scenario, *, step_length: float, seed: int, outputs_to: Path | None, gui: bool = False
) -> list[str]:
    """Arguments for libsumo.start; options that a run needs override those of the scenario.

    `outputs_to`: folder for all outputs of the scenario's configuration and detectors; None keeps their paths. `gui`:
    open the window of sumo-gui, which starts the simulation immediately and closes at the end.
    """
    ours = {
        "step-length": f"{step_length:g}",
        "seed": str(seed),
        # SUMO's warnings would disturb the progress bar; errors are still printed.
        "no-step-log": "true",
        "no-warnings": "true",
        "verbose": "false",
        "duration-log.disable": "true",
        # SUMO removes vehicles that stand for long or overlap other vehicles; moved road users may do both.
        "time-to-teleport": "-1",
        # SUMO crashes when it checks a vehicle on two lanes that was just moved off these lanes.
        "collision.action": "none" if on_two_lanes(*(scenario.options.get(name, "") for name in OPTIONS)) else "warn",
        # `random` would override the seed; with a port SUMO would wait for a client.
        "random": "false",
        "remote-port": "0",
    }
    if "pedestrian.model" in scenario.options:
        ours["pedestrian.model"] = "striping"
    if outputs_to is not None:
        # SUMO prepends the prefix to the last component of a path only, so the prefix must climb to the root first.
        ours["output-prefix"] = "../" * 40 + str(outputs_to.resolve()).lstrip("/") + "/"
        ours |= {option: str(outputs_to / option) for option in LOG_OPTIONS if option in scenario.options}
    if gui:
        ours |= {"start": "true", "quit-on-end": "true"}
    # SUMO refuses an option that is given twice.
    options = {**scenario.added, **ours}
    return [
        "sumo-gui" if gui else "sumo",
        "-c",
        str(scenario.config),
        *(word for name in options for word in (f"--{name}", options[name])),
    ]


def notices(scenario: Scenario, outputs_kept: bool) -> list[str]:
    """The changes of `start_command` to the scenario, one line each, for the user."""
    options = scenario.options
    lines = []
    if options.get("mesosim", "false").lower() in ("true", "1", "yes", "on", "x", "t"):
        raise InputError(f"{scenario.config}: mesoscopic simulation has no positions to move; remove option mesosim")
    teleport = scenario.seconds("time-to-teleport")
    if teleport is not None and teleport > 0:
        lines.append(
            f"teleporting off (the scenario: after {teleport:g} s), because it would remove learned road users"
        )
    if options.get("collision.action", "warn") not in ("warn", "none"):
        lines.append(f"collision.action warn, not {options['collision.action']}, which would remove learned road users")
    if options.get("pedestrian.model", "striping") != "striping":
        lines.append(f"pedestrian.model striping, not {options['pedestrian.model']}, which forbids moves")
    for name, flag in (("seed", "--seed"), ("random", "--seed"), ("remote-port", "slrl_sumo.attach")):
        if name in scenario.added:
            lines.append(f"{name} of --sumo-options is left out; use {flag}")
    written = [name for name in options if is_output(name)]
    if written and not outputs_kept:
        lines.append(
            f"the scenario's own outputs are left out ({', '.join(sorted(written))}); --sumo-outputs writes them"
        )
    return lines
