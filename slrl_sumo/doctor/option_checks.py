"""Consequences of a scenario's options for a run with learned road users, without starting SUMO."""

from collections.abc import Iterator

from slrl_sumo.doctor.finding import Finding
from slrl_sumo.formats.sumo_time import parse_time
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.command import sumo_step_length
from slrl_sumo.sumo.scenario.options import input_files, option, switched_on

TELEPORT_AFTER = 300.0
"""s; SUMO's default of time-to-teleport."""


def missing_inputs(scenario: Scenario) -> Iterator[Finding]:
    """Obstacles to a start of SUMO: missing files, and modes in which nothing can be moved."""
    for name in ("net-file", "route-files", "additional-files"):
        for path in input_files(scenario, name):
            if not path.exists():
                yield Finding(
                    "problem", "files", f"{name}: {path} does not exist", "put it there, or correct the option"
                )
    if switched_on(scenario, "mesosim"):
        yield Finding(
            "problem",
            "mesosim",
            "a mesoscopic simulation has no positions to set; run refuses it",
            "remove the option mesosim",
        )


def option_findings(scenario: Scenario) -> Iterator[Finding]:
    """Consequences of the options of the configuration for a run."""
    yield from _time_findings(scenario)
    yield from _removal_findings(scenario)
    if (option(scenario, "remote-port") or "0") != "0":
        yield Finding(
            "note",
            "remote-port",
            f"remote-port {option(scenario, 'remote-port')}: by itself, SUMO waits for a TraCI client",
            "none needed: run talks to SUMO without a port; use slrl_sumo.attach in a script of your own",
        )
    options = scenario.options
    model = options.get("pedestrian.model", "striping")
    if model != "striping":
        yield Finding(
            "note",
            "pedestrian model",
            f"pedestrian.model {model}: persons cannot be moved reliably with it",
            "none needed: run uses striping, so background pedestrians walk differently than in the plain scenario",
        )
    if (parse_time(options.get("lateral-resolution")) or -1) > 0:
        yield Finding(
            "note",
            "sublane model",
            f"lateral-resolution {options['lateral-resolution']} m: background cars pass learned bicycles and "
            "pedestrians that keep to the side of the same lane",
            "none needed; to make cars wait behind them, remove lateral-resolution (it changes background traffic)",
        )
    else:
        yield Finding(
            "ok",
            "sublane model",
            "no lateral-resolution: background cars stay behind learned bicycles and pedestrians in their lane",
            "nothing to do; to let cars pass within a lane, set lateral-resolution 0.8 (it changes background traffic)",
        )
    if switched_on(scenario, "random"):
        yield Finding(
            "warning",
            "seed",
            "option random: background traffic differs from run to run, whatever --seed says",
            "remove the option random",
        )
    for name, users in (("max-num-vehicles", "cars and bicycles"), ("max-num-persons", "pedestrians")):
        if (parse_time(options.get(name)) or -1) >= 0:
            yield Finding(
                "warning",
                "insertion",
                f"{name} {options[name]}: learned {users} count too and keep background traffic out",
                f"raise {name} by the number of learned {users}, or remove it",
            )


def _time_findings(scenario: Scenario) -> Iterator[Finding]:
    own = scenario.seconds("step-length")
    used, changed = sumo_step_length(scenario, None)
    if changed:
        yield Finding(
            "note",
            "step length",
            f"step-length {1.0 if own is None else own:g} s{' (the default of SUMO)' if own is None else ''} does not "
            "divide the decision interval of 0.4 s",
            f"run uses {used:g} s, which by itself changes traffic (7 % more mean speed in one city): compare only "
            f"with plain SUMO at --step-length {used:g}",
        )
    end, begin = parse_time(option(scenario, "end")), parse_time(option(scenario, "begin")) or 0.0
    if end is None or end < 0:
        yield Finding(
            "note",
            "end",
            "the scenario has no end time",
            "run goes on until no road user is left; --until or --steps ends it before",
        )
    elif end <= begin:
        yield Finding(
            "problem", "end", f"the end ({end:g} s) is not after the begin ({begin:g} s)", "correct the option end"
        )


def _removal_findings(scenario: Scenario) -> Iterator[Finding]:
    """SUMO's rules that remove road users that stand, collide or leave their route."""
    options = scenario.options
    teleport = parse_time(options.get("time-to-teleport"))
    waits = TELEPORT_AFTER if teleport is None else teleport
    if waits > 0:
        yield Finding(
            "note",
            "teleport",
            f"SUMO teleports vehicles that stand for {waits:g} s{' (its default)' if teleport is None else ''}, and "
            "would remove learned road users too",
            "run switches it off, so a jam that plain SUMO dissolves stays: compare with --time-to-teleport -1",
        )
        if switched_on(scenario, "ignore-route-errors"):
            yield Finding(
                "warning",
                "route errors",
                "ignore-route-errors: a vehicle with a broken route stands there without end, as teleporting is off",
                "repair the routes (duarouter --repair) and remove ignore-route-errors",
            )
    action = options.get("collision.action", "teleport")
    if action not in ("warn", "none"):
        default = " (the default of SUMO)" if "collision.action" not in options else ""
        yield Finding(
            "note",
            "collision action",
            f"collision.action {action}{default}: SUMO would remove or stop colliding road users",
            "none needed: run uses warn, and counts collisions and overlaps itself",
        )
    action = options.get("intermodal-collision.action", "warn")
    if action not in ("warn", "none"):
        yield Finding(
            "warning",
            "collision action",
            f"intermodal-collision.action {action}: vehicles that touch pedestrians are removed or stopped",
            "set intermodal-collision.action to warn",
        )
