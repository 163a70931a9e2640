"""Machine code that is part of the package, so that a first run need not compile.

`tools/make_machine_code.py` makes it for the processors CPU, when the package is set up from its sources and when a
wheel is built. For another processor, system, version of numba or Python, or other sources, the first run compiles the
kernels. Results are identical to the bit: by default, LLVM neither reorders sums nor fuses multiplications and
additions.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numba
from llvmlite.binding import get_host_cpu_features, get_process_triple
from numba.core.caching import IndexDataCacheFile

FOLDER = Path(__file__).parents[1] / "machine_code"
CPU = "x86-64-v3"
"""LLVM's name of the features of x86-64 processors from 2013 (Intel) and 2015 (AMD) on."""
FEATURES = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
"""Features of CPU that earlier processors of the architecture lack, https://gitlab.com/x86-psABIs/x86-64-ABI."""


def folder() -> Path:
    """Folder of the machine code for the present system and version of numba."""
    return FOLDER / f"{get_process_triple()}-numba-{numba.__version__}"


def shipped(name: str, stamp: str, key: Any) -> Any:
    """The entry of numba's cache in the files `name` for a function with the fingerprint `stamp`; None without one.

    `key`: numba's key of types of the arguments, target (system, processor, its features), and function.
    """
    if not has_shipped(name):
        return None
    signature, (system, _, _), function = key
    return IndexDataCacheFile(folder(), name, stamp).load((signature, (system, CPU, ""), function))


def has_shipped(name: str) -> bool:
    """Whether files of this name exist for this machine."""
    return _suits() and (folder() / f"{name}.nbi").exists()


@cache
def _suits() -> bool:
    """Whether this processor has the features of CPU, and numba is not configured for another processor."""
    config: Any = numba.config
    if config.CPU_NAME is not None or config.CPU_FEATURES is not None:
        return False
    host = get_host_cpu_features()
    return all(host.get(one, False) for one in FEATURES)
