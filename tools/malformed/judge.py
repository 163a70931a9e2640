"""Runs a command and measures it: exit code, messages, wall time, processor time and memory of all its processes."""

import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

MOST_S = 10.0
"""s of processor time until an input is refused; a command that accepts it does its ordinary work. Nothing but the
processor is waited for, and other work of the machine does not count."""
MOST_MIB = 1024
GIVE_UP_S = 300.0
"""s after which a command is killed."""
GIVE_UP_MIB = 4096
"""Memory at which it is killed, so that the machine survives."""
POLL_S = 0.05


@dataclass(frozen=True)
class Outcome:
    """What a command did."""

    code: int
    """Exit code; below 0: killed by that signal, here for taking too long or too much memory."""
    wall_s: float
    cpu_s: float
    peak_mib: float
    """Highest sum of the memory of its own of all processes of the command."""
    message: str
    """What it printed to stderr."""

    def faults(self, names: set[str]) -> list[str]:
        """What is wrong with it, in words; nothing where it is as it must be."""
        found = []
        if self.code not in (0, 1):
            found.append(f"exit code {self.code}")
        if "Traceback" in self.message:
            found.append("traceback")
        if self.code == 1:
            errors = [line for line in self.message.splitlines() if line.startswith("slrl-sumo: ")]
            if len(errors) != 1:
                found.append(f"{len(errors)} lines of error")
            elif self.message.rstrip().splitlines()[-1] != errors[0]:
                found.append("more lines behind the error")
            elif not any(name in errors[0] for name in names):
                found.append("no file named")
        if self.code == 1 and self.cpu_s > MOST_S:
            found.append(f"{self.cpu_s:.1f} s of processor time")
        if self.wall_s > GIVE_UP_S:
            found.append(f"given up after {self.wall_s:.0f} s")
        if self.peak_mib > MOST_MIB:
            found.append(f"{self.peak_mib:.0f} MiB")
        return found


def run(words: tuple[str, ...], folder: Path) -> Outcome:
    """Run `slrl-sumo` with these words in a folder."""
    command = [sys.executable, "-m", "slrl_sumo", *words]
    temporary = folder / "tmp"
    temporary.mkdir(exist_ok=True)
    environment = {**os.environ, "TMPDIR": str(temporary), "COLUMNS": "200", "PYTHONPATH": _here()}
    begin = time.monotonic()
    peak = 0.0
    with (folder / "stderr").open("wb") as err:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=err,
            start_new_session=True,
            preexec_fn=_no_core,
        )
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            if pid:
                break
            peak = max(peak, _memory(process.pid))
            if time.monotonic() - begin > GIVE_UP_S or peak > GIVE_UP_MIB:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
            time.sleep(POLL_S)
        process.returncode = os.waitstatus_to_exitcode(status)
    wall = time.monotonic() - begin
    with suppress(ProcessLookupError):  # children that outlive it
        os.killpg(process.pid, signal.SIGKILL)
    message = (folder / "stderr").read_text(errors="replace")
    return Outcome(process.returncode, wall, usage.ru_utime + usage.ru_stime, peak, message)


def _here() -> str:
    return str(Path(__file__).parents[2])


def _no_core() -> None:
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _memory(session: int) -> float:
    """MiB of memory of their own (not shared with files) of all processes of a session."""
    total = 0
    for entry in os.scandir("/proc"):
        if not entry.name.isdigit():
            continue
        with suppress(OSError, ValueError, IndexError):
            # pid (name) state ppid pgrp session: the name may hold blanks.
            if int(Path(entry.path, "stat").read_text().rpartition(")")[2].split()[3]) != session:
                continue
            for line in Path(entry.path, "status").read_text().splitlines():
                if line.startswith("RssAnon:"):
                    total += int(line.split()[1])
    return total / 1024
