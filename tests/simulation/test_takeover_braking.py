"""When vehicles become learned that SUMO brakes harder than learned models can."""

from pathlib import Path

import pytest
from builders import make_crossroads

from slrl_sumo.simulation.events import Decision
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings

ARM = '<route edges="wc ce"/>'
CAR = (
    '<vType id="hard" accel="5" decel="10" sigma="0"/>'
    f'<vehicle id="car" type="hard" depart="5" departPos="{{}}" departSpeed="13.5">{ARM}</vehicle>'
)
"""A car that departs at 13.5 m/s; SUMO brakes it by up to 10 m/s²."""
STANDING = (
    f'<vehicle id="standing" depart="0" departPos="80">{ARM}<stop lane="wc_0" endPos="80" duration="60"/></vehicle>'
)
STOP_LINE = 92.0
"""m along the arm: the junction begins here or later."""
LENGTH = 5.0
"""m of all cars."""


@pytest.mark.parametrize(
    ("place", "others", "most"), [(75, "", STOP_LINE), (49, STANDING, 80.0 - LENGTH)], ids=["signal", "leader"]
)
def test_a_vehicle_that_departs_too_near_is_learned_when_it_can_stop(
    tmp_path: Path, place: float, others: str, most: float
) -> None:
    """Both the red signal and the leader are so near that 5.2 m/s² and more are needed."""
    times = '<step-length value="0.4"/><end value="40"/>'
    config = make_crossroads(
        tmp_path, others + CAR.format(place), centre='type="traffic_light"' if not others else "", settings=times
    )
    fronts, learned = [], []
    for event in run(RunSettings(config, takeover="car=1", steps=80)):
        if isinstance(event, Decision):
            world = event.steps[-1].world
            if "car" in world.ids:
                row = world.ids.index("car")
                fronts.append(world.x[row] + 0.5 * LENGTH)
                learned.append(bool(world.learned[row]))
    assert max(fronts) < most
    assert learned[-1]
    assert not any(learned[:2])
