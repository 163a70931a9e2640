"""Networks that come with the SUMO wheel as games, with signals that do not wait for a player."""

import re
from collections.abc import Callable
from pathlib import Path

from lxml import etree

from slrl_sumo.studies.flow.scenarios.scenario_files import write_config

GREEN = 30
"""s; phases that wait for a player (10,000 s) last so long instead."""
_WAITING = re.compile(r'duration="10000"')


def games() -> Path:
    """The folder of the games in the SUMO wheel."""
    import sumo

    return Path(sumo.SUMO_HOME) / "tools" / "game"


def game(name: str, seconds: float) -> Callable[[Path], Path]:
    """Builds the game `name` with its own network, routes and signals, without its outputs and pictures."""

    def build(folder: Path) -> Path:
        found = games()
        options = {one.tag: one.get("value", "") for one in etree.parse(found / f"{name}.sumocfg").iter()}
        signals: list[str] = []
        for file in options.get("additional-files", "").split(","):
            text = (found / file).read_text(encoding="utf-8")
            if "<tlLogic" in text:
                signals.append(f"signals{len(signals)}.add.xml")
                (folder / signals[-1]).write_text(_WAITING.sub(f'duration="{GREEN}"', text), encoding="utf-8")
        return write_config(
            folder,
            seconds,
            net=str(found / options["net-file"]),
            routes=",".join(str(found / file) for file in options["route-files"].split(",")),
            additional=",".join(signals),
        )

    return build
