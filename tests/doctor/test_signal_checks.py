"""Yellow that is too short, in the shipped scenario `signalised`."""

import pytest

from slrl_sumo.doctor.diagnosis import examine
from slrl_sumo.doctor.signal_checks import needed_yellow
from slrl_sumo.sumo.scenario import find_scenario, read_scenario
from tests.conftest import CopyScenario

PROGRAM = """<additional><tlLogic id="centre" type="static" programID="other" offset="0">
<phase duration="20" state="gGggGGgrrrrrrrrrrrrrrrrrrrrrrGrG"/>
<phase duration="{first}" state="yyyyyyyrrrrrrrrrrrrrrrrrrrrrrrrr"/>
<phase duration="1" state="yyyyyyyrrrrrrrrrrrrrrrrrrrrrrrrr"/>
<phase duration="20" state="rrrrrrrgGggGGgGggGGgGggGGgrrGrGr"/>
<phase duration="4" state="rrrrrrryyyyyyyyyyyyyyyyyyyrrrrrr"/>
</tlLogic></additional>"""


@pytest.mark.parametrize(("first", "short"), [(0.5, True), (2.0, False)])
def test_yellow_that_is_too_short_is_named(copy_scenario: CopyScenario, first: float, short: bool) -> None:
    config = copy_scenario("signalised", (".sumocfg", "<input>", '<input><additional-files value="program.add.xml"/>'))
    (config.parent / "program.add.xml").write_text(PROGRAM.format(first=first))
    found = [finding for finding in examine(read_scenario(config)) if finding.topic == "yellow"]
    # Two phases of yellow follow each other: their durations add up.
    assert [finding.severity for finding in found] == (["warning"] if short else [])
    if short:
        assert "1 signal shows yellow" in found[0].what
        assert f"centre, {first + 1:g} s" in found[0].what


def test_needed_yellow_grows_with_speed() -> None:
    assert needed_yellow(0.0) == 0.0
    # Usual at 50 km/h: 3 s, of which 1 s is for the reaction; here it takes 0.4 s.
    assert 2.0 < needed_yellow(13.89) < 3.0
    assert needed_yellow(19.44) > needed_yellow(13.89)
    assert not [f for f in examine(find_scenario("signalised")) if f.topic == "yellow"]
