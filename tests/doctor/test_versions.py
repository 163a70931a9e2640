from importlib.metadata import version
from pathlib import Path

import pytest

from slrl_sumo.doctor.versions import SUMO_PACKAGES, home_version, installed, library_version, release, version_skew

SAME = dict.fromkeys(SUMO_PACKAGES, "1.28.0")


def fake_home(folder: Path, printed: str) -> Path:
    binary = folder / "bin" / "sumo"
    binary.parent.mkdir()
    binary.write_text(f"#!/bin/sh\necho '{printed}'\n")
    binary.chmod(0o755)
    return binary


def test_what_is_installed_agrees_with_what_runs() -> None:
    assert library_version() == version("libsumo") == installed()["libsumo"]


def test_equal_versions_and_patches_are_no_skew() -> None:
    assert list(version_skew(SAME, "1.28.0", None)) == []
    assert list(version_skew({**SAME, "traci": "1.28.1"}, "1.28.0", (Path("sumo"), "1.28.0"))) == []


def test_a_package_of_another_release_is_named_with_the_command_that_mends_it() -> None:
    (finding,) = version_skew({**SAME, "traci": "1.20.0"}, "1.28.0", None)
    assert (finding.severity, finding.topic) == ("warning", "versions")
    assert "traci 1.20.0" in finding.what
    assert "sumolib" not in finding.what
    assert "traci==1.28.0" in finding.fix


@pytest.mark.parametrize(
    ("printed", "expected"),
    [
        ("Eclipse SUMO sumo 1.20.0", "1.20.0"),
        ("Eclipse SUMO sumo Version 1.20.0", "1.20.0"),
        ("Eclipse SUMO sumo Version v1_20_0+0443-233e48e5c88", "1.20.0"),
    ],
)
def test_another_sumo_in_sumo_home_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, printed: str, expected: str
) -> None:
    binary = fake_home(tmp_path, printed)
    monkeypatch.setenv("SUMO_HOME", str(tmp_path))
    assert home_version() == (binary, expected)
    (finding,) = version_skew(SAME, "1.28.0", home_version())
    assert (finding.severity, finding.topic) == ("warning", "versions")
    assert str(binary) in finding.what


def test_a_sumo_home_without_sumo_says_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SUMO_HOME", str(tmp_path))
    assert home_version() is None
    fake_home(tmp_path, "hello")
    assert home_version() is None


def test_release() -> None:
    assert [release(text) for text in ("1.28.0", "v1_20_0+04", "1.9", "")] == [(1, 28), (1, 20), (1, 9), None]
