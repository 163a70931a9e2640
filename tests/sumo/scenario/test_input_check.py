"""Files that SUMO must not get to read."""

import gzip
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.sumo.scenario import read_scenario
from slrl_sumo.sumo.scenario.demand import read_demand
from slrl_sumo.sumo.scenario.input_check import check_inputs
from slrl_sumo.sumo.session import SumoSession

LAUGHS = '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]><routes><vType id="&b;"/></routes>'


def scenario_of(folder: Path, routes: str | bytes, name: str = "a.rou.xml") -> Path:
    (folder / name).write_bytes(routes if isinstance(routes, bytes) else routes.encode())
    config = folder / "a.sumocfg"
    config.write_text(f'<configuration><net-file value="no.net.xml"/><route-files value="{name}"/></configuration>')
    return config


def test_files_that_include_themselves_are_refused_and_counted_by_the_doctor(tmp_path: Path) -> None:
    (tmp_path / "b.xml").write_text("<routes>\n<include\n href='a.rou.xml'/></routes>")
    scenario = read_scenario(scenario_of(tmp_path, '<routes><include href="b.xml"/></routes>'))
    with pytest.raises(InputError, match=r"a\.rou\.xml: cannot be read .*b\.xml includes a\.rou\.xml"):
        check_inputs(scenario)
    assert "b.xml includes a.rou.xml" in read_demand(scenario).unreadable[tmp_path / "a.rou.xml"]
    with pytest.raises(InputError, match=r"b\.xml includes a\.rou\.xml"), SumoSession(scenario):
        pass


def test_files_that_each_include_the_next_twice_are_refused(tmp_path: Path) -> None:
    for n in range(20):
        (tmp_path / f"{n}.xml").write_text(
            f'<routes><include href="{n + 1}.xml"/><include href="{n + 1}.xml"/></routes>'
        )
    with pytest.raises(InputError, match="includes more than 1000 files"):
        check_inputs(read_scenario(scenario_of(tmp_path, '<routes><include href="0.xml"/></routes>')))


@pytest.mark.parametrize(
    ("routes", "reason"),
    [
        (LAUGHS, "declares a document type"),
        ("<routes>" + "<param>" * 100_000 + "</param>" * 100_000 + "</routes>", "nested more than 1000 deep"),
        (gzip.compress(LAUGHS.encode()), "declares a document type"),
        (gzip.compress(b"<routes>" + b" " * (2 << 20)), "takes more than 1 MiB"),
    ],
    ids=("entities", "depth", "packed entities", "packed spaces"),
)
def test_bombs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, routes: str | bytes, reason: str) -> None:
    monkeypatch.setenv("SLRL_SUMO_INPUT_MIB", "1")
    with pytest.raises(InputError, match=reason):
        check_inputs(read_scenario(scenario_of(tmp_path, routes)))


def test_pipes_are_not_waited_for(tmp_path: Path) -> None:
    config = scenario_of(tmp_path, "<routes/>")
    (tmp_path / "a.rou.xml").unlink()
    os.mkfifo(tmp_path / "a.rou.xml")
    with pytest.raises(InputError, match="it is a pipe"):
        check_inputs(read_scenario(config))
    (tmp_path / "a.rou.xml").unlink()
    (tmp_path / "a.rou.xml").symlink_to("a.rou.xml")
    with pytest.raises(InputError, match=r"a\.rou\.xml: cannot be read"):
        check_inputs(read_scenario(config))
    config.unlink()
    os.mkfifo(config)
    with pytest.raises(InputError, match="it is a pipe"):
        read_scenario(config)


def test_missing_and_included_files_are_left_to_sumo(tmp_path: Path, bare_network: Callable[[str], Path]) -> None:
    config = bare_network('<edge id="ab" from="a" to="b"/><edge id="bc" from="b" to="c"/>')
    (tmp_path / "types.xml").write_text('<additional><vType id="t"/></additional>')
    (tmp_path / "x.add.xml").write_text('<additional><include href="types.xml"/></additional>')
    text = config.read_text().replace("<end", '<additional-files value="x.add.xml"/><end')
    config.write_text(text)
    scenario = read_scenario(config)
    assert read_demand(scenario).types == {"t"}
    with SumoSession(scenario) as session:
        assert "t" in session.api.vehicletype.getIDList()
