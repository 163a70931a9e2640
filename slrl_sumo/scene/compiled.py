"""Inner loops compiled to machine code by numba, once per machine."""

import hashlib
import math
import sys
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np
from llvmlite.binding import parse_assembly, parse_bitcode
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys

from slrl_sumo.scene.compile_ahead import awaited
from slrl_sumo.scene.shipped_code import has_shipped, shipped

P = ParamSpec("P")
R = TypeVar("R")

_KERNELS: list[Any] = []
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
LANGUAGE = f"py{sys.version_info.major}{sys.version_info.minor}{getattr(sys, 'abiflags', '')}"
"""The running version of Python, as part of the names of files with machine code."""


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile `function`, plain loops over numbers and numpy arrays, to machine code that is cached for later
    processes.

    It may call compiled functions of any module and use their constants: numbers, arrays, tuples and enumerations
    become constants of the machine code. Arguments may be NamedTuples of arrays. The cache, next to the module or in
    the user's cache folder, is valid for one `fingerprint`, a digest of everything that the machine code consists of.
    Divisions by zero give inf or nan as in numpy. Other threads run meanwhile. There are no bounds checks, so indices
    must be right: NUMBA_BOUNDSCHECK=1 adds checks. With NUMBA_DISABLE_JIT=1 the function runs as Python, for debugging.

    Plain loops compile fastest: for `a[i] = b` and `a[rows] = b` with arrays, and for np.count_nonzero, numba also
    compiles the messages on wrong shapes and axes, which takes 1 to 5 s. For numpy's reductions (any, max, sum) and
    np.flatnonzero, numba imports scipy's BLAS, also when it loads the machine code: a sixth of a start.
    """
    kernel: Any = numba.njit(**_OPTIONS)(function)
    if kernel is not function:  # not NUMBA_DISABLE_JIT
        with suppress(RuntimeError):  # neither the package nor the user has a writable folder
            kernel._cache = _Cache(function)
        _KERNELS.append(kernel)
    machine_code: Callable[P, R] = kernel
    return machine_code


def fingerprint(function: FunctionType) -> str:
    """Digest of everything that the machine code of `function` consists of.

    That is its instructions, the values of the constants and the fields of the named tuples that it uses, and the same
    for the compiled functions that it calls.

    Comments, docstrings and line numbers do not count. TypeError for modules other than numpy and math.
    """
    parts: list[object] = [numba.config.BOUNDSCHECK, _OPTIONS]  # type: ignore[attr-defined]
    _add_function(function, parts, set())
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def first_time() -> bool:
    """Whether none of the compiled functions imported so far is cached: the first decisions will take a while."""
    return bool(_KERNELS) and not any(isinstance(k._cache, _Cache) and k._cache.filled() for k in _KERNELS)


def cache_folder() -> Path | None:
    """Folder of the machine code of this package, also for other results that are computed once per machine; None if
    nothing can be stored."""
    paths = (kernel.stats.cache_path for kernel in _KERNELS)
    return next((Path(path) for path in paths if path is not None), None)


def what_to_expect() -> str:
    """A note on the waiting time of the first decisions; "" if nothing has to be compiled."""
    if not first_time():
        return ""
    if all(kernel.stats.cache_path is None for kernel in _KERNELS):
        return (
            "the inner loops are being compiled, in every run, because there is no folder to cache them in; "
            "set NUMBA_CACHE_DIR to one"
        )
    return "the inner loops are being compiled for this machine; later runs start without that"


class _Files(CompileResultCacheImpl):
    """Names cache files by module and function, not by line; the fingerprint is added on first use.

    LLVM's code of a function is read only when a calling function is compiled: numba's search for symbols in it takes
    two thirds of the loading time.
    """

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return fullname.replace("<", "").replace(">", "")

    def reduce(self, cres: Any) -> Any:
        (name, kind, (machine_code, whole)), *rest = super().reduce(cres)
        names = [cres.fndesc.llvm_func_name, cres.fndesc.llvm_cpython_wrapper_name, cres.environment.env_name]
        names += [environment.env_name for environment in cres._find_referenced_environments()]
        symbols = "".join(f'@"{one}" = global i8 0\n' for one in dict.fromkeys(names))
        return (name, kind, (machine_code, parse_assembly(symbols).as_bitcode())), *rest, whole

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        *reduced, whole = payload
        found = super().rebuild(target_context, reduced)
        found.library._get_module_for_linking = lambda: parse_bitcode(whole)
        return found


class _Cache(FunctionCache):
    """The machine code of one function, in files named after its fingerprint; older files are removed.

    Files that cannot be read (a process died while writing) or written (a full disk) do not end a run: the function is
    compiled again.
    """

    _impl_class = _Files
    _found = False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load machine code without numba's `target_context.refresh()`, which takes a seventh of a start.

        `refresh` imports and registers everything that numba can compile; existing machine code needs only the memory
        functions. The compiler refreshes by itself.
        """
        self._find()
        rtsys.initialize(target_context)
        found = self._read(sig, target_context)
        if found is None:
            others = awaited(f"{self._py_func.__module__}.{self._py_func.__qualname__}", sig)
            found = next((one for _ in others if (one := self._read(sig, target_context)) is not None), None)
        return found

    def _read(self, sig: Any, target_context: Any) -> Any:
        """The machine code for `sig`; None without it."""
        with suppress(Exception):  # see below
            key = self._index_key(sig, target_context.codegen())
            if (found := shipped(self._files, self._stamp, key)) is not None:
                return self._impl.rebuild(target_context, found)
        try:
            return self._load_overload(sig, target_context)
        except Exception:  # whatever unpickling raises
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        self._find()
        with suppress(OSError):
            if not self.filled():
                for file in Path(self.cache_path).glob(f"{self._impl.filename_base}-*.{LANGUAGE}.*"):
                    file.unlink(missing_ok=True)
            super().save_overload(sig, data)

    def filled(self) -> bool:
        """Whether machine code of the present fingerprint exists."""
        self._find()
        return Path(self._cache_file._index_path).exists() or has_shipped(self._files)

    def _find(self) -> None:
        """Compute fingerprint and file names; not on construction, because a function may use later definitions."""
        if not self._found:
            self._stamp = fingerprint(self._py_func)
            self._files = f"{self._impl.filename_base}-{self._stamp}.{LANGUAGE}"
            self._cache_file = IndexDataCacheFile(self.cache_path, self._files, self._stamp)
            self._found = True


def _add_function(function: Any, parts: list[object], known: set[int]) -> None:
    if id(function) in known:
        return
    known.add(id(function))
    for annotation in function.__annotations__.values():
        _add_fields(annotation, parts)
    _add_code(function.__code__, function.__doc__, function.__globals__, parts, known)


def _add_code(code: CodeType, doc: str | None, names: dict[str, object], parts: list[object], known: set[int]) -> None:
    parts.append(code.co_code)
    # A docstring is the first constant.
    for constant in code.co_consts[doc is not None :]:
        if isinstance(constant, CodeType):
            _add_code(constant, None, names, parts, known)
        else:
            parts.append(constant)
    parts.append(code.co_names)  # of globals and, which is harmless, of attributes
    for name in code.co_names:
        if name in names:
            _add_value(names[name], parts, known)


def _add_value(value: Any, parts: list[object], known: set[int]) -> None:
    if hasattr(value, "py_func"):
        _add_function(value.py_func, parts, known)
    elif isinstance(value, type):
        parts.append(list(value) if issubclass(value, Enum) else value)
        _add_fields(value, parts)
    elif isinstance(value, tuple):
        for part in value:
            _add_value(part, parts, known)
    elif isinstance(value, np.ndarray):
        parts += [value.dtype.str, value.shape, value.tobytes()]
    elif value is None or isinstance(value, bool | int | float | str | np.generic):
        parts += [type(value), value]
    elif isinstance(value, ModuleType) and value not in (np, math):
        raise TypeError(f"compiled functions cannot use {value!r}: import its functions and constants")


def _add_fields(value: Any, parts: list[object]) -> None:
    """Add names, order and types of the fields if `value` is a NamedTuple: machine code knows fields by position."""
    if isinstance(value, type) and issubclass(value, tuple):
        parts.append(getattr(value, "_fields", None))
        for annotation in getattr(value, "__annotations__", {}).values():
            _add_fields(annotation, parts)
