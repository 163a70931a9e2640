"""What is built from this folder: the wheel and the source archive, and what they say of licences."""

import shutil
import subprocess
import sys
import tarfile
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest

from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.bundle_folder import SHIPPED, shipped_bundles

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], set[str]]:
    """Files of the wheel with their content, and names of the files of the source archive."""
    folder = tmp_path_factory.mktemp("package")
    source, out = folder / "source", folder / "out"
    ignored = shutil.ignore_patterns("__pycache__", "*.pyc", "*.nbi", "*.nbc")
    for package in ("slrl_sumo", "netgen", "sumo_scenarios"):
        shutil.copytree(ROOT / package, source / package, ignore=ignored)
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, source)
    out.mkdir()
    script = f"from setuptools.build_meta import *; build_wheel({str(out)!r}); build_sdist({str(out)!r})"
    subprocess.run([sys.executable, "-c", script], cwd=source, check=True, capture_output=True, timeout=300)
    with zipfile.ZipFile(next(out.glob("*.whl"))) as wheel:
        files = {name: wheel.read(name) for name in wheel.namelist()}
    with tarfile.open(next(out.glob("*.tar.gz"))) as archive:
        return files, {name.partition("/")[2] for name in archive.getnames()}


def test_no_weights_from_non_commercial_data_are_shipped(built: tuple[dict[str, bytes], set[str]]) -> None:
    for name in shipped_bundles():
        for recording in load_bundle(name).training["recordings"]:
            assert not any(word in recording["licence"].lower() for word in ("nc", "non-commercial", "research"))
    wheel, archive = built
    weights = {f"slrl_sumo/bundles/{name}/weights.safetensors" for name in shipped_bundles()}
    for names in (set(wheel), archive):
        assert {name for name in names if name.endswith("/weights.safetensors")} == weights
        assert not any("campus" in name for name in names)


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
