"""Scenarios that come with the SUMO wheel: games whose signals wait for a player."""

from pathlib import Path
from typing import Any

from slrl_sumo.sumo.scenario import Scenario, find_scenario, shipped_scenarios

GREEN = 30.0
"""s after which a signal that waits for a player is switched."""
ENDLESS = 1000.0
"""s; a phase of this length waits for a player."""


def scenario_or_game(name: str) -> Scenario:
    """A shipped scenario, a file or folder, or a game of the SUMO wheel."""
    if name in shipped_scenarios() or Path(name).exists():
        return find_scenario(name)
    import sumo

    game = Path(sumo.SUMO_HOME) / "tools" / "game" / f"{name}.sumocfg"
    return find_scenario(str(game) if game.exists() else name)


class WaitingSignals:
    """Switches the signals that wait for a player, every GREEN s; call `update` before every SUMO step."""

    def __init__(self, api: Any, begin: float) -> None:
        self._signals = api.trafficlight
        # Shifted by half a period: not at the moment when a study hands all road users back.
        self._last = begin + 0.5 * GREEN

    def update(self, now: float) -> None:
        """Switch the signals if they are due."""
        if now - self._last < GREEN:
            return
        self._last = now
        for signal in self._signals.getIDList():
            if self._signals.getPhaseDuration(signal) >= ENDLESS:
                program = self._signals.getProgram(signal)
                logics = self._signals.getAllProgramLogics(signal)
                phases = next(len(logic.phases) for logic in logics if logic.programID == program)
                self._signals.setPhase(signal, (self._signals.getPhase(signal) + 1) % phases)
