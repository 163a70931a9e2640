"""What tests of several packages need: the command line, bundles, scenarios; and the check that no files are left."""

import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from getpass import getuser
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

# As the command does before it imports PyTorch: threads that wait for others leave the core to them. Where another
# program has a core, the same training takes 17 s otherwise instead of 9 s, or 39 s instead of 17 s.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numpy as np
import pytest
import sumo
import torch
from builders import make_bundle

from slrl_sumo.agent import driver  # noqa: F401 (imports what is compiled)
from slrl_sumo.cli import main
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.compiled import first_time
from slrl_sumo.sumo.scenario import find_scenario

Cli = Callable[..., subprocess.CompletedProcess[str]]
CopyScenario = Callable[..., Path]

GRACE = 20.0
"""s that processes of the last tests have to remove their temporary files."""


def pytest_configure(config: pytest.Config) -> None:
    """Give all tests a temporary folder of their own, except for pytest's folders, which stay where they were."""
    if not hasattr(config, "workerinput"):  # worker processes inherit it
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())
        os.environ["TMPDIR"] = tempfile.tempdir = tempfile.mkdtemp(prefix="t_")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> Generator[None, None, None]:
    """Fail where anything is left in the temporary folder of the tests."""
    yield
    if hasattr(session.config, "workerinput"):
        return
    folder, end = Path(tempfile.gettempdir()), time.monotonic() + GRACE
    # PyTorch's optimisers create a folder for their compiler, and Chromium one that may outlive it.
    others = (f"torchinductor_{getuser()}", "org.chromium.")
    while (left := sorted(path.name for path in folder.iterdir() if not path.name.startswith(others))) and (
        time.monotonic() < end
    ):
        time.sleep(0.5)
    shutil.rmtree(folder, ignore_errors=True)
    if left:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
        print(f"\nERROR: left in the temporary folder: {', '.join(left)}")


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    """As in a run: models are so small that more threads only wait for each other, on busy cores ten times longer."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session", autouse=True)
def _compiled(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The kernels are compiled once on a new machine, by one of the worker processes: the first run says so."""
    with open(tmp_path_factory.getbasetemp().parent / "kernels.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if first_time():
            command = [sys.executable, "-m", "slrl_sumo", "run", "intersection", "--agents", "16", "--steps", "3"]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            assert "note: the inner loops are being compiled" in done.stderr
            assert "compiled" not in subprocess.run(command, capture_output=True, text=True, check=True).stderr


@pytest.fixture(scope="session")
def cli_process() -> Cli:
    """Runs `slrl-sumo` with the given words as a process of its own; a crash is a return code below 0."""

    def call(*words: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "slrl_sumo", *map(str, words)]
        environment = {**os.environ, "COLUMNS": "200"}
        return subprocess.run(
            command, cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=300
        )

    return call


@pytest.fixture(scope="session")
def cli() -> Cli:
    """Runs `slrl-sumo` with the given words inside this process, which saves seconds of imports; a bug raises.

    Everything is caught that the process and those that it starts print, C++ code included.
    """

    def call(*words: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        command = ["slrl-sumo", *map(str, words)]
        code: object = 0
        with pytest.MonkeyPatch.context() as patch, TemporaryFile("w+") as out, TemporaryFile("w+") as err:
            patch.setattr(sys, "argv", command)
            patch.setenv("COLUMNS", "200")
            patch.chdir(Path.cwd() if cwd is None else cwd)
            with _printing_to(out, err):
                try:
                    main()
                except SystemExit as end:
                    code = end.code
                finally:
                    torch.set_num_threads(1)
            return subprocess.CompletedProcess(command, int(code or 0), out.read(), err.read())

    return call


@contextmanager
def _printing_to(*files: IO[str]) -> Iterator[None]:
    """Send the standard output and error of this process and of those that it starts to two files."""
    saved = [os.dup(number) for number in (1, 2)]
    try:
        for number, file in enumerate(files, start=1):
            os.dup2(file.fileno(), number)
        with redirect_stdout(files[0]), redirect_stderr(files[1]):
            yield
    finally:
        for number, (file, before) in enumerate(zip(files, saved, strict=True), start=1):
            file.flush()
            os.dup2(before, number)
            os.close(before)
            file.seek(0)


@pytest.fixture(scope="session")
def game() -> Path:
    """SUMO's game: scenarios that came with the eclipse-sumo wheel."""
    return Path(sumo.SUMO_HOME) / "tools" / "game"


@pytest.fixture(scope="session")
def shipped_bundle() -> ModelBundle:
    """The bundle that runs use unless told otherwise."""
    return load_bundle("intersection")


@pytest.fixture
def bundle() -> ModelBundle:
    """A bundle of random weights; a test may change them."""
    return make_bundle()


@pytest.fixture
def seen() -> Observation:
    """Observations of 300 road users of all types."""
    random = np.random.default_rng(1)
    vector = random.normal(2.0, 3.0, (300, len(FEATURES))).astype(np.float32)
    vector[:, 0] = random.uniform(0.0, 12.0, 300)
    vector[:50, 0] = 0.0
    return Observation(vector=vector, image=None, type=(np.arange(300) % 3).astype(np.int8))


@pytest.fixture
def copy_scenario(tmp_path: Path) -> CopyScenario:
    """Copies a shipped scenario into a folder of the test, and replaces texts in its files.

    `changes`: (suffix of the file's name, what stands there, what shall stand there).
    """

    def copy(name: str, *changes: tuple[str, str, str], to: str = "scenario") -> Path:
        folder = tmp_path / to
        shutil.copytree(find_scenario(name).config.parent, folder)
        for suffix, old, new in changes:
            file = next(folder.glob(f"*{suffix}"))
            text = file.read_text()
            assert old in text, f"{old} does not stand in {file}"
            file.write_text(text.replace(old, new))
        return next(folder.glob("*.sumocfg"))

    return copy


@pytest.fixture
def bare_network(tmp_path: Path) -> Callable[[str], Path]:
    """Makes a scenario without traffic from <edge> elements between the nodes a, b and c, 100 m apart in a row."""

    def make(edges: str) -> Path:
        nodes = "".join(f'<node id="{name}" x="{100 * i}" y="0"/>' for i, name in enumerate("abc"))
        (tmp_path / "bare.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
        (tmp_path / "bare.edg.xml").write_text(f"<edges>{edges}</edges>")
        command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), "-n", "bare.nod.xml", "-e", "bare.edg.xml"]
        subprocess.run([*command, "-o", "bare.net.xml"], cwd=tmp_path, check=True, capture_output=True, timeout=60)
        config = tmp_path / "bare.sumocfg"
        config.write_text('<configuration><net-file value="bare.net.xml"/><end value="20"/></configuration>')
        return config

    return make
