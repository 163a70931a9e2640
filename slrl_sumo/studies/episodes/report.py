"""Outputs of an evaluation in a scenario: results.json, results.csv and printed tables."""

import csv
from pathlib import Path
from typing import Any

from rich.table import Table

from slrl_sumo.formats.output_files import write_json, writing
from slrl_sumo.jobs.tables import print_table
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.studies.episodes.published import MEASURED_ELSEWHERE, TABLES
from slrl_sumo.studies.episodes.tables import COLUMNS


def write_episodes(result: dict[str, Any], folder: Path) -> None:
    """Write what `slrl_sumo.studies.episodes.evaluate.evaluate_scenario` found into `folder`, which is there."""
    with writing(folder):
        write_json(folder / "results.json", result)
        with open(folder / "results.csv", "w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(result["rows"])


def print_episodes(result: dict[str, Any]) -> None:
    """Print a table of all types on stdout, our rows first, then those of the paper's table for this scenario."""
    table = Table(
        title=f"{result['scenario']}: {result['episodes']} episodes x {result['steps']} decisions of 0.4 s, "
        f"{result['seeds']} seed(s), bundle {result['bundle']}",
        title_justify="left",
    )
    for heading in ("type", "selector", "agents"):
        table.add_column(heading, no_wrap=True)
    for heading in ("success", "speed (m/s)", "moving (m/s)", "standing"):
        table.add_column(heading, justify="right")
    for heading in ("collisions /1000", "near misses /1000", "off surface"):
        table.add_column(heading, justify="right")
    for heading in ("paper: success", "survival (steps)", "collisions /1000"):
        table.add_column(heading, justify="right", style="dim")
    number, name = TABLES["shared-space" if "shared" in result["scenario"] else "intersection"]
    for kind in TYPE_NAMES:
        for row in (row for row in result["rows"] if row["type"] == kind):
            table.add_row(
                kind,
                row["selector"],
                str(row["agents"] or "–"),
                _spread(row, "success_rate", ".0%"),
                _spread(row, "mean_speed_mps", ".2f"),
                _cell(row["mean_speed_moving_mps"], ".2f"),
                _cell(row["standing_share"], ".1%"),
                _cell(row["collisions_per_1000_steps"], ".2f"),
                _cell(row["near_misses_per_1000_steps"], ".2f"),
                _cell(row["off_surface_share"], ".1%"),
                _spread(row, "paper_success_rate", ".0%"),
                _spread(row, "paper_survival_steps", ".0f"),
                _cell(row["paper_collisions_per_1000_steps"], ".2f"),
            )
        for row in (row for row in result["published"] if row["type"] == kind and row["table"] == number):
            cells = [
                f"{row['method']} ({name})*",
                *("", ""),
                f"{_cell(row['mean_speed_printed_mps'], '.2f')}*",
                *[""] * 5,
                _spread(row, "paper_success_rate", ".0%"),
                _spread(row, "paper_survival_steps", ".0f"),
            ]
            table.add_row(kind, *cells, "", style="dim")
        table.add_section()
    print_table(table, 160)
    print(f"* {MEASURED_ELSEWHERE}")
    for left_out in result["left_out"]:
        print(
            f"left out: selector {left_out['selector']}, {left_out['agents']} agents, seed {left_out['seed']}, "
            f"episode {left_out['number']}: {left_out['reason']}; to repeat it: {left_out['command']}"
        )


def _cell(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _spread(row: dict[str, Any], name: str, form: str) -> str:
    text = _cell(row[name], form)
    if row.get(f"{name}_std") is not None:
        text += f" ± {format(row[f'{name}_std'], form)}"
    return text
