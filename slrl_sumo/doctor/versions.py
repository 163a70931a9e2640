"""Versions of the installed SUMO: all parts must have one version, because moveToXY differs between releases."""

import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from lxml import etree

from slrl_sumo.doctor.finding import Finding
from slrl_sumo.errors import InputError
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.demand import net_attributes
from slrl_sumo.sumo.scenario.options import input_files
from slrl_sumo.sumo.session import library_version

SUMO_PACKAGES = ("eclipse-sumo", "libsumo", "sumolib", "traci")


def installed() -> dict[str, str]:
    """Version of each of SUMO's Python packages that is installed."""
    found = {}
    for package in SUMO_PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def home_version() -> tuple[Path, str] | None:
    """The sumo binary in the folder that SUMO_HOME names, and its version; None where there is none that answers."""
    binary = Path(os.environ.get("SUMO_HOME", "/nonexistent")) / "bin" / "sumo"
    if not os.access(binary, os.X_OK):
        return None
    try:
        printed = subprocess.run([binary, "--version"], capture_output=True, text=True, timeout=30, check=False).stdout
    except (OSError, subprocess.TimeoutExpired):
        return None
    # "Eclipse SUMO sumo 1.28.0", older ones "Eclipse SUMO sumo Version 1.20.0", nightlies "v1_20_0+0443-…".
    found = re.search(r"SUMO sumo (?:Version )?v?(\d+[._]\d+(?:[._]\d+)?)", printed)
    return (binary, found[1].replace("_", ".")) if found else None


def release(text: str) -> tuple[int, int] | None:
    """(major, minor) of a version text, None where it is none."""
    found = re.match(r"v?(\d+)[._](\d+)", text)
    return (int(found[1]), int(found[2])) if found else None


def version_findings(scenario: Scenario) -> Iterator[Finding]:
    """Whether all parts of SUMO, and the network, are of one version."""
    found, library = installed(), library_version()
    home = home_version()
    yield from version_skew(found, library, home)
    for path in input_files(scenario, "net-file"):
        try:
            network = net_attributes(path)
        except (OSError, etree.XMLSyntaxError, InputError):
            continue  # SUMO says what is wrong with it.
        made, runs = release(network.get("version", "")), release(library)
        if made and runs and made > runs:
            yield Finding(
                "warning",
                "versions",
                f"{path.name} is of version {network['version']}, newer than this SUMO {library}, which may miss parts",
                f"make it again with netconvert {library}",
            )


def version_skew(found: Mapping[str, str], library: str, home: tuple[Path, str] | None) -> Iterator[Finding]:
    """`found`: versions of SUMO's packages; `library`: what libsumo reports; `home`: SUMO_HOME's binary and version."""
    mine = release(library)
    differ = [f"{name} {text}" for name, text in found.items() if release(text) != mine]
    if differ:
        yield Finding(
            "warning",
            "versions",
            f"libsumo runs as {library}, but {', '.join(differ)} is installed; moves work differently between releases",
            f"pip install {' '.join(f'{name}=={library}' for name in SUMO_PACKAGES)}",
        )
    if home and release(home[1]) != mine:
        yield Finding(
            "warning",
            "versions",
            f"SUMO_HOME has SUMO {home[1]} ({home[0]}), libsumo is {library}: tools and plain SUMO differ from the run",
            f"unset SUMO_HOME, or point it to a SUMO {library}",
        )
