"""A crash of SUMO while it loads a damaged network ends its own process alone."""

import re
from pathlib import Path

import pytest
from conftest import Cli, CopyScenario

from slrl_sumo.doctor.isolated import examine_isolated
from slrl_sumo.errors import InputError
from slrl_sumo.sumo.net_file import read_net_file
from slrl_sumo.sumo.scenario import find_scenario


@pytest.fixture
def crashing(copy_scenario: CopyScenario) -> Path:
    """The scenario `intersection` without a connection that its junction counts on: libsumo 1.28 dies of it."""
    folder = copy_scenario("intersection").parent
    net = folder / "intersection.net.xml"
    text = net.read_text()
    damaged = re.sub(r'\s*<connection from="in1" to="out2" fromLane="1" toLane="1" via[^>]*/>', "", text, count=1)
    assert damaged != text
    net.write_text(damaged)
    return folder


def test_doctor_outlives_a_crash_of_sumo(crashing: Path, cli: Cli) -> None:
    with pytest.raises(InputError, match="SUMO crashes while loading it"):
        examine_isolated(find_scenario(str(crashing)))
    result = cli("doctor", str(crashing))
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1


def test_a_network_that_crashes_sumo_is_named(crashing: Path) -> None:
    with pytest.raises(InputError, match=r"--net .*intersection\.net\.xml: SUMO crashes while loading it"):
        read_net_file(crashing / "intersection.net.xml")
