"""Vaporizers, which libsumo does not list: they are read from the additional files."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from lxml import etree

from slrl_sumo.sumo.scenario.demand import elements

OPTIONS = ("additional-files", "configuration-file")


def vaporized_edges(additional_files: str, configuration: str) -> frozenset[str]:
    """The edges with a vaporizer, with the values that SUMO has for OPTIONS ('' where not given).

    Files that cannot be read here are left out: over TraCI, SUMO may run in another folder or on another machine.
    """
    edges, pending = set[str](), list(_paths(additional_files, configuration))
    while pending:
        file = pending.pop()
        try:
            for element in elements(file):
                for item in element.iter("vaporizer", "include"):
                    if item.tag == "include":
                        pending.append(file.parent / item.get("href", ""))
                    else:
                        edges.add(item.get("id", ""))
        except (OSError, etree.XMLSyntaxError):
            continue
    return frozenset(edges)


def _paths(files: str, configuration: str) -> Iterator[Path]:
    """SUMO writes the configuration's folder before all that is no absolute path there, spaces and ${VARIABLES} too."""
    folder = configuration[: max(configuration.rfind(slash) for slash in r"\/") + 1]
    for item in re.split("[,;]", files):
        own = item.removeprefix(folder)
        if own.strip():
            yield Path(folder if own != item else "") / os.path.expandvars(own.strip())
