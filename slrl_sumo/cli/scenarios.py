"""The command scenarios: what ships with the package, and pictures of networks."""

import re
from pathlib import Path
from typing import Annotated

import typer

from slrl_sumo.cli.app import Verbose, app, claim, scenario_names
from slrl_sumo.errors import InputError
from slrl_sumo.extras import require
from slrl_sumo.formats.output_files import Output

DEMAND = re.compile(r"^- .*\.rou\.xml`: (per hour .*?)(?:, of types .*)?\.?$", re.MULTILINE)
"""The line of a shipped README.md on the road users."""
CONTROL = re.compile(r"control='(\w+)'")
DURATION = re.compile(r"^- .*\.sumocfg`: (\d+ s)", re.MULTILINE)


@app.command()
def scenarios(
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="[SCENARIO]",
            help="Only this one; with --draw also a folder or .sumocfg.",
            autocompletion=scenario_names,
        ),
    ] = None,
    draw: Annotated[Path | None, typer.Option(help="Picture of its network to write: .png, .svg or .pdf.")] = None,
    verbose: Verbose = False,
) -> None:
    """List the scenarios that ship with the package, with their content; draw the network of one."""
    from slrl_sumo.sumo.scenario import find_scenario, shipped_scenarios

    names = shipped_scenarios()
    if scenario is None:
        if draw is not None:
            raise InputError(f"--draw {draw}: name the scenario to draw, e.g. slrl-sumo scenarios {names[0]}")
        for name in names:
            typer.echo(f"{name:{max(map(len, names))}}  {_described(find_scenario(name).config.parent)}")
        return
    found = find_scenario(scenario)
    if draw is not None:
        if draw.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise InputError(f"--draw {draw}: give a name that ends in .png, .svg or .pdf")
        require("matplotlib", f"--draw {draw}")
        claim(Output("draw", draw), scenarios=[scenario])
    if scenario in names:
        typer.echo(f"{scenario}  {_described(found.config.parent)}")
    if draw is not None:
        from slrl_sumo.report.scenario_map import write_scenario_map

        write_scenario_map(found, draw)
        typer.echo(draw)


def _described(folder: Path) -> str:
    """The content of a shipped scenario in one line, from the README.md that netgen writes beside it."""
    text = (folder / "README.md").read_text(encoding="utf-8")
    about = text.split("\n\n")[1].replace("\n", " ")
    control, demand, duration = CONTROL.search(text), DEMAND.search(text), DURATION.search(text)
    if demand is None or duration is None:
        return about
    controlled = "" if control is None else f" Control: {control[1]}."
    return f"{about}{controlled} {demand[1][0].upper()}{demand[1][1:]}; {duration[1]}."
