"""What is built from this folder: the wheel and the source archive, and what they say of licences."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Callable
from email import message_from_bytes
from pathlib import Path

import pytest
import yaml

from slrl_sumo.extras import EXTRAS, NAMES
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.bundle_folder import SHIPPED, shipped_bundles
from slrl_sumo.version import __version__

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
NEEDED = re.compile(r"([\w-]+)[^;]*")
"""A requirement of no extra."""

ROOT = Path(__file__).parent.parent
MACHINE_CODE = "slrl_sumo/machine_code/system-and-numba/kernel.py311.1.nbc"
"""As tools/make_machine_code.py would make."""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], set[str]]:
    """Files of the wheel with their content, and names of the files of the source archive."""
    folder = tmp_path_factory.mktemp("package")
    source, out = folder / "source", folder / "out"
    for name in tracked():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name, follow_symlinks=False)
    made = source / MACHINE_CODE
    made.parent.mkdir(parents=True)
    made.touch()
    out.mkdir()
    script = f"from setuptools.build_meta import *; build_wheel({str(out)!r}); build_sdist({str(out)!r})"
    subprocess.run([sys.executable, "-c", script], cwd=source, check=True, capture_output=True, timeout=300)
    with zipfile.ZipFile(next(out.glob("*.whl"))) as wheel:
        files = {name: wheel.read(name) for name in wheel.namelist()}
    with tarfile.open(next(out.glob("*.tar.gz"))) as archive:
        return files, {name.partition("/")[2] for name in archive.getnames()}


def test_machine_code_is_in_the_wheel_alone(built: tuple[dict[str, bytes], set[str]]) -> None:
    wheel, archive = built
    assert MACHINE_CODE in wheel
    assert MACHINE_CODE not in archive


def tracked() -> list[str]:
    """Files of the project, as git knows them, and those that are not ignored."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=60)
    return [name for name in done.stdout.splitlines() if (ROOT / name).exists() and name != ".venv"]


def test_the_source_archive_is_complete(built: tuple[dict[str, bytes], set[str]]) -> None:
    _, archive = built
    assert set(tracked()) <= archive


def test_the_wheel_has_one_import_name(built: tuple[dict[str, bytes], set[str]]) -> None:
    wheel, _ = built
    # NGSolve's mesher is called netgen, too.
    assert {name.partition("/")[0] for name in wheel if ".dist-info/" not in name} == {"slrl_sumo"}
    for folder, place in (("netgen", "slrl_sumo/netgen"), ("sumo_scenarios", "slrl_sumo/scenarios")):
        inside = {name.removeprefix(f"{folder}/") for name in tracked() if name.startswith(f"{folder}/")}
        assert inside == {name.removeprefix(f"{place}/") for name in wheel if name.startswith(f"{place}/")}


def test_version_citation_and_changelog_agree() -> None:
    assert f"\nversion: {__version__}\n" in (ROOT / "CITATION.cff").read_text()
    versions = re.findall(r"^## \[(\S+)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert versions[:2] == ["Unreleased", __version__]


def test_an_extra_is_named_for_each_package_that_may_be_missing(built: tuple[dict[str, bytes], set[str]]) -> None:
    wheel, _ = built
    info = next(name.partition("/")[0] for name in wheel if ".dist-info/" in name)
    metadata = message_from_bytes(wheel[f"{info}/METADATA"])
    needed = {match[1] for text in metadata.get_all("Requires-Dist", []) if (match := NEEDED.fullmatch(text))}
    extras = metadata.get_all("Provides-Extra", [])
    assert set(EXTRAS.values()) <= set(extras)
    assert not needed & {name.lower() for name in (*EXTRAS, *NAMES.values())}


WITHOUT = {
    "compare": ["compare", "intersection", "--out", "c"],
    "report": ["run", "intersection", "--agents", "2", "--report", "r"],
    "draw": ["scenarios", "intersection", "--draw", "a.png"],
    "evaluate": ["evaluate", "a.npz", "--out", "e"],
    "flow": ["bench", "--flow"],
    "fit": ["fit", "a.npz", "--out", "b"],
    "train": ["train", "random", "--out", "b"],
    "parquet": ["run", "intersection", "--agents", "2", "--fcd", "a.parquet"],
    "ray": ["compare", "intersection", "--out", "c", "--ray", "local"],
}
"""Commands that need an extra."""
HIDDEN = f"import sys; sys.modules.update(dict.fromkeys({sorted(EXTRAS)!r}))"


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of processes in which no package of an extra can be imported."""
    folder = tmp_path_factory.mktemp("bare")
    (folder / "sitecustomize.py").write_text(HIDDEN)
    return {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}


def test_a_run_attach_and_replay_need_no_extra(bare: dict[str, str], tmp_path: Path) -> None:
    script = """
import pathlib, libsumo, slrl_sumo
from slrl_sumo.sumo.scenario import find_scenario
result = slrl_sumo.run("intersection", agents=3, steps=3, fcd="a.csv")
result.replay("a.html")
config = str(find_scenario("intersection").config)
libsumo.start(["sumo", "-c", config, "--step-length", "0.4", "--time-to-teleport", "-1", "--collision.action", "warn"])
with slrl_sumo.attach(libsumo, agents=2) as learned:
    print(learned.step().learned.sum())
libsumo.close()
try:
    result.trajectories.to_pandas()
except slrl_sumo.InputError as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=bare, capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "2\nto_pandas needs pandas, which is not installed: pip install 'slrl-sumo[pandas]'\n"
    assert (tmp_path / "a.html").stat().st_size > 10_000


@pytest.mark.parametrize("what", WITHOUT)
def test_a_missing_extra_is_named_with_its_command(
    cli: Cli, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, what: str
) -> None:
    for name in ("ray",) if what == "ray" else EXTRAS:
        for loaded in [each for each in sys.modules if each.partition(".")[0] == name]:
            monkeypatch.delitem(sys.modules, loaded)
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "a.npz").write_bytes(b"")
    done = cli(*WITHOUT[what], cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert re.fullmatch(
        r"slrl-sumo: .*needs [\w-]+, which is not installed: pip install 'slrl-sumo\[\w+\]'\n", done.stderr
    )
    assert [file.name for file in tmp_path.iterdir()] == ["a.npz"]


def test_scripts_that_workflows_call_exist() -> None:
    for file in (ROOT / ".github" / "workflows").glob("*.yml"):
        steps = yaml.safe_load(file.read_text())["jobs"]
        called = [step["run"] for job in steps.values() for step in job["steps"] if "run" in step]
        for script in re.findall(r"(?:\.ci|tools)/[\w.]+", " ".join(called)):
            assert os.access(ROOT / script, os.X_OK) or "bash " + script in " ".join(called), script


def test_no_weights_from_non_commercial_data_are_shipped(built: tuple[dict[str, bytes], set[str]]) -> None:
    for name in shipped_bundles():
        for recording in load_bundle(name).training["recordings"]:
            assert not any(word in recording["licence"].lower() for word in ("nc", "non-commercial", "research"))
    wheel, archive = built
    weights = {f"slrl_sumo/bundles/{name}/weights.safetensors" for name in shipped_bundles()}
    for names in (set(wheel), archive):
        assert {name for name in names if name.endswith("/weights.safetensors")} == weights
        assert not any("campus" in name for name in names if name.startswith("slrl_sumo/bundles/"))


def test_the_metadata_name_the_licence_and_every_notice(built: tuple[dict[str, bytes], set[str]]) -> None:
    wheel, archive = built
    info = next(name.partition("/")[0] for name in wheel if ".dist-info/" in name)
    metadata = message_from_bytes(wheel[f"{info}/METADATA"])
    assert metadata["License-Expression"] == "MIT"
    notices = sorted(str(path.relative_to(ROOT)) for path in SHIPPED.glob("*/NOTICE"))
    assert "slrl_sumo/bundles/shared-space/NOTICE" in notices
    assert sorted(metadata.get_all("License-File", [])) == sorted(["LICENSE", *notices])
    for notice in notices:
        assert b"Copyright (c) 2020 Hao Cheng" in wheel[notice]
        assert wheel[f"{info}/licenses/{notice}"] == wheel[notice]
        assert notice in archive


@pytest.mark.parametrize("name", shipped_bundles())
def test_a_bundle_has_the_notice_of_its_data_as_a_file(name: str, tmp_path: Path) -> None:
    bundle, notice = load_bundle(name), SHIPPED / name / "NOTICE"
    assert notice.is_file() == bool(bundle.training["notice"])
    bundle.save(tmp_path / name)
    bundle.save(tmp_path / name)  # in place of itself
    assert (tmp_path / name / "NOTICE").is_file() == notice.is_file()
    if notice.is_file():
        assert (tmp_path / name / "NOTICE").read_bytes() == notice.read_bytes()
