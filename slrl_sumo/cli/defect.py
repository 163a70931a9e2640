"""The file that a user can send to the authors when a command fails by a defect of this package."""

import os
import platform
import shlex
import sys
import tempfile
import time
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from slrl_sumo.errors import DefectError
from slrl_sumo.version import __version__

REPORTED_PACKAGES = ("eclipse-sumo", "libsumo", "numpy", "torch", "numba", "ray")


def write_defect(defect: DefectError) -> str:
    """Write what is needed to find a defect: the command, versions and the traceback. Returns how to name the file.

    The file goes into the current folder, where it is found again; into the temporary folder where that is read-only.
    """
    text = "\n".join(
        [
            str(defect),
            f"command: {shlex.join(['slrl-sumo', *sys.argv[1:]])}",
            f"slrl_sumo {__version__}, Python {platform.python_version()}, {platform.platform()}",
            *(f"{package} {_version(package)}" for package in REPORTED_PACKAGES),
            "",
            defect.details,
        ]
    )
    name = f"slrl-sumo-defect-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}.txt"
    for folder in (Path.cwd, lambda: Path(tempfile.gettempdir())):
        with suppress(OSError):  # read-only, full, or removed meanwhile
            file = folder() / name
            file.write_text(text)
            return f"{file}, which holds the traceback"
    return f"this traceback (no file could be written): {defect.details}"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "-"
