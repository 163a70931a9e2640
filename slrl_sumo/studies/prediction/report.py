"""Outputs of an evaluation on a recording: results.json, results.csv, errors.png and a table."""

import csv
import sys
from pathlib import Path
from typing import Any

from rich.table import Table

from slrl_sumo.formats.output_files import write_json, writing
from slrl_sumo.jobs.tables import print_table
from slrl_sumo.studies.prediction.plots import draw_errors

COLUMNS = ("selector", "type", "step", "ade_m", "fde_m", "min_ade_m", "min_fde_m", "n")
GROUPS = ("kinematic", "interactive", "map")
"""Of features of the realism score."""


def write_evaluation(result: dict[str, Any], folder: Path) -> None:
    """Write what `slrl_sumo.studies.prediction.evaluate.evaluate` found into `folder`, which is created."""
    with writing(folder):
        folder.mkdir(exist_ok=True)
        write_json(folder / "results.json", result)
        with open(folder / "results.csv", "w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(result["rows"])
        draw_errors(result["rows"]).savefig(folder / "errors.png", dpi=110)


def print_evaluation(result: dict[str, Any]) -> None:
    """Print the last step of each type and selector, bends and driving on stdout."""
    last = {(row["type"], row["selector"]): row for row in result["rows"]}  # rows come in the order of steps
    for title, rows in (
        (f"{result['recording']}: errors after the last step, {result['starts']} starts", list(last.values())),
        ("of road users in bends", result["bends"]),
    ):
        table = Table(title=title, title_justify="left")
        for heading in ("type", "selector", "step"):
            table.add_column(heading)
        for heading in ("mean error (m)", "final error (m)", f"best of {result['samples']}: mean", "final", "n"):
            table.add_column(heading, justify="right")
        for row in sorted(rows, key=lambda row: str(row["type"])):
            figures = (f"{row[key]:.2f}" for key in COLUMNS[3:7])
            table.add_row(row["type"], row["selector"], str(row["step"]), *figures, str(row["n"]))
        if rows:
            print_table(table)
    for note in result["notes"]:
        print(f"note: {note}", file=sys.stderr)
    if result["realism"]:
        table = Table(title="realism: recorded motion among the simulated, 0 to 1", title_justify="left")
        for heading in ("type", "selector"):
            table.add_column(heading)
        for heading in ("score", *GROUPS, "standing", "n"):
            table.add_column(heading, justify="right")
        for row in sorted(result["realism"], key=lambda row: str(row["type"])):
            scores = (row["score"], *(row["groups"].get(group) for group in GROUPS), row["features"]["standing"])
            table.add_row(row["type"], row["selector"], *(_cell(one, ".3f") for one in scores), str(row["n"]))
        print_table(table)
    if result["driving"]:
        table = Table(title="long rollouts of the prior, 25.6 s", title_justify="left")
        table.add_column("type")
        for heading in ("yaw rate 99 % (rad/s)", "sideslip 99 % (rad)", "slow yaw rate, first / last quarter"):
            table.add_column(heading, justify="right")
        for heading in ("speed within recorded", "acceleration within", "farthest (m)"):
            table.add_column(heading, justify="right")
        for heading in ("JS distance: speed", "acceleration", "yaw rate", "nearest", "standing / recorded", "n"):
            table.add_column(heading, justify="right")
        for row in result["driving"]:
            table.add_row(
                row["type"],
                f"{row['yaw_rate_p99_radps']:.2f}",
                f"{row['sideslip_p99_rad']:.3f}",
                f"{_cell(row['slow_yaw_rate_first_radps'], '.2f')} / {_cell(row['slow_yaw_rate_last_radps'], '.2f')}",
                _cell(row["speed_within"], ".1%"),
                _cell(row["acceleration_within"], ".1%"),
                f"{row['farthest_m']:.0f}",
                *(f"{row['js'][quantity]:.2f}" for quantity in ("speed", "acceleration", "yaw_rate", "nearest")),
                f"{row['standing']:.1%} / {row['recorded_standing']:.1%}",
                str(row["n"]),
            )
        print_table(table)
    if result["off_surface"]:
        table = Table(title="steps that end off the own surface", title_justify="left")
        for heading in ("type", "selector"):
            table.add_column(heading)
        for heading in ("share", "steps"):
            table.add_column(heading, justify="right")
        for row in sorted(result["off_surface"], key=lambda row: str(row["type"])):
            table.add_row(row["type"], row["selector"], f"{row['share']:.1%}", str(row["steps"]))
        print_table(table)
    if result["reversing"]:
        print(f"left out: cars that reverse, {result['reversing']} times")
    print(f"surface: {result['surface']}")
    if result["expected_routes"]:
        print(f"routes straight on along their lanes are expected of: {', '.join(result['expected_routes'])}")


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
