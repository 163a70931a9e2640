"""Networks that are odd, but that SUMO loads: learned road users run in them."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.simulation.events import Decision
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.sumo.taken_over.persons import INFINITELY_WIDE

Cli = Callable[..., subprocess.CompletedProcess[str]]

CROSS = ["--grid", "--grid.number", "2", "--default.speed", "8"]
DEMAND = "<flow id='f{0}' begin='0' end='20' period='4' from='{0}' to='{1}'/>"
LANES = re.compile(r'<lane id="[^:"][^>]*>')


def scenario(folder: Path, *options: str, lanes: str = "") -> Path:
    """A grid with cars on it; `lanes`: an attribute of every second lane, as other programs write it."""
    run_program("netgenerate", [*CROSS, *options, "-o", "n.net.xml"], folder)
    net = folder / "n.net.xml"
    if lanes:
        name, count = lanes.partition("=")[0], iter(range(10**6))
        bare = re.compile(rf' {name}="[^"]*"')
        text = LANES.sub(
            lambda lane: bare.sub("", lane[0]).replace("<lane ", f"<lane {lanes} ") if next(count) % 2 else lane[0],
            net.read_text(),
        )
        net.write_text(text)
    (folder / "n.rou.xml").write_text(f"<routes>{DEMAND.format('A0A1', 'B1B0')}</routes>")
    config = folder / "n.sumocfg"
    files = '<net-file value="n.net.xml"/><route-files value="n.rou.xml"/><step-length value="0.4"/>'
    config.write_text(f"<configuration>{files}<ignore-route-errors value='true'/></configuration>")
    return config


@pytest.mark.parametrize(
    ("options", "lanes"),
    [
        (["--default.disallow", "pedestrian"], ""),
        (["--no-internal-links"], ""),
        (["--lefthand", "--sidewalks.guess", "--crossings.guess"], ""),
        ([], 'width="0"'),
        ([], 'width="inf"'),
        ([], 'width="-1"'),
        ([], 'allow="-1"'),
        ([], 'allow="tram"'),
        ([], 'speed="0"'),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else value,
)
def test_learned_road_users_run_in_it(tmp_path: Path, options: list[str], lanes: str) -> None:
    config = scenario(tmp_path, *options, lanes=lanes)
    settings = RunSettings(config, agents=4, takeover="car=1", selector="prior", steps=12)
    decisions = [event for event in run(settings) if isinstance(event, Decision)]
    assert len(decisions) == 12
    assert not any(decision.lost.any() for decision in decisions)
    assert all(sum(user.startswith("learned_") for user in decision.steps[-1].world.ids) == 4 for decision in decisions)


@pytest.mark.parametrize("options", [["8"], ["12", "--default.lanenumber", "3", "--sidewalks.guess"]], ids=" ".join)
def test_streets_may_be_shorter_than_a_metre(cli: Cli, tmp_path: Path, options: list[str]) -> None:
    config = scenario(tmp_path, "--grid.length", *options)
    done = cli("run", config, "--agents", 4, "--takeover", "car=1", "--selector", "prior", "--steps", 12)
    assert (done.returncode, done.stderr.count("Traceback")) == (0, 0), done.stderr
    assert " 0 lost" in done.stdout


def test_a_person_before_a_lane_of_infinite_width_is_handed_to_sumo(tmp_path: Path) -> None:
    """SUMO has persons on such a lane at infinity: they were lost."""
    config = scenario(tmp_path, lanes='width="inf"')
    routes = tmp_path / "n.rou.xml"
    walks = "<personFlow id='p' begin='0' end='6' period='1'><walk from='A0A1' to='B1B0'/></personFlow></routes>"
    routes.write_text(routes.read_text().replace("</routes>", walks))
    settings = RunSettings(config, takeover="pedestrian=1", selector="lane", steps=200)
    decisions = [event for event in run(settings) if isinstance(event, Decision)]
    assert not any(decision.lost.any() for decision in decisions)
    reasons = {reason for decision in decisions for _, reason in decision.refused}
    assert reasons == {INFINITELY_WIDE}
