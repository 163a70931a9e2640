"""What libsumo does not tell, from the files that SUMO has loaded: vaporizers, from where stops have an <access>,
where vehicles end on their last edge, and on which lanes they may overtake on the opposite one."""

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
"""Bytes of a file that are searched at once."""


def vaporized_edges(additional_files: str, configuration: str) -> frozenset[str]:
    """The edges with a vaporizer; the arguments are what SUMO has for ADDITIONAL and CONFIGURATION, '' if nothing."""
    found = _loaded(additional_files, configuration, frozenset({"vaporizer"}), b"vaporizer")
    return frozenset(item.get("id", "") for item in found)


def edges_of_access(additional_files: str, configuration: str) -> dict[str, frozenset[str]]:
    """By id of the stops that have an <access>: the edges that these are on. Arguments as of `vaporized_edges`."""
    found: dict[str, frozenset[str]] = {}
    for item in _loaded(additional_files, configuration, frozenset({"access"}), b"<access"):
        stop = item.getparent()
        if stop is not None:
            edge = item.get("lane", "").rpartition("_")[0]
            found[stop.get("id", "")] = found.get(stop.get("id", ""), frozenset()) | {edge}
    return found


def overtaking_lanes(net_files: str) -> tuple[str, ...]:
    """The lanes outside junctions with a `<neigh>`, the opposite lane on which SUMO's vehicles overtake; `net_files`:
    paths, comma-separated."""
    found = _loaded(net_files, "", frozenset({"neigh"}), b"<neigh")
    lanes = (parent.get("id", "") for item in found if (parent := item.getparent()) is not None)
    return tuple(lane for lane in lanes if not lane.startswith(":"))


def arrival_positions(additional_files: str, route_files: str, configuration: str) -> dict[str, float]:
    """By id of vehicles, trips and flows that have one: `arrivalPos`, m along the lane, below 0 from its end; left out
    where it is drawn at random. Values of the options as of `vaporized_edges`."""
    found = {}
    for files in (additional_files, route_files):
        for item in _loaded(files, configuration, VEHICLES, b"arrivalPos"):
            try:
                found[item.get("id", "")] = float(item.get("arrivalPos", "max"))
            except ValueError:
                continue
    return found


def _loaded(files: str, configuration: str, tags: frozenset[str], word: bytes) -> Iterator[etree._Element]:
    """The elements with these tags in SUMO's `files`, and in those that they include, if they have the `word`.

    Files that cannot be read here are left out: over TraCI, SUMO may run in another folder or on another machine.
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
    """Whether a file, plain or gzipped, has one of some short words: files of routes may be large."""
    with open_xml(file) as stream:
        before = b""
        while chunk := stream.read(SEARCHED_BYTES):
            if any(word in before + chunk for word in words):
                return True
            before = chunk[-32:]
    return False


def _paths(files: str, configuration: str) -> Iterator[Path]:
    """SUMO writes the configuration's folder before all that is no absolute path there, spaces and ${VARIABLES} too."""
    folder = configuration[: max(configuration.rfind(slash) for slash in r"\/") + 1]
    for item in re.split("[,;]", files):
        own = item.removeprefix(folder)
        if own.strip():
            yield Path(folder if own != item else "") / os.path.expandvars(own.strip())
