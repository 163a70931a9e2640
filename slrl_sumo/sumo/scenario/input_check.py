"""Checks of the XML files of a scenario, before SUMO reads them.

SUMO waits for the writer of a pipe, follows files that include themselves until it crashes, and unpacks and expands any
content.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from slrl_sumo.errors import InputError
from slrl_sumo.input_files import CHUNK, open_xml, refusal
from slrl_sumo.sumo.scenario.configuration import Scenario
from slrl_sumo.sumo.scenario.options import input_files

XML_INPUTS = ("net-file", "additional-files", "route-files", "weight-files", "lane-weight-files", "load-state")
MAX_INCLUDED = 1000
"""Greatest number of files that a file may include, directly and through others: each may include the next file
twice."""

_INCLUDE = re.compile(rb"""<include\s[^<>]*?href\s*=\s*(?:"([^"<]*)"|'([^'<]*)')""")
MAX_DEPTH = 1000
"""Greatest nesting depth of elements: SUMO's files have 6; with 100,000, SUMO takes more than several minutes."""
_TAG = 4096
"""Greatest length (bytes) of an <include> that is followed."""


def check_inputs(scenario: Scenario) -> None:
    """Raise InputError for the first file of the scenario that SUMO must not read; SUMO reports missing files."""
    for path, reason in unusable_inputs(scenario):
        raise InputError(f"{scenario.config}: {path}: cannot be read ({reason})")


def unusable_inputs(scenario: Scenario) -> Iterator[tuple[Path, str]]:
    """The files of the scenario that SUMO must not read, and the reasons."""
    for name in XML_INPUTS:
        for path in input_files(scenario, name):
            if (reason := _fault(path)) is not None:
                yield path, reason


def _fault(path: Path) -> str | None:
    pending: list[tuple[Path, tuple[Path, ...]]] = [(path, ())]
    count = 0
    while pending:
        file, above = pending.pop()
        named = "" if file == path else f"{file}: "
        real = Path(os.path.realpath(file))  # Path.resolve raises where a link leads to itself
        if real in above:
            return f"{above[-1]} includes {file.name}, which includes it; remove that <include>"
        count += 1
        if count > MAX_INCLUDED:
            return f"it includes more than {MAX_INCLUDED} files; write them into one"
        try:
            pending += [(file.parent / href, (*above, real)) for href in _included(file)]
        except FileNotFoundError:
            continue
        except OSError as error:
            return f"{named}{error.strerror or error}"
    return None


def _included(file: Path) -> list[str]:
    found: list[str] = []
    before, depth = b"", 0
    with open_xml(file) as stream:
        while block := stream.read(CHUNK):
            closing = block.count(b"</")
            # The number of elements that are open at the end of the block; elements cut by its borders cause small
            # errors.
            others = closing + block.count(b"<!") + block.count(b"<?")
            depth += block.count(b"<") - others - closing - block.count(b"/>")
            if depth > MAX_DEPTH:
                raise refusal(f"its elements are nested more than {MAX_DEPTH} deep")
            text = before + block
            place = 0
            # Nearly all files have no <include>: searching the word is ten times faster than the regular expression.
            if b"<include" in text:
                for tag in _INCLUDE.finditer(text):
                    found.append((tag[1] or tag[2] or b"").decode(errors="replace"))
                    place = tag.end()
            before = text[max(place, len(text) - _TAG) :]
    return found
