"""Files that are refused early: what is no file, what holds far more than it looks like, what is nested too deeply."""

import gzip
import os
from pathlib import Path

import pytest

from slrl_sumo.input_files import open_input, open_xml, read_json, read_text, read_toml, text_lines, unpacked


@pytest.fixture(autouse=True)
def _one_mebibyte(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLRL_SUMO_INPUT_MIB", "1")


def test_only_regular_files_are_opened_and_no_pipe_is_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, kind in ((tmp_path / "pipe", "pipe"), (tmp_path, "folder"), (Path("/dev/zero"), "device")):
        with pytest.raises(OSError, match=f"it is a {kind}"):
            open_input(path)


def test_packed_content_has_a_limit_that_the_environment_raises(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "bomb.gz"
    file.write_bytes(gzip.compress(bytes(3 << 20)))
    with open_input(file) as packed, pytest.raises(OSError, match=r"more than 1 MiB .*; set SLRL_SUMO_INPUT_MIB"):
        unpacked(packed).read()
    monkeypatch.setenv("SLRL_SUMO_INPUT_MIB", "3")
    with open_input(file) as packed:
        assert len(unpacked(packed).read()) == 3 << 20
    monkeypatch.setenv("SLRL_SUMO_INPUT_MIB", "many")
    with open_input(file) as packed, pytest.raises(OSError, match="'many': give a number of MiB"):
        unpacked(packed).read()


def test_packed_content_below_thirty_times_its_size_is_read(tmp_path: Path) -> None:
    file = tmp_path / "noise.gz"
    file.write_bytes(gzip.compress(os.urandom(1 << 17) * 16))
    with open_input(file) as packed:
        assert len(unpacked(packed).read()) == 1 << 21


def test_damaged_gzip_says_so(tmp_path: Path) -> None:
    whole = gzip.compress(os.urandom(5000))
    for content, reason in (
        (whole[:2000], "cut off"),
        (whole[:-8] + bytes(8), "no.* sound gzip"),
    ):
        (tmp_path / "a.gz").write_bytes(content)
        with open_input(tmp_path / "a.gz") as packed, pytest.raises(OSError, match=reason):
            unpacked(packed).read()


def test_settings_have_a_limit(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("[" + " " * (1 << 16) + "]")
    with pytest.raises(OSError, match="too much for settings"):
        read_json(tmp_path / "a.json")
    (tmp_path / "b.json").write_text('{"a": 1}')
    assert read_json(tmp_path / "b.json") == {"a": 1}
    assert read_text(tmp_path / "b.json") == '{"a": 1}'


def test_deep_nesting_is_an_error_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("[" * 20000)
    with pytest.raises(ValueError, match="nested too deeply"):
        read_json(tmp_path / "a")
    (tmp_path / "a").write_text("a=" + "[" * 20000)
    with pytest.raises(ValueError, match="nested too deeply"):
        read_toml(tmp_path / "a")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "declares a document type"),
        (b"<!--" + b" " * 70000 + b'--><!DOCTYPE a SYSTEM "/etc/passwd"><a/>', "declares a document type"),
        ("<?xml version='1.0'?><a/>".encode("utf-16"), "no XML text in UTF-8"),
        (b"<?xml version='1.0' encoding='UTF-7'?><a/>", "its encoding is UTF-7"),
    ],
)
def test_xml_with_entities_or_in_odd_encodings_is_not_read(tmp_path: Path, text: bytes, reason: str) -> None:
    for content in (text, gzip.compress(text)):
        (tmp_path / "a.xml").write_bytes(content)
        with open_xml(tmp_path / "a.xml") as file, pytest.raises(OSError, match=reason):
            file.read()


def test_plain_xml_is_read_again_from_its_beginning(tmp_path: Path) -> None:
    text = b"\xef\xbb\xbf<?xml version='1.0' encoding='ISO-8859-1'?><a/>"
    for content in (text, gzip.compress(text)):
        (tmp_path / "a.xml").write_bytes(content)
        with open_xml(tmp_path / "a.xml") as file:
            assert file.read() == text
            file.seek(0)
            assert file.read() == text


def test_lines_of_tables_have_a_limit(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"a;b\n" + bytes(1 << 21))
    with open_input(tmp_path / "a.csv") as file:
        lines = text_lines(file)
        assert next(lines) == "a;b\n"
        with pytest.raises(OSError, match="no table"):
            next(lines)
