"""SUMO's command line programs, run in a folder of their own."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import sumolib

from slrl_sumo.netgen.errors import NetgenError

_TIME_LIMIT = 300.0


def binary(name: str) -> str:
    """Path of SUMO's program `name`; that of the eclipse-sumo wheel before any other, so that versions agree.

    Raises NetgenError if there is none.
    """
    try:
        import sumo

        home = getattr(sumo, "SUMO_HOME", "")
    except ImportError:
        home = ""
    found: str | None = shutil.which(sumolib.checkBinary(name, bindir=os.path.join(home, "bin")))
    if found is None:
        raise NetgenError(f"SUMO's program {name} was not found: pip install eclipse-sumo, or set SUMO_HOME")
    return found


def run_program(name: str, arguments: Sequence[str], folder: Path) -> None:
    """Run SUMO's program `name` in `folder`; raises NetgenError with its first error line when it fails."""
    command = [binary(name), *arguments]
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=_TIME_LIMIT, check=False)
    except (OSError, subprocess.TimeoutExpired) as e:
        raise NetgenError(f"{name} did not run: {e}") from e
    if done.returncode != 0:
        lines = [line for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        said = next((line for line in lines if line.startswith("Error")), lines[0] if lines else "no message")
        raise NetgenError(f"{name} failed (exit code {done.returncode}): {said.strip()}")
