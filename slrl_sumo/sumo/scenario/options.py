"""Options of a scenario's configuration, interpreted as in SUMO."""

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from slrl_sumo.errors import InputError
from slrl_sumo.sumo.scenario.configuration import Scenario

SYNONYMS = {
    "net-file": ("net", "n"),
    "route-files": ("routes", "r"),
    "additional-files": ("additional", "a"),
    "begin": ("b",),
    "end": ("e",),
}
"""Synonyms that SUMO accepts in a configuration (`sumo --save-template`)."""

LOG_OPTIONS = ("log", "message-log", "error-log")

YES = ("true", "1", "yes", "on", "x", "t")


def option(scenario: Scenario, name: str) -> str | None:
    """The value of an option under any of its names; None if it is not set."""
    return next((scenario.options[key] for key in (name, *SYNONYMS.get(name, ())) if key in scenario.options), None)


def switched_on(scenario: Scenario, name: str) -> bool:
    """Whether a Boolean option is set to true."""
    return (option(scenario, name) or "false").lower() in YES


def with_options(scenario: Scenario, words: Sequence[str]) -> Scenario:
    """The scenario with options added in the form of SUMO's command line: --name value, --name=value, or --name.

    They override the options of the file; SUMO checks their names when it starts. Raises InputError if `words` name
    another scenario or are no options.
    """
    full = {short: name for name, shorts in SYNONYMS.items() for short in shorts} | {"srand": "seed"}
    added: dict[str, str] = {}
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if not re.match(r"--?[A-Za-z]", word):
            raise InputError(f"'{word}' is no option of SUMO; write --name value", argument="sumo_options")
        name, equals, value = word.lstrip("-").partition("=")
        if not equals:
            # Options begin with a letter after the dashes: -1 is a value.
            value = rest.pop(0) if rest and not re.match(r"--?[A-Za-z]", rest[0]) else "true"
        if name in ("c", "configuration", "configuration-file"):
            raise InputError(
                f"{word} names another scenario; give that in place of {scenario.config}", argument="sumo_options"
            )
        added[full.get(name, name)] = value
    return replace(scenario, options={**scenario.options, **added}, added={**scenario.added, **added})


def is_output(name: str) -> bool:
    """Whether an option names a file that SUMO writes."""
    return name.endswith("-output") or name in ("summary", "tripinfo", "netstate-dump", *LOG_OPTIONS)


def named_files(scenario: Scenario) -> list[Path]:
    """The configuration, and the existing files and output files that it names."""
    files = [scenario.config]
    for name, value in scenario.options.items():
        # Paths in the configuration are relative to its folder, paths on the command line to the current folder.
        folder = Path() if name in scenario.added else scenario.config.parent
        for item in (item.strip() for item in re.split("[,;]", value)):
            path = folder / os.path.expandvars(item)
            if is_output(name):
                files.append(path.with_name(scenario.options.get("output-prefix", "") + path.name) if item else path)
            elif item and os.path.isfile(path):
                files.append(path)
    return files


def input_files(scenario: Scenario, name: str) -> list[Path]:
    """The files that an option lists; relative paths start at the configuration's folder, as in SUMO."""
    names = [item.strip() for item in re.split("[,;]", option(scenario, name) or "")]
    return [scenario.config.parent / os.path.expandvars(item) for item in names if item]
