"""When persons of the scenario become learned."""

import math
from pathlib import Path

import numpy as np

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.scene.contacts import COLLISION_DISTANCE
from slrl_sumo.simulation.events import Decision
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
