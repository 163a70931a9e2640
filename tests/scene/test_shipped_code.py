"""Machine code that comes with the package."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.scene import shipped_code
from slrl_sumo.scene.shipped_code import CPU, FEATURES, folder, has_shipped

PROGRAM = """
import sys
from pathlib import Path
import numpy as np
from slrl_sumo.scene import shipped_code
shipped_code.FOLDER = Path(sys.argv[1])
from slrl_sumo.scene.compiled import compiled, first_time

@compiled
def total(values):
    found = 0.0
    for value in values:
        found += value * value
    return found

before = first_time()
found = total(np.linspace(0.0, 1.0, 1001) ** 3)
print(before, sum(total.stats.cache_hits.values()), found.hex())
"""

on_x86_64_v3 = pytest.mark.skipif(
    not all(shipped_code.get_host_cpu_features().get(one) for one in FEATURES), reason=f"the processor is no {CPU}"
)


@on_x86_64_v3
def test_what_came_with_the_package_is_not_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shipped_code, "FOLDER", tmp_path / "shipped")
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    inherited = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_C")}

    def run_with(cache: str, **environment: str) -> list[str]:
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / cache)
        (tmp_path / cache).mkdir(exist_ok=True)
        command = [sys.executable, "-W", "error", program, tmp_path / "shipped"]
        done = subprocess.run(command, env=inherited | environment, capture_output=True, text=True, check=True)
        return done.stdout.split()

    first, hits, here = run_with("of this processor")
    assert (first, hits) == ("True", "0")
    assert np.isclose(float.fromhex(here), np.sum((np.linspace(0.0, 1.0, 1001) ** 3) ** 2))
    *_, portable = run_with("to ship", NUMBA_CPU_NAME=CPU, NUMBA_CPU_FEATURES="")
    assert portable == here
    folder().mkdir(parents=True)
    for file in (tmp_path / "to ship").rglob("*.nb?"):
        shutil.copy(file, folder())
    assert run_with("empty") == ["False", "1", here]
    assert not list((tmp_path / "empty").rglob("*.nb?"))
    # It is not for a processor that the user names.
    assert run_with("named", NUMBA_CPU_NAME="generic")[:2] == ["True", "0"]
    # What cannot be read is compiled.
    for file in folder().glob("*.nbc"):
        file.write_bytes(b"\0 damaged")
    assert run_with("damaged")[1:] == ["0", here]


@pytest.mark.parametrize("lacking", ["", "avx2", "movbe"])
def test_older_processors_compile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lacking: str) -> None:
    features = {one: one != lacking for one in (*FEATURES, "sse2")}
    monkeypatch.setattr(shipped_code, "FOLDER", tmp_path)
    monkeypatch.setattr(shipped_code, "get_host_cpu_features", lambda: features)
    folder().mkdir()
    (folder() / "total.nbi").touch()
    shipped_code._suits.cache_clear()
    try:
        assert has_shipped("total") == (not lacking)
        assert not has_shipped("other")
    finally:
        shipped_code._suits.cache_clear()
