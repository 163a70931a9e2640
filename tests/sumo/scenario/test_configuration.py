"""Finding scenarios and reading what they say."""

import os
from pathlib import Path

import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.sumo.scenario import Scenario, find_scenario, read_scenario, shipped_scenarios


def write(folder: Path, options: str, name: str = "a.sumocfg", root: str = "configuration") -> Path:
    file = folder / name
    file.write_text(f"<{root}>{options}</{root}>")
    return file


def test_every_shipped_name_is_a_scenario_with_its_files() -> None:
    assert {"intersection", "signalised", "shared-space", "district"} <= set(shipped_scenarios())
    for name in shipped_scenarios():
        scenario = find_scenario(name)
        assert scenario.name == name
        for option in ("net-file", "route-files"):
            assert (scenario.config.parent / scenario.options[option]).is_file()


def test_a_file_and_its_folder_are_the_same_scenario(tmp_path: Path) -> None:
    file = write(tmp_path, '<input><net-file value="x.net.xml"/></input>', "town.sumocfg")
    assert find_scenario(str(file)) == find_scenario(str(tmp_path))
    assert find_scenario(str(file)).name == "town"
    assert find_scenario(str(file)).options == {"net-file": "x.net.xml"}


def test_a_config_of_another_name_is_found_by_its_path(tmp_path: Path) -> None:
    file = write(tmp_path, '<begin value="3"/>', "sumo.cfg.xml", root="sumoConfiguration")
    assert find_scenario(str(file)).seconds("begin") == 3.0


def test_a_folder_wins_over_a_shipped_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "intersection").mkdir()
    monkeypatch.chdir(tmp_path)
    # Without a scenario in it, as a folder of outputs, it does not.
    assert find_scenario("intersection").options["net-file"] == "intersection.net.xml"
    mine = write(tmp_path / "intersection", "", "mine.sumocfg")
    assert find_scenario("intersection").config.resolve() == mine.resolve()


def test_old_spellings_of_options_are_understood(tmp_path: Path) -> None:
    file = write(tmp_path, '<time><step_length v="0.2"/></time><report verbose="true"/><!-- end: 5 -->')
    options = read_scenario(file).options
    assert options["step-length"] == "0.2"
    assert "end" not in options


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("0", 0.0),
        (".2", 0.2),
        ("1800", 1800.0),
        ("00:30:00", 1800.0),
        ("7:00:00", 25200.0),
        ("1:00:00:10", 86410.0),
        ("00:00:0.5", 0.5),
        ("-1", None),
    ],
)
def test_times_are_read_as_sumo_writes_them(text: str, seconds: float | None) -> None:
    assert Scenario("a", Path("a.sumocfg"), {"end": text}).seconds("end") == seconds


def test_a_time_that_the_file_does_not_set_is_none() -> None:
    assert Scenario("a", Path("a.sumocfg"), {}).seconds("end") is None


def test_a_time_that_is_none_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"a\.sumocfg: option end is 'noon'"):
        Scenario("a", Path("a.sumocfg"), {"end": "noon"}).seconds("end")


def test_an_unknown_name_gets_the_names_that_exist(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"no such file, folder or shipped scenario; is it intersection\?.*district"):
        find_scenario("intersektion")


def test_a_folder_needs_exactly_one_config(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no \.sumocfg in this folder"):
        find_scenario(str(tmp_path))
    write(tmp_path, "", "a.sumocfg")
    write(tmp_path, "", "b.sumocfg")
    with pytest.raises(InputError, match=r"2 \.sumocfg files in this folder"):
        find_scenario(str(tmp_path))


@pytest.mark.parametrize("content", ["", "plain text", "<configuration><input>", "\x00\x01"])
def test_a_file_that_is_no_xml_is_refused(tmp_path: Path, content: str) -> None:
    file = tmp_path / "a.sumocfg"
    file.write_text(content)
    with pytest.raises(InputError, match=r"a\.sumocfg: (not a SUMO configuration|cannot be read)") as caught:
        find_scenario(str(file))
    assert "\n" not in str(caught.value)


def test_a_network_given_by_mistake_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, "", "a.net.xml", root="net")
    with pytest.raises(InputError, match="this is a <net> file, not a SUMO configuration"):
        find_scenario(str(file))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, "")
    file.chmod(0)
    with pytest.raises(InputError, match="cannot be read"):
        find_scenario(str(file))
