"""Kills: commands that are ended by signals at random times, and what they leave behind.

    python -m tools.kills --kills 50 --seed 1 --json kills.json
    python -m tools.kills --seed 1 --only 17     # one kill again

Kill NUMBER of a seed is always the same: `run`, `record`, `evaluate` or `train`, ended by SIGTERM, SIGINT, SIGHUP,
SIGKILL or SIGSEGV, sent to the command, to the process that holds SUMO or to both, while it loads or while it works. A
command that survives gets a SIGTERM 2 s later. Failures: an exit code or a message other than documented
(docs/reference/files.md), outputs that are neither absent nor complete up to the last whole step, processes that live
10 s longer than the command, and files that are left in the temporary folder. Exit code 1 if there was any failure.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import torch

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.table import read_table
from slrl_sumo.formats.trajectory_file import load_trajectories

AGENTS = 8
SIGNALS = ("TERM", "INT", "HUP", "KILL", "SEGV")
POLITE = ("TERM", "INT", "HUP")
COMMANDS = {
    "run": "run intersection --agents 8 --steps 1000000 --quiet --summary s.json --fcd",
    "record": "record intersection --seconds 1000000 --out r.npz",
    "evaluate": "evaluate intersection --bundle intersection --agents 4 --steps 8 --episodes 100000 --out e",
    "train": "train intersection --bundle intersection --steps 100000 --workers 1 --config ../quick.toml --out b",
}
FIRST = {"record": "tmp/*/printed", "evaluate": "out/e/episodes.jsonl", "train": "out/b-training/checkpoint.pt"}
"""What a command writes first, apart from `run`, which begins with its trace."""
QUICK = "[networks]\ncount = 1\n[imitation]\nepochs = 0\n"
"""Settings of a training that soon has processes with SUMO."""
LOADING_S, WORKING_S, FIRST_S = 5.0, 4.0, 60.0
"""s: latest signal while loading; latest signal after the first output; longest wait for that output."""
ORPHAN_S, HANG_S = 10.0, 90.0


class Command:
    """A command with folders of its own for outputs and temporary files."""

    def __init__(self, words: list[str], folder: Path) -> None:
        self.out, self.temporary = folder / "out", folder / "tmp"
        for made in (self.out, self.temporary):
            made.mkdir()
        (folder / "quick.toml").write_text(QUICK)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "slrl_sumo", *words],
            cwd=self.out,
            env={**os.environ, "TMPDIR": str(self.temporary)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def family(self) -> list[int]:
        """All its living processes, found by their temporary folder, including processes with a dead parent."""
        mark, found = f"TMPDIR={self.temporary}\0".encode(), []
        for process in Path("/proc").glob("[0-9]*"):
            try:
                if mark in (process / "environ").read_bytes():
                    found.append(int(process.name))
            except OSError:  # it has ended meanwhile
                continue
        return found

    def children(self) -> list[int]:
        """Its processes that hold SUMO, or will."""
        return [
            pid
            for pid in self.family()
            if pid != self.process.pid and b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
        ]

    def send(self, number: int, target: str) -> bool:
        """Send a signal; whether there was a process to receive it."""
        targets = self.children() if target != "parent" else []
        targets += [self.process.pid] if target != "child" else []
        for pid in targets:
            os.kill(pid, number)
        return bool(targets)


def one(seed: int, number: int) -> dict[str, Any]:
    """Kill `number` of a seed."""
    random = Random(f"kills-{seed}-{number}")
    name = random.choice(("run", "run", "run", "record", "evaluate", "train"))
    words = COMMANDS[name].split()
    if name == "run":
        words.append(f"a{random.choice(('.xml', '.xml.gz', '.csv', '.parquet'))}")
        words += random.choice(([], [], ["--report", "pictures"]))
    kind, target = random.choice(SIGNALS), random.choice(("parent", "child", "both"))
    loading, share = random.random() < 0.4, random.random()
    with tempfile.TemporaryDirectory(prefix="kills_") as folder:
        command = Command(words, Path(folder))
        try:
            row = {"signal": kind, "target": target} | _killed(
                command, kind, target, f"out/{_trace(words)}" if name == "run" else FIRST[name], loading, share
            )
            row["failures"] = list(_failures(command, words, row))
        finally:
            command.process.kill()
            for pid in command.family():
                os.kill(pid, signal.SIGKILL)
    when = "loading" if loading else "working"
    return {"number": number, "command": " ".join(words), "when": when, **row}


def _killed(command: Command, kind: str, target: str, first: str, loading: bool, share: float) -> dict[str, Any]:
    """Send the signal, wait for the end, and note both."""
    begin = time.monotonic()
    if not loading:
        while not list(command.out.parent.glob(first)) and time.monotonic() < begin + FIRST_S:
            time.sleep(0.05)
    time.sleep(share * (LOADING_S if loading else WORKING_S))
    while not command.send(signal.Signals[f"SIG{kind}"], target) and command.process.poll() is None:
        time.sleep(0.05)
    sent, survived = time.monotonic(), False
    if target == "child":
        try:
            command.process.wait(2.0)
        except subprocess.TimeoutExpired:
            survived = True
            command.send(signal.SIGTERM, "parent")
    try:
        _, errors = command.process.communicate(timeout=HANG_S)
    except subprocess.TimeoutExpired:
        command.process.kill()
        _, errors = command.process.communicate()
        errors += "\nhang"
    ended = time.monotonic()
    while command.family() and time.monotonic() < ended + ORPHAN_S:
        time.sleep(0.1)
    code = command.process.returncode
    return {"survived": survived, "code": code, "errors": errors, "after_s": round(ended - sent, 2)}


def _failures(command: Command, words: list[str], row: dict[str, Any]) -> Iterator[str]:
    """What is not as documented."""
    if orphans := command.family():
        yield f"{len(orphans)} processes live on"
    # PyTorch keeps a cache of its compiler there.
    left = [path.name for path in command.temporary.iterdir() if not path.name.startswith("torchinductor_")]
    if left:
        yield f"left in the temporary folder: {', '.join(left)}"
    errors, code = row["errors"], row["code"]
    if "Traceback" in errors or "hang" in errors:
        yield errors.strip().splitlines()[-1]
    hard = code in (-signal.SIGKILL, -signal.SIGSEGV)  # the command itself was killed
    if code not in (expected := expected_codes(row["signal"], row["target"], row["survived"])):
        yield f"exit code {code}, not {' or '.join(map(str, expected))}: {errors.strip()}"
    files = sorted(path.name for path in command.out.iterdir())
    if parts := [name for name in files if name.startswith(".") and not hard]:
        yield f"unfinished files: {', '.join(parts)}"
    try:
        if words[0] == "run":
            yield from wrong_run(command.out, words, errors, code, hard)
        elif (command.out / "r.npz").exists():
            load_trajectories(command.out / "r.npz")
        else:
            _read_learning(command.out, hard)
    except Exception as error:  # whatever is wrong with an output is a failure
        yield f"invalid output: {type(error).__name__}: {error}"


def expected_codes(kind: str, target: str, survived: bool) -> set[int]:
    """Exit codes that are documented."""
    number = int(signal.Signals[f"SIG{kind}"])
    if survived:  # a run may be writing its report
        return {128 + signal.SIGTERM} | (set() if kind in POLITE else {3, 1})
    if target != "child":
        # Before the command has begun, Python itself dies of the signal.
        return {-number} if kind not in POLITE else {128 + number, -number}
    # SUMO's death; while it loads, a segmentation fault is one of the input.
    return {3, 1} if kind == "SEGV" else {3}


def wrong_run(out: Path, words: list[str], errors: str, code: int, hard: bool) -> Iterator[str]:
    """What is wrong with the outputs of a run."""
    trace, summary = out / _trace(words), out / "s.json"
    figures = json.loads(summary.read_text()) if summary.exists() else None
    if not trace.exists():
        if figures is not None:
            yield "a summary without a trace"
        if code == 3 and "no output was written" not in errors:
            yield f"message: {errors.strip()}"
        return
    if trace.suffix == ".parquet" and hard:
        return  # documented: unreadable
    table, flaw = read_table(trace)
    if flaw is not None and not hard:
        yield f"the trace is cut off: {flaw}"
    times = np.array(table.steps) / 1000
    if not np.allclose(np.diff(times), 0.4):
        yield "steps are missing in the trace"
    learned = [id.startswith("learned_") for id, _ in table.users]
    count = np.bincount(np.array(table.step), weights=np.array(learned)[np.array(table.key)], minlength=len(times))
    if set(count.tolist()) != {AGENTS}:
        yield f"learned road users in the steps of the trace: {set(count.tolist())}"
    if hard:
        return
    if figures is None:
        yield "no summary"
    elif not figures["interrupted"] or figures["end_s"] != times[-1] or len(times) != figures["decisions"] + 1:
        yield f"summary: {figures['ended_by']} at {figures['end_s']}, trace up to {times[-1]}"
    if "--report" in words and not (out / "pictures" / "report.html").exists():
        yield "no report"
    if code == 3 and f"complete up to there: {_trace(words)}" not in errors:
        yield f"message: {errors.strip()}"


def _read_learning(out: Path, hard: bool) -> None:
    """Read what `evaluate` and `train` have written; raises where that is not possible."""
    for log in out.glob("e/*.jsonl"):
        *lines, last = log.read_text().split("\n")
        for line in lines + ([last] if last and not hard else []):
            json.loads(line)
    for file in out.glob("b-training/*.json"):
        json.loads(file.read_text())
    if (checkpoint := out / "b-training" / "checkpoint.pt").exists():
        torch.load(checkpoint, weights_only=True)
    if (out / "b").exists() or (out / "e" / "results.json").exists():
        raise InputError("results of a command that did not end")


def _trace(words: list[str]) -> str:
    return words[words.index("--fcd") + 1]


def report(rows: list[dict[str, Any]]) -> None:
    """Print a table by command and signal, and the failures."""
    print("| signal | to the command | to its child | to both | failures |\n|---|---|---|---|---|")
    for kind in SIGNALS:
        mine = [row for row in rows if row["signal"] == kind]
        sent = Counter(row["target"] for row in mine)
        wrong = sum(bool(row["failures"]) for row in mine)
        print(f"| SIG{kind} | {sent['parent']} | {sent['child']} | {sent['both']} | {wrong} |")
    for row in rows:
        for failure in row["failures"]:
            print(f"{row['number']}: {row['command']}: {row['signal']} to {row['target']} ({row['when']}): {failure}")


def main() -> None:
    """Kill, check, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, help="this kill alone")
    parser.add_argument("--json", type=Path, help="all kills, one by one")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGHUP):  # where they are ignored, as under nohup, commands would ignore them
        signal.signal(number, lambda *_: sys.exit(1))
    rows: list[dict[str, Any]] = []
    numbers = range(options.kills) if options.only is None else [options.only]
    with ThreadPoolExecutor(options.workers) as pool:
        for row in pool.map(lambda number: one(options.seed, number), numbers):
            rows.append(row)
            text = ", ".join(row["failures"]) or "ok"
            print(f"{row['number']}: {row['command'][:40]} {row['signal']} {row['target']}: {text}", file=sys.stderr)
            if options.json is not None:
                options.json.write_text(json.dumps({"kills": rows}, indent=1) + "\n")
    report(rows)
    sys.exit(any(row["failures"] for row in rows))


if __name__ == "__main__":
    main()
