"""The cache of compiled functions: valid for what they are made of, forgiving where it cannot be used."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numba
import numpy as np
import pytest

from slrl_sumo.scene.compiled import compiled, fingerprint


@compiled
def _ratio(a: float, b: float) -> float:
    return a / b


def test_division_by_zero_is_inf_as_in_numpy() -> None:
    assert _ratio(1.0, 2.0) == 0.5
    assert _ratio(1.0, 0.0) == np.inf


SOURCE = """
from slrl_sumo.scene.compiled import compiled, first_time, what_to_expect

@compiled
def twice(x):
    return 2 * x

if __name__ == "__main__":
    before, note = first_time(), what_to_expect()
    print(before, twice(21), first_time(), note)
"""


def run_in(folder: Path, **environment: str) -> str:
    file = folder / "loops.py"
    if not file.exists():
        file.write_text(SOURCE)
    # Next to the file, wherever this process keeps its own.
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    return subprocess.run(
        [sys.executable, "-W", "error", file], env=inherited | environment, capture_output=True, text=True, check=True
    ).stdout


CONSTANTS = "FACTOR = 3.0\nUNUSED = 1.0\n"
HELPERS = """
from typing import NamedTuple
from constants import FACTOR
from slrl_sumo.scene.compiled import compiled

OWN = (1.0, 2.0)

class Pair(NamedTuple):
    left: float
    right: float

@compiled
def scaled(x):
    # a comment
    return FACTOR * x + OWN[1]
"""
CALLER = """
from helpers import Pair, scaled
from slrl_sumo.scene.compiled import compiled

@compiled
def ratio(pair: Pair):
    "Ratio."
    return scaled(pair.left) / pair.right

if __name__ == "__main__":
    print(ratio(Pair(left=2.0, right=4.0)), sum(ratio.stats.cache_hits.values()))
"""
MODULES = {"constants": CONSTANTS, "helpers": HELPERS, "caller": CALLER}


def test_machine_code_is_kept_until_a_constant_of_another_module_changes(tmp_path: Path) -> None:
    for name, source in MODULES.items():
        (tmp_path / f"{name}.py").write_text(source)
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}

    def result_and_hits() -> str:
        # Without Python's own cache, which cannot tell two edits within a second apart.
        words = [sys.executable, "-B", "-W", "error", tmp_path / "caller.py"]
        return subprocess.run(words, env=inherited, capture_output=True, text=True, check=True).stdout.strip()

    def cached() -> set[Path]:
        return set((tmp_path / "__pycache__").glob("*.nb?"))

    assert result_and_hits() == "2.0 0"
    assert result_and_hits() == "2.0 1"
    before = cached()
    (tmp_path / "constants.py").write_text(CONSTANTS.replace("3.0", "5.0"))
    assert result_and_hits() == "3.0 0"
    assert result_and_hits() == "3.0 1"
    # The files of the old machine code are gone.
    assert len(cached()) == len(before)
    assert not cached() & before


def test_a_function_is_compiled_into_another_one_from_what_is_kept_of_it(tmp_path: Path) -> None:
    for name, source in MODULES.items():
        (tmp_path / f"{name}.py").write_text(source)
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    program = """
from helpers import Pair, scaled
scaled(1.0)
from caller import ratio
print(ratio(Pair(left=2.0, right=4.0)), sum(scaled.stats.cache_hits.values()), sum(ratio.stats.cache_hits.values()))
"""

    def printed() -> str:
        words = [sys.executable, "-W", "error", "-c", program]
        return subprocess.run(words, env=inherited, cwd=tmp_path, capture_output=True, text=True, check=True).stdout

    assert printed() == "2.0 0 0\n"
    for file in (tmp_path / "__pycache__").glob("caller.ratio*.nb?"):
        file.unlink()
    assert printed() == "2.0 1 0\n"
    assert printed() == "2.0 1 1\n"


def fingerprint_of_caller(monkeypatch: pytest.MonkeyPatch, edited: str = "", old: str = "", new: str = "") -> str:
    """The fingerprint of `ratio`, with a text of one of the modules replaced."""
    for name, source in MODULES.items():
        assert name != edited or old in source
        module = ModuleType(name)
        monkeypatch.setitem(sys.modules, name, module)
        exec(source.replace(old, new) if name == edited else source, module.__dict__)
    function = sys.modules["caller"].ratio
    return fingerprint(getattr(function, "py_func", function))


@pytest.mark.parametrize(
    ("edited", "old", "new"),
    [
        ("constants", "FACTOR = 3.0", "FACTOR = 5.0"),
        ("helpers", "OWN = (1.0, 2.0)", "OWN = (1.0, 4.0)"),
        ("helpers", "* x +", "* x -"),
        ("helpers", "left: float\n    right: float", "right: float\n    left: float"),
    ],
    ids=["imported constant", "constant of a called function", "called function", "order of fields"],
)
def test_changes_that_need_new_machine_code(monkeypatch: pytest.MonkeyPatch, edited: str, old: str, new: str) -> None:
    assert fingerprint_of_caller(monkeypatch, edited, old, new) != fingerprint_of_caller(monkeypatch)


@pytest.mark.parametrize(
    ("edited", "old", "new"),
    [
        ("constants", "UNUSED = 1.0", "UNUSED = 2.0"),
        ("helpers", "# a comment\n", "# another one\n\n"),
        ("helpers", "OWN =", "\n\nOWN ="),
        ("caller", "Ratio.", "Quotient."),
    ],
    ids=["unused constant", "comment", "line numbers", "docstring"],
)
def test_changes_that_need_no_new_machine_code(
    monkeypatch: pytest.MonkeyPatch, edited: str, old: str, new: str
) -> None:
    assert fingerprint_of_caller(monkeypatch, edited, old, new) == fingerprint_of_caller(monkeypatch)


def test_bounds_checks_need_machine_code_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    before = fingerprint_of_caller(monkeypatch)
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    assert fingerprint_of_caller(monkeypatch) != before


def test_modules_cannot_be_used_whole() -> None:
    def function() -> int:
        return len(sys.argv)

    with pytest.raises(TypeError, match="cannot use <module 'sys'"):
        fingerprint(function)


def test_what_is_not_compiled_yet_is_known(tmp_path: Path) -> None:
    once = "the inner loops are being compiled for this machine; later runs start without that"
    assert run_in(tmp_path) == f"True 42 False {once}\n"
    assert run_in(tmp_path).split() == ["False", "42", "False"]
    # Numba can be told to leave Python as it is.
    assert run_in(tmp_path, NUMBA_DISABLE_JIT="1").split() == ["False", "42", "False"]


def test_where_nothing_can_be_kept_it_is_compiled_every_time(tmp_path: Path) -> None:
    nowhere = "/proc/nowhere"
    run_in(tmp_path)
    cache = tmp_path / "__pycache__"
    shutil.rmtree(cache)
    cache.write_text("no folder")
    printed = run_in(tmp_path, HOME=nowhere, XDG_CACHE_HOME=nowhere)
    assert printed.startswith("True 42 True the inner loops are being compiled, in every run")
    assert run_in(tmp_path, HOME=nowhere, XDG_CACHE_HOME=nowhere, NUMBA_CACHE_DIR=str(tmp_path)).startswith("True 42 F")


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("left", [b"", b"\0 what was on the disk before"])
def test_what_was_not_kept_whole_is_compiled_anew(tmp_path: Path, kind: str, left: bytes) -> None:
    run_in(tmp_path)
    (file,) = (tmp_path / "__pycache__").glob(f"*.{kind}")
    whole = len(file.read_bytes())
    file.write_bytes(left)
    assert run_in(tmp_path).split()[1] == "42"
    # It is whole again.
    assert len(file.read_bytes()) == whole


def test_what_cannot_be_written_is_not_kept(tmp_path: Path) -> None:
    run_in(tmp_path)  # writes the program
    shutil.rmtree(tmp_path / "__pycache__")
    # No file may be longer than 512 bytes: as on a full disk.
    command = f"ulimit -f 1; {shlex.quote(sys.executable)} {shlex.quote(str(tmp_path / 'loops.py'))}"
    inherited = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    done = subprocess.run(["sh", "-c", command], env=inherited, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("True 42 True ")
