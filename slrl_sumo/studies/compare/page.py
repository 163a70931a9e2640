"""A comparison as a page: a verdict, the differences as figures that scale, and every value; one file."""

from collections.abc import Sequence
from html import escape
from typing import Any

from slrl_sumo.studies.compare.measures import MEASURES, Measure
from slrl_sumo.studies.compare.run import LEARNED, SUMO
from slrl_sumo.studies.compare.verdicts import LESS, MORE, SAME, too_few

STYLE = """
:root { --ink: #1a1a1a; --soft: #5a5a5a; --line: #ddd; --page: #fff; --sumo: #777; --learned: #b86e00; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e4e4e4; --soft: #a8a8a8; --line: #444; --page: #16181b; --sumo: #aaa; --learned: #f0a73a; }
}
body { font: 16px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--page); margin: 1.5rem auto;
  max-width: 70rem; padding: 0 1rem; }
h1 { font-size: 1.4rem; margin-bottom: 0.2rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
p { max-width: 60rem; } .soft { color: var(--soft); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25rem 0.7rem; border-bottom: 1px solid var(--line); text-align: right; white-space: nowrap; }
th:nth-child(-n+2), td:nth-child(-n+2) { text-align: left; }
svg { display: block; width: 100%; max-width: 40rem; height: auto; }
text { font: 12px system-ui, sans-serif; fill: var(--ink); }
.axis { stroke: var(--line); } .sumo { stroke: var(--sumo); fill: var(--sumo); }
.learned { stroke: var(--learned); fill: var(--learned); }
dt { font-weight: 600; margin-top: 0.7rem; } dd { margin: 0 0 0 1.2rem; max-width: 58rem; }
"""
LEFT, RIGHT, ROW = 84.0, 350.0, 32.0
"""px: ends of the axis of a figure, and height of a type."""
WIDTH = 480.0


def page(result: dict[str, Any]) -> str:
    """The page of what `compare` found. Texts of the scenario are escaped; nothing is fetched."""
    rows = result["rows"]
    measures = [measure for measure in MEASURES if any(row["measure"] == measure.name for row in rows)]
    title = f"{result['scenario']}: SUMO's own models and {result['bundle']}"
    seeds = len(result["seeds"])
    lead = (
        f"{result['seconds']:g} s, {seeds} seed{'s' * (seeds > 1)}, selector {result['selector']}"
        f"{' with guard' * result['guard']}; taken over: {result['takeover']}"
    )
    notes = [f"left out: {one['arm']}, seed {one['seed']}: {one['reason']}" for one in result["left_out"]]
    terms = "".join(f"<dt>{escape(_title(m))}</dt><dd>{escape(m.definition)}</dd>" for m in measures)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n<h1>{escape(title)}</h1>\n"
        f'<p class="soft">{escape(lead)}</p>\n<h2>What differs</h2>\n{_verdict(result)}'
        + "".join(f'<p class="soft">Note: {escape(note)}.</p>\n' for note in (*result["notices"], *notes))
        + f"<h2>Figures</h2>\n{_legend()}{''.join(_figure(m, rows) for m in measures)}"
        f"<h2>All values</h2>\n{_table(measures, rows)}"
        f"<h2>Definitions</h2>\n<dl>{terms}</dl>\n</body>\n</html>\n"
    )


def _title(measure: Measure) -> str:
    return f"{measure.title}{'' if measure.unit == '1' else f' ({measure.unit})'}"


def _verdict(result: dict[str, Any]) -> str:
    """What the intervals allow to say, in sentences."""
    titles = {measure.name: measure.title for measure in MEASURES}
    said = []
    for verdict, words in (
        (MORE, "Higher with learned road users"),
        (LESS, "Lower"),
        (SAME, "No difference that the seeds show"),
    ):
        found = [
            f"{titles[row['measure']]} ({row['type']})"
            for row in result["rows"]
            if row["verdict"] == verdict and row["measure"] != "learned"
        ]
        if found:
            said.append(f"<p><b>{words}:</b> {escape(', '.join(found))}.</p>\n")
    few = too_few(result["rows"], len(result["seeds"]))
    return "".join(said) + (f"<p><b>{escape(few)}</b></p>\n" if few else "")


def _legend() -> str:
    return (
        '<p class="soft">Discs: means over the seeds, grey SUMO\'s own models, orange learned; lines: 95 % confidence '
        "intervals (Student's t), cut at the ends of the axis; small dots: the seeds. Figures that are 0 in both are "
        "left out.</p>\n"
    )


def _figure(measure: Measure, rows: Sequence[dict[str, Any]]) -> str:
    mine = [row for row in rows if row["measure"] == measure.name]
    values = [value for row in mine for pair in row["by_seed"].values() for value in pair.values()]
    if not any(values):
        return ""
    least, most = float(min(0.0, *values)), float(max(0.0, *values))
    span = 1.1 * (most - least)

    def at(value: float) -> float:
        return LEFT + (RIGHT - LEFT) * min(max((value - least) / span, 0.0), 1.0)

    height = ROW * len(mine) + 34.0
    parts = [
        f'<line class="axis" x1="{LEFT:g}" x2="{RIGHT:g}" y1="{height - 20:g}" y2="{height - 20:g}"/>',
        f'<text x="{at(0.0):.1f}" y="{height - 6:g}" text-anchor="middle">0</text>',
        f'<text x="{at(most):.1f}" y="{height - 6:g}" text-anchor="middle">{most:.{measure.digits}f}</text>',
    ]
    for number, row in enumerate(mine):
        y = ROW * number + 12.0
        parts.append(f'<text x="{LEFT - 10:g}" y="{y + 9:g}" text-anchor="end">{escape(row["type"])}</text>')
        parts.append(f'<text x="{RIGHT + 10:g}" y="{y + 9:g}">{escape(row["verdict"])}</text>')
        for arm, shift in ((SUMO, 0.0), (LEARNED, 9.0)):
            low, high, where = row[f"{arm}_low"], row[f"{arm}_high"], y + shift
            if low is not None:
                parts.append(f'<line class="{arm}" x1="{at(low):.1f}" x2="{at(high):.1f}" y1="{where}" y2="{where}"/>')
            for pair in row["by_seed"].values():
                parts.append(f'<circle class="{arm}" cx="{at(pair[arm]):.1f}" cy="{where}" r="1.4"/>')
            parts.append(f'<circle class="{arm}" cx="{at(row[arm]):.1f}" cy="{where}" r="4"/>')
    label = escape(_title(measure))
    return (
        f'<h3>{label}</h3>\n<svg viewBox="0 0 {WIDTH:g} {height:g}" role="img" aria-label="{label}">'
        f"{''.join(parts)}</svg>\n"
    )


def _table(measures: Sequence[Measure], rows: Sequence[dict[str, Any]]) -> str:
    heads = "".join(
        f"<th>{head}</th>"
        for head in ("measure", "type", "SUMO", "learned", "difference", "95 % interval", "it says", "seeds")
    )
    lines = []
    for measure in measures:
        for row in (row for row in rows if row["measure"] == measure.name):
            digits, low = measure.digits, row["difference_low"]
            between = "–" if low is None else f"{low:+.{digits}f} to {row['difference_high']:+.{digits}f}"
            cells = [
                *(_title(measure), row["type"], f"{row[SUMO]:.{digits}f}", f"{row[LEARNED]:.{digits}f}"),
                *(f"{row['difference']:+.{digits}f}", between, row["verdict"], str(row["seeds"])),
            ]
            lines.append(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>")
    return f'<div class="wide"><table>\n<tr>{heads}</tr>\n{"".join(lines)}\n</table></div>\n'
