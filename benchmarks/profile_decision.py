"""Where the time of a decision goes, piece by piece, in a run:

    PYTHONPATH=CHECKOUT python benchmarks/profile_decision.py SCENARIO AGENTS STEPS [MIX]

Prints the mean over the middle half of the decisions, in ms; pieces that are indented are part of the one above. Like
benchmarks/time_decisions.py it needs nothing that older checkouts lack, so that two can be compared by turns.
"""

import functools
import sys
from collections import defaultdict
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from slrl_sumo.agent import decide, model_driver
from slrl_sumo.agent.rule_selector import RuleSelector
from slrl_sumo.background.yielding import Yielding
from slrl_sumo.perception import observation
from slrl_sumo.routing.routes import Routes
from slrl_sumo.simulation import cosimulation
from slrl_sumo.simulation.population import Population
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.sumo.reader import Reader
from slrl_sumo.sumo.session import SumoSession

WARM_UP = 10
PIECES: dict[str, tuple[Any, str]] = {
    "drive": (model_driver.ModelDriver, "drive"),
    "  routes": (Routes, "ahead"),
    "  smoothed paths": (decide, "smooth_paths"),
    "  route context": (decide, "route_context"),
    "  observation": (decide, "observe"),
    "    images": (observation, "ego_images"),
    "    route features": (observation, "route_features"),
    "  mode rollouts": (decide, "mode_rollouts"),
    "  selector": (RuleSelector, "choose"),
    "  motion": (model_driver, "advance"),
    "yielding": (Yielding, "apply"),
    "moves": (Population, "move"),
    "SUMO": (SumoSession, "step"),
    "reading": (Reader, "read"),
    "end of the interval": (cosimulation.CoSimulation, "_close"),
}


def main() -> None:
    """Run in this process, print a table."""
    scenario, agents, steps = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    spent: dict[str, float] = defaultdict(float)
    for piece, (owner, name) in PIECES.items():
        setattr(owner, name, timed(getattr(owner, name), piece, spent))
    mix = sys.argv[4] if len(sys.argv) > 4 else None
    events = run(RunSettings(scenario=scenario, agents=agents, steps=WARM_UP + steps, mix=mix))
    for _ in range(1 + WARM_UP):
        next(events)
    rows = []
    for _ in range(steps):
        spent.clear()
        begin = perf_counter()
        next(events)
        rows.append([perf_counter() - begin] + [spent[piece] for piece in PIECES])
    table = np.sort(1e3 * np.array(rows), axis=0)[steps // 4 : steps - steps // 4].mean(axis=0)
    for piece, ms in zip(("decision", *PIECES), table, strict=True):
        print(f"{piece:24s}{ms:8.3f}")


def timed(function: Callable[..., Any], piece: str, spent: dict[str, float]) -> Callable[..., Any]:
    """`function`, which adds its time to `spent`, s."""

    @functools.wraps(function)
    def wrapper(*words: Any, **named: Any) -> Any:
        begin = perf_counter()
        try:
            return function(*words, **named)
        finally:
            spent[piece] += perf_counter() - begin

    return wrapper


if __name__ == "__main__":
    main()
