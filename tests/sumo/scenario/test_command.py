"""The step that SUMO runs with, and what is changed in the user's scenario."""

from pathlib import Path

import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.command import notices, start_command, sumo_step_length
from slrl_sumo.sumo.scenario.options import with_options


def scenario(**options: str) -> Scenario:
    names = {key.replace("__", ".").replace("_", "-"): value for key, value in options.items()}
    return Scenario("town", Path("/somewhere/town.sumocfg"), names)


def after(command: list[str], option: str) -> list[str]:
    return [command[i + 1] for i, word in enumerate(command) if word == option]


@pytest.mark.parametrize("step", [0.4, 0.2, 0.1, 0.05, 0.08, 0.001])
def test_steps_that_divide_the_decision_interval_are_taken(step: float) -> None:
    assert sumo_step_length(scenario(), step) == (step, [])
    assert sumo_step_length(scenario(step_length=str(step)), None) == (step, [])


@pytest.mark.parametrize("step", [0.3, 0.0, -0.2, -0.4, 0.8, 1.0, 0.15, 0.0004, 0.4 / 3, float("nan"), float("inf")])
def test_a_wanted_step_that_does_not_divide_it_is_an_error(step: float) -> None:
    with pytest.raises(InputError, match=r"step_length=.*use 0\.4, 0\.2, 0\.1 or 0\.05"):
        sumo_step_length(scenario(step_length="0.2"), step)


@pytest.mark.parametrize(
    ("options", "named"), [({}, "1 s"), ({"step_length": "1"}, "1 s"), ({"step_length": "0.5"}, "0.5 s")]
)
def test_a_scenario_with_another_step_runs_at_the_decision_interval_and_says_so(
    options: dict[str, str], named: str
) -> None:
    step, lines = sumo_step_length(scenario(**options), None)
    assert step == 0.4
    assert len(lines) == 1
    assert f"SUMO step 0.4 s instead of the scenario's {named}" in lines[0]


def test_a_wanted_step_replaces_that_of_the_scenario() -> None:
    assert sumo_step_length(scenario(step_length="0.5"), 0.1) == (0.1, [])


def test_road_users_are_never_removed_by_sumo() -> None:
    town = scenario(time_to_teleport="120", collision__action="remove", pedestrian__model="jupedsim")
    command = start_command(town, step_length=0.2, seed=5, outputs_to=None)
    assert after(command, "-c") == ["/somewhere/town.sumocfg"]
    assert after(command, "--time-to-teleport") == ["-1"]
    assert after(command, "--collision.action") == ["warn"]
    assert after(command, "--pedestrian.model") == ["striping"]
    assert after(command, "--seed") == ["5"]
    assert after(command, "--step-length") == ["0.2"]
    lines = notices(town, outputs_kept=True)
    assert len(lines) == 3
    for word in ("120 s", "remove", "jupedsim"):
        assert any(word in line for line in lines)


def test_a_scenario_that_needs_no_change_gets_no_notice() -> None:
    calm = scenario(net_file="a.net.xml", time_to_teleport="-1", collision__action="none", pedestrian__model="striping")
    assert notices(calm, outputs_kept=False) == []


def test_outputs_that_are_left_out_are_named() -> None:
    writes = scenario(tripinfo_output="t.xml", summary="s.xml", log="l.txt")
    assert notices(writes, outputs_kept=True) == []
    (line,) = notices(writes, outputs_kept=False)
    for name in ("tripinfo-output", "summary", "log", "--sumo-outputs"):
        assert name in line


def test_mesoscopic_scenarios_are_refused() -> None:
    assert notices(scenario(mesosim="false"), outputs_kept=False) == []
    with pytest.raises(InputError, match=r"town\.sumocfg: mesoscopic"):
        notices(scenario(mesosim="true"), outputs_kept=False)


def test_added_options_reach_sumo_but_what_a_run_needs_goes_first() -> None:
    text = "--lateral-resolution 0.8 --no-internal-links --time-to-teleport=30 --srand 9 -e 50 --min.x -1"
    town = with_options(scenario(end="600", lateral_resolution="0.2"), text.split())
    command = start_command(town, step_length=0.4, seed=5, outputs_to=None)
    for option, value in (
        ("--lateral-resolution", "0.8"),
        ("--no-internal-links", "true"),
        ("--min.x", "-1"),
        ("--end", "50"),
        ("--time-to-teleport", "-1"),
        ("--seed", "5"),
    ):
        assert after(command, option) == [value]
    assert town.seconds("end") == 50.0
    lines = notices(town, outputs_kept=False)
    assert len(lines) == 2
    for word in ("30 s", "--seed"):
        assert any(word in line for line in lines)


def test_an_added_step_counts_as_the_scenarios_own() -> None:
    assert sumo_step_length(with_options(scenario(step_length="1"), ["--step-length", "0.1"]), None) == (0.1, [])


@pytest.mark.parametrize(
    ("words", "reason"), [(["stray"], "'stray' is no option"), (["-c", "x"], "another"), (["-1"], "'-1'")]
)
def test_words_that_are_no_options_are_an_error(words: list[str], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        with_options(scenario(), words)
