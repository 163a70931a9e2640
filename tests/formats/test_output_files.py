"""Outputs that would overwrite each other, or cannot be written, are refused before any work."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.output_files import MAX_NAME, REPLACED, Output, claimed, write_file


def refused(*outputs: Output, inputs: tuple[Path, ...] = (), words: str) -> None:
    with pytest.raises(InputError) as caught, claimed(outputs, inputs):
        pass
    message = caught.value.as_options()
    assert words in message
    assert "\n" not in message


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_same_path_in_any_spelling(here: Path) -> None:
    (here / "folder").mkdir()
    (here / "link").symlink_to("folder")
    (here / "to_a.csv").symlink_to("a.csv")  # leads to a file that does not exist yet
    for other in ("a.csv", here / "a.csv", "folder/../a.csv", "./a.csv", "to_a.csv"):
        refused(
            Output("fcd", Path("a.csv")),
            Output("summary", Path(other)),
            words=f"--fcd a.csv and --summary {Path(other)} would overwrite each other; give them different names",
        )
    refused(Output("fcd", Path("folder/a.csv")), Output("summary", Path("link/a.csv")), words="overwrite each other")
    (here / "b.csv").write_text("old")
    os.link("b.csv", "hard.csv")
    refused(Output("fcd", Path("b.csv")), Output("summary", Path("hard.csv")), words="overwrite each other")


def test_a_file_in_a_folder_that_another_output_writes(here: Path) -> None:
    (here / "out").mkdir()
    report, bundle = Output("report", Path("out"), ("*.html", "*.png")), Output("out", Path("out"), REPLACED)
    refused(report, Output("summary", Path("out/report.html")), words="--summary out/report.html")
    refused(bundle, Output("report", Path("out/modes"), ("*.png",)), words="--report out/modes")
    refused(bundle, inputs=(here / "out" / "config.json",), words="config.json")
    # A report leaves other files of its folder alone.
    with claimed([report, Output("fcd", Path("out/a.xml")), Output("summary", Path("out/s.json"))]):
        pass


def test_an_input_is_never_overwritten(here: Path) -> None:
    (here / "net.xml").write_text("<net/>")
    (here / "bundle").mkdir()
    (here / "bundle" / "config.json").write_text("{}")
    refused(Output("fcd", Path("net.xml")), inputs=(here / "net.xml",), words="would overwrite the input")
    refused(Output("summary", Path("bundle/config.json")), inputs=(Path("bundle"),), words="bundle/config.json")
    refused(Output("out", Path("bundle"), REPLACED), inputs=(Path("bundle"),), words="bundle/config.json")
    with claimed([Output("summary", Path("bundle/summary.json"))], [Path("bundle")]):
        pass
    assert (here / "net.xml").read_text() == "<net/>"


UNWRITABLE = {
    "missing/a.xml": "missing does not exist; create it",
    "a.xml/b.xml": "a.xml does not exist; create it",
    "n" * (MAX_NAME + 1): "the name is too long",
    "/".join(["n" * 200] * 30): "cannot be written (File name too long)",
    "folder": "folder: is a folder; name a file",
    "pipe": "pipe: is a device or a pipe; name a file",
    "device": "device: is a device or a pipe; name a file",
    "loop": "loop: is a link to itself",
    "nul\0": "embedded null ",
    "/proc/a.xml": "/proc/a.xml: cannot be written",
}


@pytest.mark.parametrize("name", UNWRITABLE)
def test_what_cannot_become_a_file(here: Path, name: str) -> None:
    (here / "a.xml").write_text("old")
    (here / "folder").mkdir()
    os.mkfifo("pipe")
    (here / "device").symlink_to("/dev/full")
    (here / "loop").symlink_to("loop")
    before = sorted(path.name for path in here.iterdir())
    refused(Output("fcd", Path(name)), words=UNWRITABLE[name])
    assert sorted(path.name for path in here.iterdir()) == before


def test_what_cannot_become_a_folder(here: Path) -> None:
    (here / "file").write_text("old")
    refused(Output("report", Path("file"), ("*.png",)), words="file: is a file; name a folder")
    refused(Output("report", Path("no/pictures"), ("*.png",)), words="no does not exist")


CLAIM = """
import sys, time
from pathlib import Path
from slrl_sumo.formats.output_files import Output, claimed
with claimed([Output("fcd", Path(sys.argv[1]))]):
    print("claimed", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def other_run(here: Path) -> Callable[[str], "subprocess.Popen[str]"]:
    """Another process that claims a path."""

    def start(path: str) -> "subprocess.Popen[str]":
        process = subprocess.Popen([sys.executable, "-c", CLAIM, path], stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        assert process.stdout.readline() == "claimed\n"
        return process

    return start


def test_a_path_that_another_run_writes(here: Path, other_run: Callable[[str], "subprocess.Popen[str]"]) -> None:
    (here / "link.xml").symlink_to("a.xml")
    with other_run(str(here / "a.xml")) as process:
        refused(Output("summary", Path("link.xml")), words="--summary link.xml: another run writes it")
        with claimed([Output("fcd", Path("b.xml"))]):  # another name in the same folder
            pass
        process.send_signal(signal.SIGKILL)
    with claimed([Output("fcd", Path("a.xml"))]):  # a kill frees it
        pass
    assert [path.name for path in here.iterdir()] == ["link.xml"], "a claim leaves nothing behind"


def test_a_file_is_replaced_as_a_whole_or_not_at_all(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "s.json").write_text("old")
    (here / "link.json").symlink_to("s.json")
    write_file(Path("link.json"), "new")
    assert ((here / "s.json").read_text(), (here / "link.json").is_symlink()) == ("new", True)

    def full(self: Path, data: bytes) -> int:
        self.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match=r"s\.json: cannot be written \(No space left on device\)"):
        write_file(Path("s.json"), "half")
    assert (here / "s.json").read_text() == "new"
    assert sorted(path.name for path in here.iterdir()) == ["link.json", "s.json"]
