"""Data from the files that SUMO has loaded, which libsumo does not provide: vaporizers, edges with an <access> to
stops, arrival positions of vehicles, and lanes with overtaking on the opposite lane."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from lxml import etree

from slrl_sumo.input_files import open_xml
from slrl_sumo.sumo.scenario.demand import VEHICLES, elements

ADDITIONAL, ROUTES, CONFIGURATION = "additional-files", "route-files", "configuration-file"
"""Options of SUMO."""
SEARCHED_BYTES = 1 << 20
"""Number of bytes of a file that are searched at once."""


def vaporized_edges(additional_files: str, configuration: str) -> frozenset[str]:
    """The edges with a vaporizer; the arguments are SUMO's values of ADDITIONAL and CONFIGURATION, '' if not set."""
    found = _loaded(additional_files, configuration, frozenset({"vaporizer"}), b"vaporizer")
    return frozenset(item.get("id", "") for item in found)


def edges_of_access(additional_files: str, configuration: str) -> dict[str, frozenset[str]]:
    """For each stop with an <access>, by id, the edges of its accesses. Arguments: see `vaporized_edges`."""
    found: dict[str, frozenset[str]] = {}
    for item in _loaded(additional_files, configuration, frozenset({"access"}), b"<access"):
        stop = item.getparent()
        if stop is not None:
            edge = item.get("lane", "").rpartition("_")[0]
            found[stop.get("id", "")] = found.get(stop.get("id", ""), frozenset()) | {edge}
    return found


def overtaking_lanes(net_files: str) -> tuple[str, ...]:
    """The lanes outside junctions with a `<neigh>`, an opposite lane on which SUMO's vehicles overtake.

    `net_files`: paths, comma-separated.
    """
    found = _loaded(net_files, "", frozenset({"neigh"}), b"<neigh")
    lanes = (parent.get("id", "") for item in found if (parent := item.getparent()) is not None)
    return tuple(lane for lane in lanes if not lane.startswith(":"))


def arrival_positions(additional_files: str, route_files: str, configuration: str) -> dict[str, float]:
    """The `arrivalPos` (m along the lane, negative from its end) of vehicles, trips and flows, by id.

    Entries without a number, such as random positions, are left out. Arguments: see `vaporized_edges`.
    """
    found = {}
    for files in (additional_files, route_files):
        for item in _loaded(files, configuration, VEHICLES, b"arrivalPos"):
            try:
                found[item.get("id", "")] = float(item.get("arrivalPos", "max"))
            except ValueError:
                continue
    return found


def _loaded(files: str, configuration: str, tags: frozenset[str], word: bytes) -> Iterator[etree._Element]:
    """The elements with these tags in SUMO's `files`, and in the files that they include, if a file has the `word`.

    Unreadable files are skipped: over TraCI, SUMO may run in another folder or on another machine.
    """
    pending = list(_paths(files, configuration))
    while pending:
        file = pending.pop()
        try:
            if not _has(file, word, b"<include"):
                continue
            for element in elements(file):
                for item in element.iter("include", *tags):
                    if item.tag == "include":
                        pending.append(file.parent / item.get("href", ""))
                    else:
                        yield item
        except (OSError, etree.XMLSyntaxError):
            continue


def _has(file: Path, *words: bytes) -> bool:
    """Whether a file, plain or gzipped, contains any of some short words; route files may be large."""
    with open_xml(file) as stream:
        before = b""
        while chunk := stream.read(SEARCHED_BYTES):
            if any(word in before + chunk for word in words):
                return True
            before = chunk[-32:]
    return False


def _paths(files: str, configuration: str) -> Iterator[Path]:
    """The paths of an option. SUMO prepends the configuration's folder to relative paths, also before spaces and
    ${VARIABLES}."""
    folder = configuration[: max(configuration.rfind(slash) for slash in r"\/") + 1]
    for item in re.split("[,;]", files):
        own = item.removeprefix(folder)
        if own.strip():
            yield Path(folder if own != item else "") / os.path.expandvars(own.strip())
