"""The report as a page: tables and figures, each linked to its definition."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from slrl_sumo.metrics.conflicts import PET_LIMIT, Conflicts
from slrl_sumo.metrics.distributions import QUANTITIES, Kinematics, kinematic_distances
from slrl_sumo.metrics.encounters import TTC_LIMIT
from slrl_sumo.metrics.traffic.queues import Queue
from slrl_sumo.report.conflict_figures import GROUP_NAMES
from slrl_sumo.report.definitions import DEFINITIONS
from slrl_sumo.report.looks import DARK
from slrl_sumo.report.queue_figures import NAMED_QUEUES
from slrl_sumo.report.recorder import RunRecord
from slrl_sumo.report.reference import Reference, counts_by_group
from slrl_sumo.scene.types import TYPE_NAMES

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #1a1a1a; background: #fff; margin: 2rem auto; max-width: 72rem;
  padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0.2rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
p, figcaption { max-width: 60rem; } nav a { margin-right: 1rem; } a { color: #0072b2; }
figure { margin: 0.8rem 0; } img { max-width: 100%; height: auto; }
figcaption { color: #444; font-size: 0.9rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 0.6rem 0; }
th, td { padding: 0.25rem 0.8rem; border-bottom: 1px solid #ddd; text-align: right; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
th { font-weight: 600; } dt { font-weight: 600; margin-top: 0.8rem; } dd { margin: 0 0 0 1.2rem; max-width: 58rem; }
dt:target, dt:target + dd { background: #fff3c4; }
.note { color: #444; }
@media (prefers-color-scheme: dark) {
  body { color: #ddd; background: #16181b; } a { color: #6cb8ff; } th, td { border-color: #444; }
  figcaption, .note { color: #aaa; } dt:target, dt:target + dd { background: #4a4320; }
}
@media (max-width: 40rem) {
  body { margin: 1rem auto; font-size: 16px; } th, td { padding: 0.25rem 0.5rem; }
  img.panels { width: 50rem; max-width: none; } nav a { display: inline-block; padding: 0.3rem 0; }
}
"""
MAPS = ("paths", "queues")
"""Figures of one panel, which fit on a phone; wider figures are scrolled."""

SUMMARY = (
    ("count", "count", "count", 1.0, "d"),
    ("mean speed (m/s)", "mean_speed", "mean_speed_mps", 1.0, ".2f"),
    ("standing (%)", "standing", "standing_share", 100.0, ".1f"),
    ("collisions", "collision", "collisions", 1.0, "d"),
    ("near misses", "near_miss", "near_misses", 1.0, "d"),
    ("survival (decisions)", "survival", "survival_steps", 1.0, ".1f"),
    ("success (%)", "success", "success_rate", 100.0, ".1f"),
    ("off surface (%)", "off_surface", "off_surface_share", 100.0, ".1f"),
)
"""Heading, definition, key of the summary, scale, format."""


def page(
    record: RunRecord,
    summary: Mapping[str, Any],
    reference: Reference,
    ours: Kinematics,
    conflicts: Mapping[str, Conflicts],
    queues: Sequence[Queue],
    pictures: Sequence[str],
) -> str:
    """The whole page; `pictures`: names of the figures beside it, PNGs for light and for dark pages."""
    sections = [
        ("summary", "Summary", _summary(record, summary)),
        ("paths", "Paths", _figure("paths", pictures, "path", "Paths of the learned road users.")),
        ("motion", "Motion", _motion(reference, ours, pictures)),
        ("maps", "Space and time", _maps(pictures)),
        ("queues", "Queues", _queues(record, queues, pictures)),
        ("conflicts", "Conflicts", _conflicts(record, conflicts, pictures)),
        ("modes", "Modes", _modes(record, pictures)),
        ("views", "Ego images", _figure("ego_images", pictures, "ego_image", "Ego images of some learned road users.")),
    ]
    sections = [section for section in sections if section[2]]
    terms = "".join(
        f'<dt id="{name}">{escape(title)}</dt><dd>{escape(text)}</dd>\n' for name, (title, text) in DEFINITIONS.items()
    )
    sections.append(("definitions", "Definitions", f"<dl>\n{terms}</dl>"))
    links = " ".join(f'<a href="#section-{name}">{title}</a>' for name, title, _ in sections)
    body = "\n".join(f'<h2 id="section-{name}">{title}</h2>\n{text}' for name, title, text in sections)
    heading = f"{summary['scenario']}: learned road users"
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(heading)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{STYLE}</style>\n</head>\n<body>\n<h1>{escape(heading)}</h1>\n<nav>{links}</nav>\n{body}\n</body>\n</html>\n"
    )


def _link(name: str, text: str) -> str:
    return f'<a href="#{name}">{escape(text)}</a>'


def _table(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """`heads` are HTML, `lines` text."""
    top = "".join(f"<th>{head}</th>" for head in heads)
    rows = "\n".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in line)}</tr>" for line in lines)
    return f'<div class="wide"><table>\n<tr>{top}</tr>\n{rows}\n</table></div>'


def _figure(name: str, pictures: Sequence[str], definition: str, caption: str) -> str:
    if name not in pictures:
        return ""
    panels = "" if name in MAPS else ' class="panels"'
    dark = f'<source srcset="{name}{DARK.suffix}.png" media="(prefers-color-scheme: dark)">'
    picture = f'<picture>{dark}<img src="{name}.png"{panels} alt="{escape(caption)}"></picture>'
    image = f'<div class="wide"><a href="{name}.png">{picture}</a></div>'
    more = _link(definition, "Definition.")
    return f"<figure>{image}<figcaption>{escape(caption)} {more}</figcaption></figure>"


def _number(value: float | None, form: str, scale: float = 1.0) -> str:
    return "–" if value is None else format(value if form == "d" else scale * value, form)


def _summary(record: RunRecord, summary: Mapping[str, Any]) -> str:
    facts = [
        f"bundle {summary['bundle']}, selector {summary['selector']}, seed {summary['seed']}",
        f"from {summary['begin_s']:g} s on, SUMO step {summary['sumo_step_s']:g} s",
    ]
    decisions = f"{summary['decisions']} {_link('decision', 'decisions')} of {summary['decision_interval_s']:g} s"
    agent_steps = f"{summary['agent_steps']} {_link('decision', 'agent-steps')} in {summary['wall_s']:.1f} s"
    factor = f"{_number(summary['real_time_factor'], '.1f')} {_link('real_time', 'times real time')}"
    text = f"<p>{escape('; '.join(facts))}; {decisions}; {agent_steps}, {factor}.</p>"
    lines = [
        [name, *(_number(summary["per_type"][name][key], form, scale) for _, _, key, scale, form in SUMMARY)]
        for name in TYPE_NAMES
        if summary["per_type"][name]["count"]
    ]
    text += _table(["type", *(_link(definition, title) for title, definition, *_ in SUMMARY)], lines)
    words = ("lost", "wrapped_around", "taken_over", "handed_back", "returned_to_route", "arrived", "under_way")
    ends = [str(summary[word]) for word in words]
    text += _table(["", *(_link("lost", f"{word.replace('_', ' ')}") for word in words)], [["road users", *ends]])
    for notice in summary["notices"]:
        text += f'<p class="note">Note: {escape(notice)}.</p>'
    if record.cut:
        text += (
            f'<p class="note">The run was long: figures and tables below cover its first {record.seconds:.0f} s.</p>'
        )
    return text


def _motion(reference: Reference, ours: Kinematics, pictures: Sequence[str]) -> str:
    if "motion" not in pictures:
        return ""
    text = _figure("motion", pictures, "motion", f"Learned road users (filled) and {reference.name} (line).")
    distances = kinematic_distances(ours, reference.motion)
    lines = []
    for kind, name in enumerate(TYPE_NAMES):
        if not len(ours["speed"][kind]):
            continue
        score = reference.realism.get(name)
        means = [values[kind] for values in (ours["speed"], reference.motion["speed"])]
        groups = ("kinematic", "interactive", "map")
        lines.append(
            [
                name,
                *(_number(float(values.mean()) if len(values) else None, ".2f") for values in means),
                *(_number(distances[name][quantity], ".2f") for quantity in QUANTITIES),
                _number(None if score is None else score.score, ".2f"),
                *(_number(None if score is None else score.groups.get(group), ".2f") for group in groups),
            ]
        )
    heads = [
        "type",
        _link("motion", "learned, mean speed (m/s)"),
        _link("motion", "reference, mean speed (m/s)"),
        *(_link("js", f"distance of {quantity.replace('_', ' ')}s") for quantity in QUANTITIES),
        _link("realism", "realism score"),
        *(_link("realism", part) for part in ("kinematic", "interactive", "map")),
    ]
    others = sum(len(values) for values in reference.motion["speed"])
    note = "" if others else '<p class="note">There was no road user to compare with.</p>'
    return text + f"<p>Compared with {escape(reference.name)}:</p>" + _table(heads, lines) + note


def _maps(pictures: Sequence[str]) -> str:
    caption = "Density and mean speed of all road users."
    path = "All road users along the busiest path, over time."
    return _figure("space_time", pictures, "space_time", path) + _figure("density", pictures, "density", caption)


def _queues(record: RunRecord, queues: Sequence[Queue], pictures: Sequence[str]) -> str:
    lines = [
        [
            *(str(number), record.standing.lane_of(queue) or "–"),
            *(f"{queue.x:.0f}, {queue.y:.0f}", f"{queue.begin:.0f} to {queue.end:.0f}"),
            *(str(queue.longest), f"{queue.waited_s:.0f}", f"{queue.first_id} ({queue.first_s:.0f} s)"),
        ]
        for number, queue in enumerate(queues[:NAMED_QUEUES], start=1)
    ]
    words = (
        "number",
        "lane",
        "place: x, y (m)",
        "time (s)",
        "longest (vehicles)",
        "waiting time of all (s)",
        "waited longest",
    )
    table = _table([_link("queue", word) for word in words], lines)
    return _figure("queues", pictures, "queue", "Where vehicles queued.") + table if queues else ""


def _conflicts(record: RunRecord, conflicts: Mapping[str, Conflicts], pictures: Sequence[str]) -> str:
    hours = len(record.tracks) * record.tracks.dt / 3600.0
    counts = {name: counts_by_group(found, record.tracks) for name, found in conflicts.items()}
    limits = {"ttc": TTC_LIMIT, "pet": PET_LIMIT}
    lines = [
        [" and ".join(pair), *(str(counts[m].get(pair, {}).get(group, 0)) for m in counts for group in GROUP_NAMES)]
        for pair in sorted({pair for found in counts.values() for pair in found})
    ]
    totals = [
        str(sum(found[group] for found in counts[measure].values())) for measure in counts for group in GROUP_NAMES
    ]
    heads = [
        "pair",
        *(
            _link(measure, f"{measure.upper()} < {limits[measure]:g} s, {GROUP_NAMES[group]} (count)")
            for measure in counts
            for group in GROUP_NAMES
        ),
    ]
    rates = "; ".join(
        f"{_link(name, name.upper())} &lt; {limits[name]:g} s: {len(found)} encounter{'' if len(found) == 1 else 's'}"
        + (f", {len(found) / hours:.1f} per {_link('road_user_hour', 'road-user hour')}" if hours else "")
        for name, found in conflicts.items()
    )
    figure = _figure("conflicts", pictures, "ttc", "Encounters by their smallest value, and their places.")
    return f"<p>{rates}.</p>" + _table(heads, [*lines, ["all", *totals]]) + figure


def _modes(record: RunRecord, pictures: Sequence[str]) -> str:
    if record.modes is None or "modes" not in pictures:
        return ""
    lines = []
    for kind, name in enumerate(TYPE_NAMES):
        counts = record.modes[kind]
        if counts.any():
            first = int(np.argmax(counts))
            share = 100.0 * counts[first] / counts.sum()
            lines.append([name, str(counts.sum()), str((counts > 0).sum()), str(first), f"{share:.1f}"])
    words = ("decisions (count)", "modes chosen at least once (count)", "most frequent mode (number)", "its share (%)")
    table = _table(["type", *(_link("mode", word) for word in words)], lines)
    return table + _figure("modes", pictures, "mode", "What each mode is a cluster of, and how often it was chosen.")
