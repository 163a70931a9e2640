"""Write slrl_sumo/scene/signatures.json: which kernels usual runs call, and with which types of arguments.

    python tools/record_signatures.py

Needed after a change of a kernel's arguments; without it, the first run on a machine compiles that kernel by itself.
Those with the most machine code, which take the longest to compile, come first within each of RUNS, and kernels that
only later ones call come last.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from slrl_sumo.scene.compile_ahead import SIGNATURES, named
from slrl_sumo.scene.shipped_code import folder

Signatures = dict[str, list[list[Any]]]

RUNS = (
    {"scenario": "intersection", "agents": 16, "steps": 1},
    {"scenario": "district", "agents": 60, "takeover": "car=0.5", "steps": 20},
    {"scenario": "district", "agents": 64, "guard": True, "steps": 100},
    {"scenario": "signalised", "takeover": "car=1", "steps": 50},
    {"scenario": "intersection", "bundle": "intersection-paper", "agents": 40, "steps": 2},
)

PROGRAM = """
import json, sys
from slrl_sumo.scene.compile_ahead import spelled
from slrl_sumo.scene.compiled import _KERNELS
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings
for _ in run(RunSettings(**json.loads(sys.argv[1]))):
    pass
found = {
    f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}": [list(map(spelled, s)) for s in kernel.signatures]
    for kernel in _KERNELS
    if kernel.signatures
}
misses = sum(sum(kernel.stats.cache_misses.values()) for kernel in _KERNELS)
print(json.dumps([misses, found]))
"""


def main() -> None:
    """Write the file."""
    found: Signatures = {}
    for settings in RUNS:
        called = called_in(settings)
        for name in sorted(called, key=machine_code, reverse=True):
            known = found.setdefault(name, [])
            known += [signature for signature in called[name] if signature not in known]
    SIGNATURES.write_text(json.dumps(found, indent=1) + "\n")


def called_in(settings: dict[str, Any]) -> Signatures:
    """Kernels that a run calls from Python, with their types of arguments."""
    while True:
        command = [sys.executable, "-c", PROGRAM, json.dumps(settings)]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        misses, found = json.loads(done.stdout.splitlines()[-1])
        if not misses:  # else also what kernels call was compiled
            return dict(found)


def machine_code(name: str) -> int:
    """Size of the machine code of a kernel, bytes."""
    kept = named(name)._cache
    assert kept.filled()
    index = Path(kept._cache_file._index_path)
    files = [*index.parent.glob(f"{index.stem}.*.nbc"), *folder().glob(f"{index.stem}.*.nbc")]
    return max(file.stat().st_size for file in files)


if __name__ == "__main__":
    main()
