"""Where a run ends that has neither steps nor a time to stop at."""

from pathlib import Path

import pytest

from slrl_sumo.simulation.events import Decision, Started
from slrl_sumo.simulation.run import SHORT_RUN, run
from slrl_sumo.simulation.settings import RunSettings

NET = Path(__file__).parents[2] / "sumo_scenarios" / "intersection" / "intersection.net.xml"
CAR = '<vehicle id="a" depart="3"><route edges="in0 out2"/></vehicle>'
PERSON = '<person id="p" depart="8"><walk edges="in0"/></person>'


def played(folder: Path, demand: str, options: str = "", **settings: object) -> tuple[Started, list[Decision]]:
    (folder / "d.rou.xml").write_text(f"<routes>{demand}</routes>")
    files = f'<net-file value="{NET}"/><route-files value="d.rou.xml"/><step-length value="0.4"/>'
    (folder / "x.sumocfg").write_text(f"<configuration>{files}{options}</configuration>")
    started, *rest = run(RunSettings(folder, selector="lane", **settings))  # type: ignore[arg-type]
    assert isinstance(started, Started)
    return started, [event for event in rest if isinstance(event, Decision)]


@pytest.mark.parametrize("settings", [{"takeover": "car=1"}, {"agents": 2}], ids=str)
def test_without_an_end_it_goes_on_until_the_last_road_user_has_left(
    tmp_path: Path, settings: dict[str, object]
) -> None:
    started, decisions = played(tmp_path, CAR + PERSON, **settings)
    assert started.decisions is None
    assert "until its road users have left, at most 24 h" in started.notices[-1]
    others = [{user for user in d.steps[-1].world.ids if user[:8] != "learned_"} for d in decisions]
    assert {"a", "p"} == set().union(*others)
    assert others[-1] == set()
    assert others[-2]
    # The way of about 100 m takes a walking person 70 s.
    assert 100 < len(decisions) < 300


def test_without_traffic_it_has_a_usual_length(tmp_path: Path) -> None:
    started, decisions = played(tmp_path, "", agents=1)
    assert started.decisions == len(decisions) == SHORT_RUN
    assert "neither an end nor traffic" in started.notices[-1]


def test_the_end_of_the_scenario_counts(tmp_path: Path) -> None:
    started, decisions = played(tmp_path, CAR, '<end value="4"/>', agents=1)
    assert started.decisions == len(decisions) == 10
