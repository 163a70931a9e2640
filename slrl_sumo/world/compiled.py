"""Inner loops that numba compiles to machine code, once per machine."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from numba import njit

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """`function`, plain loops over numbers and numpy arrays, as machine code that is kept for the next process.

    Numba keeps it next to the module, or in the user's cache folder, until that file changes. It does not look at other
    files: so a compiled function uses functions and constants of its own module only, and is given the others as
    arguments (tests/world/test_compiled.py sees to it). Divisions by zero give inf or nan as in numpy; there are no
    bounds checks, so indices must be right. With NUMBA_DISABLE_JIT=1 it runs as Python, for debugging.
    """
    machine_code: Callable[P, R] = njit(cache=True, error_model="numpy")(function)
    return machine_code
