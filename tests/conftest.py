"""What tests of several packages need: the command line as a process, a bundle, scenarios of people who know nothing of
this package."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sumo
import torch
from builders import make_bundle

from slrl_sumo.agent import driver  # noqa: F401 (imports what is compiled)
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.compiled import first_time
from slrl_sumo.sumo.scenario import find_scenario

Cli = Callable[..., subprocess.CompletedProcess[str]]
CopyScenario = Callable[..., Path]


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    """As in a run: models are so small that more threads only wait for each other, on busy cores ten times longer."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """The inner loops, once on a new machine: the first run says so, and takes longer."""
    if first_time():
        command = [sys.executable, "-m", "slrl_sumo", "run", "intersection", "--agents", "16", "--steps", "3"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert "note: the inner loops are being compiled" in done.stderr
        assert "compiled" not in subprocess.run(command, capture_output=True, text=True, check=True).stderr


@pytest.fixture(scope="session")
def cli() -> Cli:
    """Runs `slrl-sumo` with the given words as a process of its own; a crash is a return code below 0."""

    def call(*words: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "slrl_sumo", *map(str, words)]
        environment = {**os.environ, "COLUMNS": "200"}
        return subprocess.run(
            command, cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=300
        )

    return call


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
