"""Processes of ours that hold a SUMO."""

import multiprocessing
import multiprocessing.util
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.jobs.interrupt import SIGNALS
from slrl_sumo.jobs.process import EXIT_S, WorkerProcess, started_ahead

PROGRAM = """
import ctypes, os, sys, tempfile
from slrl_sumo.jobs.process import PRINTED, set_up_process
set_up_process(sys.argv[1])
print(tempfile.gettempdir(), flush=True)
os.write(2, b"from C++")

def pages():
    return int(open("/proc/self/statm").read().split()[1])

libc = ctypes.CDLL(None)
libc.malloc.restype, libc.free.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
before = pages()
for _ in range(3):
    block = libc.malloc(16 << 20)
    ctypes.memset(block, 1, 16 << 20)
    libc.free(block)
print(pages() - before > 4000)
"""


def test_what_is_printed_and_left_behind_lies_in_its_folder_and_freed_memory_is_kept(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM, tmp_path], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
    assert (tmp_path / "printed").read_text().splitlines() == [str(tmp_path), "from C++True"]


ORPHANED = """
import os, pickle, signal, time
from slrl_sumo.jobs.process import WorkerProcess
process = WorkerProcess(pickle.dumps(time.sleep))
process.send(pickle.dumps(100))  # as deaf as libsumo while it loads
print(process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
def test_a_child_and_its_folder_end_with_a_killed_parent(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", ORPHANED], env={**os.environ, "TMPDIR": str(tmp_path)}, capture_output=True, text=True
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    child, deadline = Path("/proc") / done.stdout.strip(), time.monotonic() + EXIT_S + 10
    while (child.exists() or list(tmp_path.iterdir())) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not child.exists() or "Z" in (child / "stat").read_text().split()
    assert list(tmp_path.iterdir()) == []


def _absolute(number: int) -> int:
    process = WorkerProcess(pickle.dumps(abs))
    process.send(pickle.dumps(number))
    answer = pickle.loads(process.receive(60.0))
    process.close()
    return int(answer)


def test_workers_of_executors_start_a_child_and_those_of_a_pool_say_what_to_use() -> None:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context) as executor:
        assert executor.submit(_absolute, -3).result(60.0) == 3
    with context.Pool(1) as pool, pytest.raises(InputError, match=r"use concurrent\.futures\.ProcessPoolExecutor$"):
        pool.apply_async(_absolute, (-3,)).get(60.0)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_child_ignores_what_the_command_handles(number: signal.Signals) -> None:
    process = WorkerProcess(pickle.dumps(abs))
    try:
        os.kill(process.pid, number)
        process.send(pickle.dumps(-3))
        assert pickle.loads(process.receive(60.0)) == 3
    finally:
        process.close()


def test_an_interrupt_while_a_child_starts_ends_the_child_quietly(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system gives the signal to any thread that does not block it, and Python handles it in the main thread."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    # Shells let commands that run in the background ignore SIGINT.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    end, spawn = threading.Event(), multiprocessing.util.spawnv_passfds
    other = threading.Thread(target=end.wait)
    other.start()

    def interrupted(*arguments: Any) -> int:
        pid = int(spawn(*arguments))
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
        return pid

    try:
        WorkerProcess(pickle.dumps(abs)).close()  # the resource tracker runs from here on
        monkeypatch.setattr("multiprocessing.util.spawnv_passfds", interrupted)
        with pytest.raises(KeyboardInterrupt):
            WorkerProcess(pickle.dumps(abs))
    finally:
        end.set()
        other.join()
        signal.signal(signal.SIGINT, before)
    assert multiprocessing.active_children() == []
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""


def test_a_process_started_ahead_has_imported_the_modules_and_ends_with_the_context() -> None:
    before = set(multiprocessing.active_children())
    with started_ahead("no_such_module", "colorsys"), started_ahead("colorsys"):
        ready = [child.pid for child in set(multiprocessing.active_children()) - before]
        process = WorkerProcess(pickle.dumps(eval))
        process.send(pickle.dumps("'colorsys' in __import__('sys').modules"))
        assert pickle.loads(process.receive(60.0)) is True
        assert process.pid in ready
        process.close()
    assert set(multiprocessing.active_children()) == before
