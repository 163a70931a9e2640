"""A finding about a scenario."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Severity = Literal["ok", "note", "warning", "problem"]


@dataclass(frozen=True)
class Finding:
    """A finding about a scenario that matters to a run with learned road users.

    `problem`: the run would be refused or would end with SUMO's error; `warning`: results may mislead; `note`: the run
    changes or handles it; `ok`: good to know.
    """

    severity: Severity
    topic: str
    what: str
    fix: str


def counted(number: int, one: str, many: str) -> str:
    """'1 person' or '3 persons'."""
    return f"{number} {one if number == 1 else many}"


def some(names: Sequence[str], most: int = 3) -> str:
    """The first few of many names."""
    return ", ".join(names[:most]) + (", …" if len(names) > most else "")
