"""Machine code that comes with the package, so that a first run need not compile it.

`tools/make_machine_code.py` makes it, when the package is set up from its sources and when a wheel is built, for the
processors CPU. Where the processor, the system, numba, Python or the sources are others, kernels are compiled on the
first run, as without it. Results are the same bit by bit: LLVM neither reorders sums nor fuses products with them
unless it is told to.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numba
from llvmlite.binding import get_host_cpu_features, get_process_triple
from numba.core.caching import IndexDataCacheFile

FOLDER = Path(__file__).parents[1] / "machine_code"
CPU = "x86-64-v3"
"""Name of LLVM for what x86-64 processors from 2013 (Intel) and 2015 (AMD) on have."""
FEATURES = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
"""What CPU has and earlier processors of the architecture lack, https://gitlab.com/x86-psABIs/x86-64-ABI."""


def folder() -> Path:
    """For the present system and numba."""
    return FOLDER / f"{get_process_triple()}-numba-{numba.__version__}"


def shipped(name: str, stamp: str, key: Any) -> Any:
    """What numba's cache keeps in the files `name` for a function whose fingerprint is `stamp`, and for numba's `key`:
    types of the arguments, target (system, processor, its features), and function. None where there is nothing."""
    if not has_shipped(name):
        return None
    signature, (system, _, _), function = key
    return IndexDataCacheFile(folder(), name, stamp).load((signature, (system, CPU, ""), function))


def has_shipped(name: str) -> bool:
    """Whether there are files of that name for this machine."""
    return _suits() and (folder() / f"{name}.nbi").exists()


@cache
def _suits() -> bool:
    """Whether this processor is one of CPU, and numba is not told to compile for another one."""
    config: Any = numba.config
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return False
    host = get_host_cpu_features()
    return all(host.get(one, False) for one in FEATURES)
