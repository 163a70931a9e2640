"""SUMO's persons that wait to cross are seen on the walking area, not on the carriageway."""

import math
from pathlib import Path

import numpy as np
import pytest
from builders import make_crossroads

from slrl_sumo.routing.walking.waiting_persons import WaitingPersons
from slrl_sumo.routing.walking.walking_area import BACK, distance_to
from slrl_sumo.simulation.background_state import background_world
from slrl_sumo.sumo.network import is_walking_area
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """A junction with signals and crossings as netconvert makes it, and persons that cross its arms."""
    persons = "".join(
        f'<person id="{time}" depart="{time}" departPos="60"><walk from="sc" to="{to}" arrivalPos="40"/></person>'
        for time, to in enumerate(("cn", "cw", "ce") * 20)
    )
    options = "--sidewalks.guess", "--crossings.guess"
    return make_crossroads(tmp_path, persons, *options, centre='type="traffic_light"', lanes=2)


def test_persons_that_wait_are_seen_behind_the_kerb(scenario: Path) -> None:
    with SumoSession(find_scenario(str(scenario))) as session:
        areas = {lane.edge: lane.shape for lane in session.network.lanes if is_walking_area(lane.id)}
        persons, off, behind, elsewhere = WaitingPersons(session.api, session.network), [], [], []
        for _ in range(300):
            session.step()
            snapshot = session.reader.read()
            world = background_world(snapshot, session.time, frozenset())
            seen = persons.at_kerb(world, 0)
            for row in range(len(world)):
                places = np.array([[world.x[row], world.y[row]], [seen.x[row], seen.y[row]]])
                if (area := areas.get(snapshot.lane[row])) is not None and snapshot.speed[row] < 0.1:
                    before, after = distance_to(area, places).tolist()
                    off.append(before)
                    behind.append(after)
                else:
                    elsewhere.append(math.dist(*places.tolist()))
        # SUMO has some on the carriageway.
        assert len(off) > 5
        assert max(off) > 0.1
        # At sharp corners an area is narrower than that.
        assert max(behind) < -0.1
        assert np.mean(np.array(behind) < 0.01 - BACK) > 0.5
        assert max(elsewhere) == 0.0
