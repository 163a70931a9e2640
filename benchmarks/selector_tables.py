"""Results of `slrl-sumo evaluate` as the Markdown tables of docs/measurements/archive/selectors.md.

python benchmarks/selector_tables.py RESULTS.json ...
"""

import json
import sys
from pathlib import Path
from typing import Any

TYPES = ("car", "bicycle", "pedestrian")


def main() -> None:
    """Print one table for each file."""
    for name in sys.argv[1:]:
        rows = json.loads(Path(name).read_text(encoding="utf-8"))["rows"]
        print(f"\n{name}\n")
        print("\n".join(scenario_table(rows) if "episodes" in rows[0] else prediction_table(rows)))


def scenario_table(rows: list[dict[str, Any]]) -> list[str]:
    """Selectors in a scenario: one line per type, selector and number of learned road users."""
    lines = [
        "| type | selector | agents | success | speed (m/s) | standing | collisions /1000 | near misses /1000 | "
        "off surface | paper: success | survival (steps) | collisions /1000 |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for kind in TYPES:
        for row in (row for row in rows if row["type"] == kind and row["success_rate"] is not None):
            share = row["off_surface_share"]
            lines.append(
                f"| {kind} | {row['selector']} | {row['agents'] or '-'} | "
                f"{row['success_rate']:.0%} ± {row['success_rate_std'] or 0:.0%} | "
                f"{row['mean_speed_mps']:.2f} | {row['standing_share']:.1%} | "
                f"{row['collisions_per_1000_steps']:.2f} | {row['near_misses_per_1000_steps']:.2f} | "
                f"{'-' if share is None else f'{share:.1%}'} | "
                f"{row['paper_success_rate']:.0%} ± {row['paper_success_rate_std'] or 0:.0%} | "
                f"{row['paper_survival_steps']:.0f} ± {row['paper_survival_steps_std'] or 0:.0f} | "
                f"{row['paper_collisions_per_1000_steps']:.2f} |"
            )
    return lines


def prediction_table(rows: list[dict[str, Any]]) -> list[str]:
    """Prediction errors at the last step, per type and selector."""
    lines = ["| type | selector | n | ADE (m) | FDE (m) | best of 20, ADE (m) |", "|---|---|---|---|---|---|"]
    last = max(row["step"] for row in rows)
    for kind in TYPES:
        for row in (row for row in rows if row["type"] == kind and row["step"] == last):
            lines.append(
                f"| {kind} | {row['selector']} | {row['n']} | {row['ade_m']:.2f} | {row['fde_m']:.2f} | "
                f"{row['min_ade_m']:.2f} |"
            )
    return lines


if __name__ == "__main__":
    main()
