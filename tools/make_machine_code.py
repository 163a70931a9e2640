"""Write slrl_sumo/machine_code: the machine code of the kernels of usual runs, for the Python that runs this.

    python tools/make_machine_code.py

`make` does so when it sets the package up, and tools/check_wheel.sh for the wheel. Kernels that change later are
compiled on the first run again, until this is repeated.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from slrl_sumo.scene.compile_ahead import named, parsed, recorded
from slrl_sumo.scene.compiled import LANGUAGE
from slrl_sumo.scene.shipped_code import CPU, folder


def main() -> None:
    """Compile for CPU in a process of its own, into an empty cache."""
    if not folder().name.startswith("x86_64"):
        print("no machine code made: this is not an x86-64 system; first runs compile")
        return
    with tempfile.TemporaryDirectory() as cache:
        target = {"NUMBA_CPU_NAME": CPU, "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": cache}
        subprocess.run([sys.executable, __file__, "compile"], env={**os.environ, **target}, check=True)


def compile_all() -> None:
    """Compile what is recorded, replace what this Python had in the folder."""
    written: set[Path] = set()
    for name, signatures in recorded().items():
        for signature in signatures:
            named(name).compile(tuple(map(parsed, signature)))
        index = Path(named(name)._cache._cache_file._index_path)
        written |= {index, *index.parent.glob(f"{index.stem}.*.nbc")}
    folder().mkdir(parents=True, exist_ok=True)
    for old in folder().glob(f"*.{LANGUAGE}.*"):
        old.unlink()
    for file in written:
        shutil.copy(file, folder())


if __name__ == "__main__":
    compile_all() if sys.argv[1:] == ["compile"] else main()
