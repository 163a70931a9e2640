"""Tables of takeover runs over several seeds: one row for each scenario and selector."""

from collections.abc import Callable, Sequence
from statistics import fmean, median
from typing import Any

Row = dict[str, Any]
"""One run: a line of the log of study.py."""
Value = Callable[[Row], float | None]

WHEELS = ("car", "bicycle")
TYPES = ("car", "bicycle", "pedestrian")
CASE = ("scenario", "region", "seconds", "seed")
"""Keys that a run shares with the run of SUMO's own models that it is compared with."""


def add_time_ratios(rows: Sequence[Row]) -> None:
    """Compare the time in the region with that of the same road users in the `sumo` run of the same case.

    Sets in each row `time_ratio` by type: `of_medians` and `median`, over the `n` road users that left on their own
    route in both runs; None where there are none.
    """
    plain = {tuple(row[k] for k in CASE): row for row in rows if row["selector"] == "sumo" and "users" in row}
    for row in rows:
        reference = plain.get(tuple(row[k] for k in CASE))
        if "users" not in row or reference is None:
            continue
        row["time_ratio"] = {}
        for kind in TYPES:
            both = [
                (user["inside_s"], reference["users"][i]["inside_s"])
                for i, user in row["users"].items()
                if user["type"] == kind and user["left"] and reference["users"].get(i, {}).get("left")
            ]
            both = [(ours, theirs) for ours, theirs in both if theirs > 0.0]
            row["time_ratio"][kind] = {
                "of_medians": median(o for o, _ in both) / median(t for _, t in both) if both else None,
                "median": median(o / t for o, t in both) if both else None,
                "n": len(both),
            }


def on_route_share(kinds: Sequence[str]) -> Value:
    """Per cent of the counted road users of some types that left on their own route."""

    def value(row: Row) -> float | None:
        outcomes = [row["trip_outcomes"][kind] for kind in kinds]
        return _ratio(100.0 * sum(o["on_route"] for o in outcomes), sum(o["counted"] for o in outcomes))

    return value


def crossings_at(kinds: Sequence[str], aspect: str) -> Value:
    """Signal crossings at red or yellow per 1,000 of some types."""

    def value(row: Row) -> float | None:
        counts = [row["signal_crossings"][kind] for kind in kinds]
        return _ratio(1000.0 * sum(c[aspect] for c in counts), sum(c["all"] for c in counts))

    return value


def collisions(kind: str, key: str = "collisions") -> Value:
    """Collisions of a type, or "all", per 1,000 of it taken."""
    return lambda row: _ratio(1000.0 * row["driving_stats"][kind][key], row["trip_outcomes"][kind]["taken"])


def count(kind: str, key: str) -> Value:
    """Number of road users of a type, or "all", with some outcome."""
    return lambda row: float(row["trip_outcomes"][kind][key])


def driving(kind: str, key: str, scale: float = 1.0) -> Value:
    """A mean or share of a type."""

    def value(row: Row) -> float | None:
        found = row["driving_stats"][kind][key]
        return None if found is None else scale * found

    return value


def time_ratio(kind: str, key: str) -> Value:
    """See `add_time_ratios`."""
    return lambda row: row.get("time_ratio", {}).get(kind, {}).get(key)


def time_inside(kind: str) -> Value:
    """Median time (s) in the region of the road users that left on their own route."""

    def value(row: Row) -> float | None:
        times = [user["inside_s"] for user in row["users"].values() if user["type"] == kind and user["left"]]
        return median(times) if times else None

    return value


def hand_back(key: str) -> Value:
    """A figure of the time after the hand-back."""
    return lambda row: row["hand_back"][key]


def speed_of(key: str) -> Value:
    """A figure of the machine."""
    return lambda row: row["throughput"][key]


def _ratio(value: float, of: float) -> float | None:
    return value / of if of else None


def _each(title: str, unit: str, make: Callable[[str], Value], digits: int) -> list[tuple[str, Value, int]]:
    return [(f"{kind} {title}{', ' if unit else ''}{unit}", make(kind), digits) for kind in TYPES]


TABLES: dict[str, list[tuple[str, Value, int]]] = {
    "Trips": [
        ("taken", count("all", "taken"), 0),
        ("cars and bicycles that left on their route, %", on_route_share(WHEELS), 1),
        ("of", lambda row: float(sum(row["trip_outcomes"][k]["counted"] for k in WHEELS)), 0),
        ("pedestrians, %", on_route_share(["pedestrian"]), 1),
        ("of", count("pedestrian", "counted"), 0),
        ("returned to route", count("all", "returned_to_route"), 0),
        ("of these at their own destination", count("all", "left_network_at_end"), 0),
        ("other route", count("all", "off_route"), 0),
        ("lost", count("all", "lost"), 0),
        ("unfinished", count("all", "unfinished"), 0),
        ("arrived later", count("all", "arrived_later"), 0),
        ("under way", count("all", "under_way"), 0),
    ],
    "Time in the region": [
        *_each("median", "s", time_inside, 1),
        *_each("to sumo (medians)", "", lambda kind: time_ratio(kind, "of_medians"), 2),
        *_each("to sumo (median of ratios)", "", lambda kind: time_ratio(kind, "median"), 2),
    ],
    "Signals": [
        ("vehicles that passed", lambda row: float(sum(row["signal_crossings"][k]["all"] for k in WHEELS)), 0),
        ("at red per 1,000", crossings_at(WHEELS, "red"), 1),
        ("at yellow per 1,000", crossings_at(WHEELS, "yellow"), 1),
        ("pedestrians that stepped on", lambda row: float(row["signal_crossings"]["pedestrian"]["all"]), 0),
        ("at red per 1,000 of them", crossings_at(["pedestrian"], "red"), 1),
    ],
    "Collisions per 1,000 taken": [
        ("all", collisions("all"), 1),
        *[(kind, collisions(kind), 1) for kind in TYPES],
        ("with background", collisions("all", "collisions_with_background"), 1),
        ("near misses, all", collisions("all", "near_misses"), 1),
    ],
    "Driving and walking": [
        *_each("speed", "m/s", lambda kind: driving(kind, "mean_speed_mps"), 1),
        *_each("standing", "%", lambda kind: driving(kind, "standing_share", 100.0), 1),
        *[(f"{kind} braking hard, %", driving(kind, "hard_braking_share", 100.0), 2) for kind in WHEELS],
        *_each("off surface", "%", lambda kind: driving(kind, "off_surface_share", 100.0), 2),
    ],
    "After the hand-back": [
        ("hard braking per 1,000 s within 5 s of it", hand_back("hard_braking_after_per_1000_s"), 1),
        ("otherwise", hand_back("hard_braking_otherwise_per_1000_s"), 1),
        ("jumps", hand_back("jumps"), 0),
        ("teleports", hand_back("teleports"), 0),
    ],
    "Cars on their lanes, and the machine": [
        ("from the centre line, mean, m", driving("car", "lane_distance_mean_m"), 2),
        ("95 %, m", driving("car", "lane_distance_p95_m"), 2),
        ("changes of side per 100 m", driving("car", "sways_per_100_m"), 2),
        ("against the lane, %", driving("car", "against_share", 100.0), 2),
        ("agent-steps per s", speed_of("agent_steps_per_s"), 0),
        ("ms per decision", speed_of("ms_per_decision"), 1),
        ("learned, mean", speed_of("mean_learned"), 1),
    ],
}
"""Columns of each table: title, value of one run, digits."""


def cell(values: Sequence[float | None], digits: int) -> str:
    """Mean over seeds, with the smallest and the largest where they differ; runs without a value do not count."""
    known = [value for value in values if value is not None]
    if not known:
        return "–"
    texts = [f"{value:.{digits}f}" for value in (fmean(known), min(known), max(known))]
    return texts[0] if texts[1] == texts[2] else f"{texts[0]} ({texts[1]}..{texts[2]})"


def table(name: str, rows: Sequence[Row]) -> list[list[str]]:
    """The table `name` of TABLES: its heading, then one line for each scenario and selector, in their order in `rows`.

    Runs that failed are counted in the column `runs` only.
    """
    columns = TABLES[name]
    lines = [["scenario", "selector", "runs", *(title for title, _, _ in columns)]]
    for scenario, selector in dict.fromkeys((row["scenario"], row["selector"]) for row in rows):
        runs = [row for row in rows if (row["scenario"], row["selector"]) == (scenario, selector)]
        done = [row for row in runs if "failed" not in row]
        failed = len(runs) - len(done)
        cells = [cell([value(row) for row in done], digits) for _, value, digits in columns]
        lines.append([scenario, selector, f"{len(done)}{f' ({failed} failed)' if failed else ''}", *cells])
    return lines


def markdown(lines: Sequence[Sequence[str]]) -> str:
    """A table as Markdown."""
    head, *rest = lines
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, ["---"] * len(head), *rest])


def aligned(lines: Sequence[Sequence[str]]) -> str:
    """A table for a terminal: columns one below the other, one heading word a line."""
    heads = [title.split(" ") for title in lines[0]]
    height = max(map(len, heads))
    shown = [[words[i] if i < len(words) else "" for words in heads] for i in range(height)] + [*map(list, lines[1:])]
    widths = [max(len(line[k]) for line in shown) for k in range(len(heads))]
    return "\n".join("  ".join(text.rjust(w) for text, w in zip(line, widths, strict=True)) for line in shown)
