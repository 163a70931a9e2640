"""One SUMO simulation: opened, stepped, refused, closed."""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import libsumo
import pytest

from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.scenario.options import with_options
from slrl_sumo.sumo.session import SumoSession

Copy = Callable[..., Path]


@pytest.fixture
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder that temporary files go to in this test."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield folder
    if libsumo.isLoaded():
        libsumo.close()


def listing(folder: Path) -> dict[str, tuple[int, int]]:
    """Every file under `folder` with its size and time of change."""
    return {
        str(file): (file.stat().st_size, file.stat().st_mtime_ns)
        for file in sorted(folder.rglob("*"))
        if "__pycache__" not in file.parts
    }


def run_for(session: SumoSession, steps: int) -> None:
    for _ in range(steps):
        session.step()


def test_a_session_counts_time_in_steps_that_fill_the_decision_interval(scratch: Path) -> None:
    for step in (0.4, 0.2, 0.1, 0.05):
        with SumoSession(find_scenario("intersection"), step_length=step) as session:
            assert session.step_length == step
            assert session.substeps == round(0.4 / step)
            assert session.time == 0.0
            assert session.end == 600.0
            for _ in range(session.substeps):
                session.step()
            assert session.time == pytest.approx(0.4)


def test_a_second_open_session_is_refused_and_the_first_goes_on(scratch: Path) -> None:
    with SumoSession(find_scenario("intersection")) as first:
        first.step()
        with pytest.raises(InputError, match="already open"), SumoSession(find_scenario("shared-space")):
            pass
        first.step()
        assert first.time == pytest.approx(0.8)
        assert len(list(scratch.iterdir())) == 1
    assert not libsumo.isLoaded()
    with SumoSession(find_scenario("shared-space")) as second:
        second.step()
        assert second.time == pytest.approx(0.4)
    assert list(scratch.iterdir()) == []


def test_an_error_inside_closes_the_session(scratch: Path) -> None:
    with pytest.raises(KeyError), SumoSession(find_scenario("intersection")):
        raise KeyError
    assert not libsumo.isLoaded()
    assert list(scratch.iterdir()) == []


BROKEN = {
    "no net": ((".sumocfg", "intersection.net.xml", "gone.net.xml"), "gone.net.xml"),
    "no routes": ((".sumocfg", "intersection.rou.xml", "gone.rou.xml"), "gone.rou.xml"),
    "unknown option": ((".sumocfg", "<time>", '<output><no-such-thing value="1"/></output><time>'), "no-such-thing"),
    "unknown edge": (
        (".rou.xml", "<routes>", '<routes><trip id="astray" depart="0" from="nowhere" to="out0"/>'),
        "nowhere",
    ),
    "net of another root": ((".net.xml", "</net>", "</nett>"), "intersection.net.xml"),
    "value of another kind": ((".net.xml", 'speed="13.89"', 'speed="fast"'), "fast"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_scenario_that_sumo_refuses_gives_one_line_with_its_reason(
    copy_scenario: Copy, scratch: Path, what: str
) -> None:
    change, reason = BROKEN[what]
    config = copy_scenario("intersection", change)
    with pytest.raises(InputError) as caught, SumoSession(find_scenario(str(config))):
        pytest.fail("SUMO took it")
    message = str(caught.value)
    assert str(config) in message
    assert reason in message
    assert "\n" not in message
    assert not libsumo.isLoaded()
    assert list(scratch.iterdir()) == []
    with SumoSession(find_scenario("intersection")) as session:
        session.step()
        assert session.time == pytest.approx(0.4)


@pytest.mark.parametrize("suffix", [".net.xml", ".rou.xml"])
def test_a_file_cut_in_the_middle_is_named_with_the_line(copy_scenario: Copy, scratch: Path, suffix: str) -> None:
    config = copy_scenario("intersection")
    file = config.with_name(f"intersection{suffix}")
    text = file.read_bytes()
    # In the head of the demand: SUMO reads the first 200 s of it when it starts.
    file.write_bytes(text[: len(text) // 2 if suffix == ".net.xml" else 900])
    with pytest.raises(InputError) as caught, SumoSession(find_scenario(str(config))):
        pytest.fail("SUMO took it")
    assert file.name in str(caught.value)
    assert "line/column" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not libsumo.isLoaded()
    assert list(scratch.iterdir()) == []


def test_what_sumo_prints_when_it_refuses_stays_inside(
    copy_scenario: Copy, scratch: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    config = copy_scenario("intersection", BROKEN["no net"][0])
    with pytest.raises(InputError), SumoSession(find_scenario(str(config))):
        pass
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "")


def test_demand_that_breaks_later_is_sumo_giving_up(copy_scenario: Copy, scratch: Path) -> None:
    config = copy_scenario(
        "intersection",
        (".sumocfg", "<time>", '<input><route-steps value="2"/></input><time>'),
        # The first of these waits for its turn, and holds up reading the second.
        (
            ".rou.xml",
            "</routes>",
            '<trip id="last" depart="20" from="in0" to="out1"/>'
            '<trip id="astray" depart="40" from="nowhere" to="out0"/></routes>',
        ),
    )
    with SumoSession(find_scenario(str(config))) as session:
        session.step()
        with pytest.raises(SumoError, match=r"SUMO stopped at \d+(\.\d)? s: .*nowhere") as caught:
            run_for(session, 200)
        assert "\n" not in str(caught.value)
    assert not libsumo.isLoaded()
    assert list(scratch.iterdir()) == []


def test_nothing_is_written_beside_a_scenario_of_the_wheel(
    game: Path, scratch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cwd = tmp_path / "cwd"
    cwd.mkdir()
    monkeypatch.chdir(cwd)
    before = listing(game)
    with SumoSession(find_scenario(str(game / "square.sumocfg"))) as session:
        for _ in range(50):
            session.step()
    assert listing(game) == before
    assert list(cwd.iterdir()) == []
    assert list(scratch.iterdir()) == []


OUTPUTS = """<output>
  <tripinfo-output value="trips.xml"/><fcd-output value="{folder}/fcd.xml"/><log value="run.log"/>
  <summary-output value="../{name}/summary.xml"/>
</output><additional-files value="detectors.add.xml"/><time>"""
DETECTORS = '<additional><laneData id="l" file="lanes.xml" period="1"/><inductionLoop id="d" lane="in0_2" pos="5" \
period="1" file="loop.xml"/></additional>'


def test_outputs_of_the_scenario_are_diverted_or_kept_as_asked(copy_scenario: Copy, scratch: Path) -> None:
    config = copy_scenario("intersection")
    folder = config.parent
    config.write_text(config.read_text().replace("<time>", OUTPUTS.format(folder=folder, name=folder.name)))
    (folder / "detectors.add.xml").write_text(DETECTORS)
    before = listing(folder)
    with SumoSession(find_scenario(str(config))) as session:
        for _ in range(10):
            session.step()
        assert len(list(next(scratch.iterdir()).iterdir())) >= 5
    assert listing(folder) == before
    assert list(scratch.iterdir()) == []
    with SumoSession(find_scenario(str(config)), keep_outputs=True) as session:
        assert os.listdir(scratch) == []
        for _ in range(10):
            session.step()
    written = {Path(file).name for file in listing(folder)} - {Path(file).name for file in before}
    assert written == {"trips.xml", "fcd.xml", "run.log", "summary.xml", "lanes.xml", "loop.xml"}


def test_the_seed_decides_the_traffic() -> None:
    def positions(seed: int) -> list[float]:
        with SumoSession(find_scenario("intersection"), seed=seed) as session:
            for _ in range(100):
                session.step()
            snapshot = session.reader.read()
            return [*snapshot.x.tolist(), *snapshot.y.tolist()]

    first = positions(3)
    assert len(first) >= 8
    assert positions(3) == first
    assert positions(4) != first


def test_added_options_are_in_force(scratch: Path) -> None:
    town = with_options(find_scenario("intersection"), ["--lateral-resolution", "0.8", "--step-length", "0.2"])
    with SumoSession(town) as session:
        assert libsumo.simulation.getOption("lateral-resolution") == "0.8"
        assert session.step_length == 0.2


@pytest.mark.parametrize(
    ("words", "reason"),
    [("--no-such-thing 1", "No option with the name 'no-such-thing'"), ("--lateral-resolution wide", "'wide'")],
)
def test_an_added_option_that_sumo_refuses_gives_one_line(scratch: Path, words: str, reason: str) -> None:
    town = with_options(find_scenario("intersection"), words.split())
    with pytest.raises(InputError) as caught, SumoSession(town):
        pytest.fail("SUMO took it")
    for part in (reason, f"--sumo-options '{words}'"):
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not libsumo.isLoaded()


def test_a_missing_library_of_the_system_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "libsumo", None)  # as an image without X11's libraries
    with pytest.raises(InputError, match=r"libsumo cannot be imported \(.*\); .* apt-get install libx11-6"):
        SumoSession(find_scenario("intersection")).__enter__()
