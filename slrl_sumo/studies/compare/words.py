"""Texts on a comparison that its page, its picture and its printed table share."""

from typing import Any

from slrl_sumo.studies.compare.run import LEARNED, SUMO
from slrl_sumo.studies.compare.verdicts import too_few


def arms(result: dict[str, Any]) -> tuple[str, str]:
    """The keys of the two arms of a result in its rows."""
    first, second = result.get("traces", (SUMO, LEARNED))
    return first, second


def arm_names(result: dict[str, Any]) -> tuple[str, str]:
    """What the two arms are: names of files for traces."""
    first, second = result["traces"].values() if "traces" in result else ("SUMO's own models", "learned")
    return first, second


def title(result: dict[str, Any]) -> str:
    """Of the whole comparison."""
    if "traces" in result:
        return " and ".join(arm_names(result))
    return f"{result['scenario']}: SUMO's own models and {result['bundle']}"


def lead(result: dict[str, Any]) -> str:
    """Description of the comparison, in one line."""
    if "traces" in result:
        spans = "; ".join(
            f"{arm}: {name}, {begin:g} to {end:g} s"
            for (arm, name), (begin, end) in zip(result["traces"].items(), result["spans_s"].values(), strict=True)
        )
        return f"traces on {result['network']}; {spans}"
    seeds = len(result["seeds"])
    return (
        f"{result['seconds']:g} s, {seeds} seed{'s' * (seeds > 1)}, selector {result['selector']}"
        f"{' with guard' * result['guard']}; taken over: {result['takeover']}"
    )


def percent(row: dict[str, Any], first: str) -> str:
    """The difference of a row as a share of the first arm; '–' if the first arm is 0."""
    return f"{100.0 * row['difference'] / abs(row[first]):+.0f}" if row[first] else "–"


def caveat(result: dict[str, Any]) -> str:
    """Limits of the figures; '' without any."""
    if "traces" in result:
        return (
            "Two runs differ by chance, too, and one trace of each does not tell how much: "
            "compare a scenario with several seeds for that."
        )
    return too_few(result["rows"], len(result["seeds"]))
