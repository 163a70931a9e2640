"""Outputs of the flow benchmark: results.json, results.csv, two pictures, and a printed table."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from slrl_sumo.formats.output_files import write_json, writing
from slrl_sumo.jobs.tables import print_table
from slrl_sumo.studies.flow.figures import FIGURES
from slrl_sumo.studies.flow.pictures import draw_fundamental_diagram, draw_under_way
from slrl_sumo.studies.flow.run import SUMO, Record, Run

COLUMNS = ("situation", "figure", "arm", "unit", "value", "ratio")
"""Of results.csv."""
FILES = ("results.json", "results.csv", "fundamental_diagram.png", "under_way.png")


def write_flow(result: dict[str, Any], runs: Mapping[Run, Record], folder: Path) -> None:
    """Write the result of `measure_flow` into `folder`, which is there."""
    with writing(folder):
        write_json(folder / "results.json", result)
        with open(folder / "results.csv", "w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore")
            writer.writeheader()
            writer.writerows(result["rows"])
        draw_fundamental_diagram(runs).savefig(folder / "fundamental_diagram.png", dpi=110)
        draw_under_way(runs).savefig(folder / "under_way.png", dpi=110)


def print_flow(result: dict[str, Any], folder: Path | None, wall_s: float) -> None:
    """Print a line for each situation and figure, and the definitions of the figures."""
    seeds = result["seeds"]
    table = Table(
        title=f"Flow: bundle {result['bundle']}, {result['share']:.0%} of the road users learned, "
        f"{len(seeds)} seed{'s' * (len(seeds) > 1)}",
        title_justify="left",
        caption="means over the seeds; in brackets the ratio to SUMO's own",
        caption_justify="left",
    )
    arms = (SUMO, *result["selectors"])
    for heading in ("situation", "figure"):
        table.add_column(heading, no_wrap=True)
    for arm in arms:
        table.add_column(arm, justify="right", no_wrap=True)
    cells = {(row["situation"], row["figure"], row["arm"]): row for row in result["rows"]}
    shown = []
    for situation in result["situations"]:
        mine = [name for name in FIGURES if any((situation, name, arm) in cells for arm in arms)]
        for name in mine:
            figure = FIGURES[name]
            title = f"{figure.title}{'' if figure.unit == '1' else f' ({figure.unit})'}"
            values = [_cell(cells.get((situation, name, arm)), figure.digits) for arm in arms]
            table.add_row(situation if name == mine[0] else "", title, *values)
        table.add_section()
        shown += mine
    print_table(table, 140)
    for name in dict.fromkeys(shown):
        print(f"{FIGURES[name].title}: {FIGURES[name].definition}")
    for one in result["left_out"]:
        print(f"left out: {one['situation']}, {one['arm']}, seed {one['seed']}: {one['reason']}")
    written = f"{folder}: {', '.join(FILES)} " if folder else ""
    print(f"{written}({wall_s:.0f} s)")


def _cell(row: dict[str, Any] | None, digits: int) -> str:
    if row is None:
        return "–"
    ratio = "" if row["ratio"] is None else f" ({row['ratio']:.2f})"
    return f"{row['value']:.{digits}f}{ratio}"
