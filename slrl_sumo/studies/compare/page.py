"""A comparison as a page: a verdict, the differences as figures that scale, and every value; one file."""

from collections.abc import Sequence
from html import escape
from typing import Any

from slrl_sumo.studies.compare.measures import MEASURES, Measure
from slrl_sumo.studies.compare.verdicts import EQUAL, LESS, MORE, SAME
from slrl_sumo.studies.compare.words import arm_names, arms, caveat, lead, percent, title

STYLE = """
:root { --ink: #1a1a1a; --soft: #5a5a5a; --line: #ddd; --page: #fff; --first: #777; --second: #b86e00; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e4e4e4; --soft: #a8a8a8; --line: #444; --page: #16181b; --first: #aaa; --second: #f0a73a; }
}
body { font: 16px/1.45 system-ui, sans-serif; color: var(--ink); background: var(--page); margin: 1.5rem auto;
  max-width: 70rem; padding: 0 1rem; }
h1 { font-size: 1.4rem; margin-bottom: 0.2rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
h1, p { overflow-wrap: anywhere; } p { max-width: 60rem; } .soft { color: var(--soft); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 0.25rem 0.7rem; border-bottom: 1px solid var(--line); text-align: right; white-space: nowrap; }
th:nth-child(-n+2), td:nth-child(-n+2) { text-align: left; }
svg { display: block; width: 100%; max-width: 40rem; height: auto; }
text { font: 12px system-ui, sans-serif; fill: var(--ink); }
@media (max-width: 30rem) { text { font-size: 13px; } td:first-child { white-space: normal; }
  th, td { padding: 0.25rem 0.3rem; font-size: 14px; } }
.axis { stroke: var(--line); } .first { stroke: var(--first); fill: var(--first); }
.second { stroke: var(--second); fill: var(--second); }
dt { font-weight: 600; margin-top: 0.7rem; } dd { margin: 0 0 0 1.2rem; max-width: 58rem; }
"""
LEFT, RIGHT, ROW = 86.0, 325.0, 32.0
"""px: ends of the axis of a figure, and height of a type."""
WIDTH = 480.0


def page(result: dict[str, Any]) -> str:
    """The page of what `compare` found. Texts of the scenario are escaped; nothing is fetched."""
    rows = result["rows"]
    measures = [measure for measure in MEASURES if any(row["measure"] == measure.name for row in rows)]
    heading = escape(title(result))
    notes = [f"left out: {one['arm']}, seed {one['seed']}: {one['reason']}" for one in result["left_out"]]
    defined = {row["measure"]: row["definition"] for row in rows}
    terms = "".join(f"<dt>{escape(_title(m))}</dt><dd>{escape(defined[m.name])}</dd>" for m in measures)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{heading}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n<h1>{heading}</h1>\n"
        f'<p class="soft">{escape(lead(result))}</p>\n<h2>What differs</h2>\n{_verdict(result)}'
        + "".join(f'<p class="soft">Note: {escape(note)}.</p>\n' for note in (*result["notices"], *notes))
        + f"<h2>Figures</h2>\n{_legend(result)}{''.join(_figure(m, rows, arms(result)) for m in measures)}"
        f"<h2>All values</h2>\n{_table(measures, result)}{_trips(result)}"
        f"<h2>Definitions</h2>\n<dl>{terms}</dl>\n</body>\n</html>\n"
    )


def _title(measure: Measure) -> str:
    return f"{measure.title}{'' if measure.unit == '1' else f' ({measure.unit})'}"


def _verdict(result: dict[str, Any]) -> str:
    """Conclusions from the intervals, in sentences; for traces, higher and lower values, the largest share first."""
    titles = {measure.name: measure.title for measure in MEASURES}
    said, (first, second), rows = [], arms(result), result["rows"]
    if "traces" in result:
        rows = sorted(rows, key=lambda row: -abs(row["difference"]) / abs(row[first]) if row[first] else 0.0)
    for verdict, words in (
        (MORE, f"Higher in {result['traces'][second]}" if "traces" in result else "Higher with learned road users"),
        (LESS, "Lower"),
        (SAME, "No difference that the seeds show"),
        (EQUAL, "The same"),
    ):
        found: dict[str, list[str]] = {}
        for row in rows:
            if row["verdict"] == verdict and row["measure"] != "learned":
                share = _share(row, first) if "traces" in result else ""
                found.setdefault(titles[row["measure"]], []).append(f"{row['type']}{share}")
        if found:
            listed = "; ".join(f"{name} ({', '.join(kinds)})" for name, kinds in found.items())
            said.append(f"<p><b>{escape(words)}:</b> {escape(listed)}.</p>\n")
    doubt = caveat(result)
    return "".join(said) + (f"<p><b>{escape(doubt)}</b></p>\n" if doubt else "")


def _share(row: dict[str, Any], first: str) -> str:
    return f" {percent(row, first)} %" if row[first] and row["difference"] else ""


def _legend(result: dict[str, Any]) -> str:
    if "traces" in result:
        names = "; ".join(
            f"{colour} {name}" for colour, name in zip(("grey", "orange"), arm_names(result), strict=True)
        )
        return f'<p class="soft">{escape(names)}. Figures that are 0 in both are left out.</p>\n'
    return (
        '<p class="soft">Discs: means over the seeds, grey SUMO\'s own models, orange learned; lines: 95 % confidence '
        "intervals (Student's t), cut at the ends of the axis; small dots: the seeds. Figures that are 0 in both are "
        "left out.</p>\n"
    )


def _figure(measure: Measure, rows: Sequence[dict[str, Any]], keys: tuple[str, str]) -> str:
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
        for arm, style, shift in zip(keys, ("first", "second"), (0.0, 9.0), strict=True):
            low, high, where = row[f"{arm}_low"], row[f"{arm}_high"], y + shift
            if low is not None:
                parts.append(
                    f'<line class="{style}" x1="{at(low):.1f}" x2="{at(high):.1f}" y1="{where}" y2="{where}"/>'
                )
            for pair in row["by_seed"].values():
                parts.append(f'<circle class="{style}" cx="{at(pair[arm]):.1f}" cy="{where}" r="1.4"/>')
            parts.append(f'<circle class="{style}" cx="{at(row[arm]):.1f}" cy="{where}" r="4"/>')
    label = escape(_title(measure))
    return (
        f'<h3>{label}</h3>\n<svg viewBox="0 0 {WIDTH:g} {height:g}" role="img" aria-label="{label}">'
        f"{''.join(parts)}</svg>\n"
    )


def _table(measures: Sequence[Measure], result: dict[str, Any]) -> str:
    single, (first, second) = "traces" in result, arms(result)
    heads = ["measure", "type", *((first, second) if single else ("SUMO", "learned")), "difference"]
    heads += ["%"] if single else ["95 % interval", "it says", "seeds"]
    lines = []
    for measure in measures:
        for row in (row for row in result["rows"] if row["measure"] == measure.name):
            digits, low = measure.digits, row["difference_low"]
            between = "–" if low is None else f"{low:+.{digits}f} to {row['difference_high']:+.{digits}f}"
            lines.append(
                [
                    *(_title(measure), row["type"], f"{row[first]:.{digits}f}", f"{row[second]:.{digits}f}"),
                    f"{row['difference']:+.{digits}f}",
                    *([percent(row, first)] if single else [between, row["verdict"], str(row["seeds"])]),
                ]
            )
    return _lines(heads, lines)


def _trips(result: dict[str, Any]) -> str:
    """The road users with the greatest differences of travel times between two traces."""
    if "traces" not in result:
        return ""
    trips, (first, second) = result["trips"], arms(result)
    text = (
        f"Whole trips in both traces: {trips['in_both']}. Road users in the first trace alone: {trips['only_first']}; "
        f"in the second alone: {trips['only_second']}."
    )
    lines = [
        [one["id"], one["type"], f"{one[first]:.1f}", f"{one[second]:.1f}", f"{one[second] - one[first]:+.1f}"]
        for one in trips["largest"]
    ]
    heads = ["road user", "type", f"{first} (s)", f"{second} (s)", "difference (s)"]
    table = _lines(heads, lines) if lines else ""
    return f"<h2>Travel times that differ most</h2>\n<p>{text}</p>\n{table}"


def _lines(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    top = "".join(f"<th>{escape(head)}</th>" for head in heads)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in line)}</tr>" for line in lines)
    return f'<div class="wide"><table>\n<tr>{top}</tr>\n{body}\n</table></div>\n'
