"""When persons of the scenario become learned."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.scene.contacts import COLLISION_DISTANCE
from slrl_sumo.simulation.events import Decision, Started
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings


def test_persons_that_depart_inside_each_other_are_learned_when_they_are_apart(tmp_path: Path) -> None:
    options = "--grid --grid.number 3 --grid.length 80 --sidewalks.guess --crossings.guess -o n.net.xml"
    run_program("netgenerate", [*options.split(), "--default-junction-type", "traffic_light"], tmp_path)
    # One after the other before a crossing that is red most of the time.
    walk = 'departPos="-0.2"><walk from="A0A1" to="A1A2"/>'
    persons = "".join(f'<person id="{i}" depart="{0.4 * i}" {walk}</person>' for i in range(30))
    (tmp_path / "n.rou.xml").write_text(f"<routes>{persons}</routes>")
    files = '<net-file value="n.net.xml"/><route-files value="n.rou.xml"/><step-length value="0.4"/><end value="60"/>'
    (tmp_path / "n.sumocfg").write_text(f"<configuration>{files}</configuration>")
    before: set[str] = set()
    begun: dict[str, float] = {}
    for event in run(RunSettings(tmp_path / "n.sumocfg", takeover="pedestrian=1", steps=140)):
        if not isinstance(event, Decision):
            continue
        world = event.steps[-1].world
        learned = {world.ids[row] for row in np.flatnonzero(world.learned)}
        places = {name: (world.x[row], world.y[row]) for row, name in enumerate(world.ids)}
        for name in learned - before:
            others = [place for other, place in places.items() if other != name]
            begun[name] = min(math.dist(places[name], place) for place in others) if others else math.inf
        before |= learned
    assert len(begun) == 30
    # They have moved for a decision since; taken over as they depart, half of them would be nearer than 0.2 m.
    assert np.median(list(begun.values())) > COLLISION_DISTANCE - 0.15


@pytest.mark.parametrize("departs", range(3))
def test_a_walk_that_ends_on_an_edge_of_a_few_metres_ends(tmp_path: Path, departs: int) -> None:
    """Lanes for turns have netgenerate cut streets; of the sidewalk 4 m are left beside the junction."""
    drawing = ["--grid", "--grid.number", "3", "--grid.length", "150", "-L", "2", "--turn-lanes", "1"]
    drawing += ["--sidewalks.guess", "--crossings.guess", "--default-junction-type", "traffic_light"]
    run_program("netgenerate", [*drawing, "--no-turnarounds", "-o", "n.net.xml"], tmp_path)
    edges = ("B1A1", "B2B1.130.00"), ("B1B0", "A1B1.130.00"), ("B1C1", "B0B1.130.00")
    walk = f'<walk edges="{" ".join(edges[departs])}"/>'
    (tmp_path / "n.rou.xml").write_text(f'<routes><person id="one" depart="0">{walk}</person></routes>')
    files = '<net-file value="n.net.xml"/><route-files value="n.rou.xml"/>'
    (tmp_path / "n.sumocfg").write_text(f"<configuration>{files}</configuration>")
    decisions = [d for d in run(RunSettings(tmp_path, takeover="pedestrian=1", steps=500)) if isinstance(d, Decision)]
    assert any("one" in d.taken_over for d in decisions)
    assert "one" not in decisions[-1].steps[-1].world.ids


def test_a_run_says_that_sumos_own_outputs_of_walks_are_wrong(tmp_path: Path) -> None:
    def notices(settings: RunSettings) -> list[str]:
        started, *_ = run(settings)
        assert isinstance(started, Started)
        return [notice for notice in started.notices if "a walk for each" in notice]

    options = f"--tripinfo-output {tmp_path / 't.xml'} --vehroute-output {tmp_path / 'v.xml'}"
    settings = RunSettings(
        "intersection", takeover="pedestrian=0.5", steps=1, sumo_outputs=True, sumo_options=options, selector="lane"
    )
    (notice,) = notices(settings)
    assert notice.startswith("SUMO's own tripinfo-output, vehroute-output cannot be used for persons")
    # Without these outputs, or persons that are taken over, there is nothing to say.
    assert not notices(replace(settings, sumo_outputs=False))
    assert not notices(replace(settings, sumo_options=f"--statistic-output {tmp_path / 's.xml'}"))
    assert not notices(replace(settings, takeover="car=1"))
    assert not notices(replace(settings, takeover=None, agents=2))
