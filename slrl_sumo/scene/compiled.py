"""Inner loops that numba compiles to machine code, once per machine."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from numba import njit

P = ParamSpec("P")
R = TypeVar("R")

_FUNCTIONS: list[Any] = []


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """`function`, plain loops over numbers and numpy arrays, as machine code that is kept for the next process.

    Numba keeps it next to the module, or in the user's cache folder, until that file changes. It does not look at other
    files: so a compiled function uses functions and constants of its own module only, and is given the others as
    arguments (tests/scene/test_compiled.py sees to it). Divisions by zero give inf or nan as in numpy; there are no
    bounds checks, so indices must be right: NUMBA_BOUNDSCHECK=1 looks, with a NUMBA_CACHE_DIR of its own, because what
    is kept does not know of it. With NUMBA_DISABLE_JIT=1 it runs as Python, for debugging.
    """
    machine_code: Callable[P, R]
    try:
        machine_code = njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # nowhere to keep it: neither the package nor the user has a folder to write into
        machine_code = njit(error_model="numpy")(function)
    _forgive(machine_code)
    _FUNCTIONS.append(machine_code)
    return machine_code


def _forgive(function: Any) -> None:
    """Let a run go on where what is kept cannot be read (a process or a machine that died while it wrote) or written (a
    full disk): numba would raise. It is compiled anew then."""
    cache = getattr(function, "_cache", None)
    if cache is None:  # NUMBA_DISABLE_JIT
        return
    load, save = cache.load_overload, cache.save_overload

    def load_if_whole(signature: Any, context: Any) -> Any:
        try:
            return load(signature, context)
        except Exception:  # whatever unpickling makes of it
            with suppress(OSError):
                cache.flush()
            return None

    def save_if_possible(signature: Any, result: Any) -> None:
        with suppress(OSError):
            save(signature, result)

    cache.load_overload, cache.save_overload = load_if_whole, save_if_possible


def first_time() -> bool:
    """Whether this machine has none of the compiled functions that have been imported yet: they will take a while."""
    return bool(_FUNCTIONS) and not any(_kept(function) for function in _FUNCTIONS)


def what_to_expect() -> str:
    """A note for who has to wait in the first decisions; "" where nothing has to be compiled."""
    if not first_time():
        return ""
    if all(function.stats.cache_path is None for function in _FUNCTIONS):
        return (
            "the inner loops are being compiled, in every run, for there is no folder to keep them in; "
            "set NUMBA_CACHE_DIR to one"
        )
    return "the inner loops are being compiled for this machine; the next runs need not wait for that"


def _kept(function: Any) -> bool:
    if not hasattr(function, "stats"):  # NUMBA_DISABLE_JIT
        return True
    folder, code = function.stats.cache_path, function.py_func.__code__
    return folder is not None and any(Path(folder).glob(f"*.{code.co_name}-{code.co_firstlineno}.py*.nbi"))
