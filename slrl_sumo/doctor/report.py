"""The findings of `doctor` as a table and as JSON."""

from collections.abc import Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from slrl_sumo.doctor.finding import Finding
from slrl_sumo.jobs.tables import print_table

LOG_WIDTH = 160
"""Columns of a table that is not printed to a terminal."""

COLOURS = {"problem": "bold red", "warning": "yellow", "note": "cyan", "ok": "green"}


def findings_table(findings: Sequence[Finding]) -> Table:
    """One row a finding, all text in full."""
    table = Table(box=SIMPLE_HEAD, leading=1, expand=True)
    table.add_column("severity", no_wrap=True)
    table.add_column("topic", overflow="fold", min_width=10)
    table.add_column("what", overflow="fold", ratio=3)
    table.add_column("fix", overflow="fold", ratio=2)
    for finding in findings:
        severity = Text(finding.severity, style=COLOURS[finding.severity])
        # Text, because ids may contain characters that rich reads as markup.
        table.add_row(severity, Text(finding.topic), Text(finding.what), Text(finding.fix))
    return table


def print_findings(findings: Sequence[Finding]) -> None:
    """Print the table on stdout."""
    print_table(findings_table(findings), LOG_WIDTH)


def findings_record(scenario: str, findings: Sequence[Finding]) -> dict[str, Any]:
    """The findings as JSON-ready data: scenario, can_run, findings of severity, topic, what and fix."""
    return {
        "scenario": scenario,
        "can_run": not any(finding.severity == "problem" for finding in findings),
        "findings": [{"severity": f.severity, "topic": f.topic, "what": f.what, "fix": f.fix} for f in findings],
    }
