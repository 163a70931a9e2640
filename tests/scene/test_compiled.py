"""What numba's cache cannot know must not happen: compiled functions that depend on other modules."""

import ast
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import slrl_sumo
from slrl_sumo.scene.compiled import compiled

PACKAGE = Path(slrl_sumo.__file__).parent
MODULES = sorted(file for file in PACKAGE.rglob("*.py") if "@compiled" in file.read_text(encoding="utf-8"))


def names_in(part: ast.AST) -> set[str]:
    return {name.id for name in ast.walk(part) if isinstance(name, ast.Name)}


def foreign_names(source: str) -> set[str]:
    """Names that compiled functions of a module use and that it imports from the package, or computes from such."""
    tree = ast.parse(source)
    imported = {
        alias.asname or alias.name
        for node in tree.body
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("slrl_sumo")
        for alias in node.names
    }
    made_of = {
        target.id: names_in(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for targets in (node.targets if isinstance(node, ast.Assign) else [node.target])
        for target in ast.walk(targets)
        if isinstance(target, ast.Name)
    }
    used: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and any(
            isinstance(d, ast.Name) and d.id == "compiled" for d in node.decorator_list
        ):
            used |= {name for part in node.body for name in names_in(part)}
    while more := {name for known in used & set(made_of) for name in made_of[known]} - used:
        used |= more
    return used & imported


@pytest.mark.parametrize("file", MODULES, ids=[file.stem for file in MODULES])
def test_compiled_functions_use_nothing_of_other_modules(file: Path) -> None:
    assert foreign_names(file.read_text(encoding="utf-8")) == set()


def test_what_a_module_imports_is_noticed() -> None:
    source = "from slrl_sumo.scene.route import SPACING\nA = 1\n@compiled\ndef f(x):\n    return x * SPACING + A\n"
    assert foreign_names(source) == {"SPACING"}
    indirect = "A, B = 2 * SPACING, 1\nC: float = A\n@compiled\ndef f(x):\n    return C\n"
    assert foreign_names("from slrl_sumo.scene.route import SPACING\n" + indirect) == {"SPACING"}


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


def test_what_is_not_compiled_yet_is_known(tmp_path: Path) -> None:
    once = "the inner loops are being compiled for this machine; the next runs need not wait for that"
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
