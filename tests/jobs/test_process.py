"""Processes of ours that hold a SUMO."""

import subprocess
import sys
from pathlib import Path

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
