"""Outputs of a comparison: page, picture, results.json, results.csv, conflicts.csv and a printed table."""

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from slrl_sumo.formats.output_files import write_json, writing
from slrl_sumo.jobs.tables import print_table
from slrl_sumo.metrics.surrogate_safety import deceleration_to_avoid_crash
from slrl_sumo.studies.compare.figure import draw_comparison
from slrl_sumo.studies.compare.measures import MEASURES
from slrl_sumo.studies.compare.page import page
from slrl_sumo.studies.compare.run import Record, Run
from slrl_sumo.studies.compare.tables import columns
from slrl_sumo.studies.compare.verdicts import UNKNOWN
from slrl_sumo.studies.compare.words import arms, caveat, lead, percent, title

CONFLICT_COLUMNS = (
    "seed",
    "arm",
    "measure",
    "id_a",
    "id_b",
    "type_a",
    "type_b",
    "time_s",
    "x_m",
    "y_m",
    "value_s",
    "closing_mps",
    "angle_deg",
    "drac_mps2",
)
"""Of conflicts.csv: see `conflicts.Conflicts`; drac only for TTC conflicts without contact."""


PAIRED = (
    "mean over seeds; difference: learned - sumo, with its 95 % confidence interval (Student's t, paired by seed); "
    "* where 0 is outside of it, ? where it is too wide to say anything"
)
SINGLE = "one trace of each; difference: second - first, and its share of first"


def write_comparison(result: dict[str, Any], runs: Mapping[Run, Record], folder: Path) -> None:
    """Write what `slrl_sumo.studies.compare.comparison.compare` found into `folder`, which is there."""
    with writing(folder):
        write_json(folder / "results.json", result)
        with open(folder / "results.csv", "w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, columns(arms(result)), extrasaction="ignore")
            writer.writeheader()
            writer.writerows(result["rows"])
        with open(folder / "conflicts.csv", "w", encoding="utf-8", newline="") as file:
            lines = csv.writer(file)
            lines.writerow(CONFLICT_COLUMNS)
            for run in sorted(runs):
                for measure, found in runs[run]["conflicts"].items():
                    lines.writerows([run.seed, run.arm, measure, *_conflict(measure, row)] for row in found)
        if "traces" not in result:
            draw_comparison(result).savefig(folder / "comparison.png", dpi=110)
        (folder / "comparison.html").write_text(page(result), encoding="utf-8")


def print_comparison(result: dict[str, Any], folder: Path, wall_s: float) -> None:
    """Print a line for each measure and type on stdout."""
    first, second = arms(result)
    single = "traces" in result
    table = Table(
        title=f"{title(result)}\n{lead(result)}",
        title_justify="left",
        caption=SINGLE if single else PAIRED,
        caption_justify="left",
    )
    table.add_column("measure", no_wrap=True)
    table.add_column("type", no_wrap=True)
    for heading in (first, second, "difference", "%" if single else "95 %"):
        table.add_column(heading, justify="right", no_wrap=True)
    for measure in MEASURES:
        mine = [row for row in result["rows"] if row["measure"] == measure.name]
        for row in mine:
            name = f"{measure.title}{'' if measure.unit == '1' else f' ({measure.unit})'}"
            cells = _cells(row, measure.digits, (first, second), single=single)
            table.add_row(name if row is mine[0] else "", row["type"], *cells)
        if mine:
            table.add_section()
    print_table(table)
    for one in result["distances"]:
        if one["quantity"] == "speed":
            distance = f"{one['distance']:.2f} (0: the same, 1: nothing in common)"
            print(f"Jensen-Shannon distance of {one['type']} speeds from {first}'s: {distance}")
    for one in result["left_out"]:
        print(f"left out: {one['arm']}, seed {one['seed']}: {one['reason']}; to repeat it: {one['command']}")
    for notice in result["notices"]:
        print(f"note: {notice}")
    if words := caveat(result):
        print(words)
    picture = "" if single else "comparison.png, "
    print(f"{folder}: comparison.html, {picture}results.json, results.csv, conflicts.csv ({wall_s:.0f} s)")


def _cells(row: dict[str, Any], digits: int, arms: tuple[str, str], *, single: bool) -> list[str]:
    figures = [f"{row[arm]:.{digits}f}" for arm in arms]
    if single:
        return [*figures, _signed(row["difference"], digits), percent(row, arms[0])]
    low, high = row["difference_low"], row["difference_high"]
    between = "–" if low is None else f"{_signed(low, digits)} .. {_signed(high, digits)}"
    between += " ?" * (low is not None and row["verdict"] == UNKNOWN)
    sure = " *" if low is not None and (low > 0.0 or high < 0.0) else ""
    return [
        *figures,
        f"{_signed(row['difference'], digits)}{sure}",
        between,
    ]


def _signed(value: float, digits: int) -> str:
    return f"{round(value, digits) + 0.0:+.{digits}f}"  # 0.0 makes -0 a 0


def _conflict(measure: str, row: list[Any]) -> list[Any]:
    *before, value, closing, angle = row
    drac = deceleration_to_avoid_crash(ttc=np.array([value]), closing=np.array([closing]))[0]
    return [
        *before,
        value,
        closing,
        round(math.degrees(angle), 1),
        round(drac, 2) if measure == "ttc" and value > 0 else "",
    ]
