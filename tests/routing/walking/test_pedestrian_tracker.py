"""Pedestrians at the signals of crossings, in `signalised`."""

import math

import libsumo
import pytest

from slrl_sumo.routing.walking.pedestrian_tracker import ASTRAY, KERB, PAST, PedestrianTracker
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def _show(state: str) -> None:
    light = libsumo.trafficlight.getIDList()[0]
    libsumo.trafficlight.setRedYellowGreenState(light, state * len(libsumo.trafficlight.getRedYellowGreenState(light)))


@pytest.mark.parametrize("seen_green", [True, False])
def test_one_past_the_kerb_goes_on_at_red_if_it_was_green_then(seen_green: bool) -> None:
    with SumoSession(find_scenario("signalised"), seed=1) as session:
        libsumo.person.add("walker", "in0", 70.0, typeID="pedestrian1")
        libsumo.person.appendWalkingStage("walker", ["in0", "out2"], 25.0)
        session.step()
        tracker = PedestrianTracker(libsumo, session.network)

        def asked(s: float, state: str) -> tuple[float, float, bool]:
            _show(state)
            tracker.renew()
            x, y, heading = path.line.at(s)
            track.s = s
            return tracker.next_signal(tracker.observed("walker", x, y, heading))

        track = tracker.observed("walker", *libsumo.person.getPosition("walker"), 0.0)
        path = track.path
        assert path is not None
        entry = path.crossings[0]
        assert entry.wait + PAST < entry.s + KERB
        assert asked(entry.wait - 1.0, "r")[0] == pytest.approx(1.0, abs=0.1)
        assert asked(entry.wait - 1.0, "G")[0] == math.inf
        # Before the kerb the signal counts, whatever it has been.
        assert asked(entry.wait + 0.5 * PAST, "G")[0] == math.inf
        stop, line, red = asked(entry.wait + 0.5 * PAST, "r")
        assert (stop < 0.0, red) == (True, True)
        assert line == pytest.approx(entry.s - entry.wait - 0.5 * PAST, abs=0.1)
        beyond = entry.wait + PAST + 0.1
        if seen_green:
            assert asked(beyond, "G")[0] == math.inf
            # On the way over the street: at most the next crossing counts.
            assert asked(beyond, "r")[1] > KERB + 1.0
        else:
            stop, _, red = asked(beyond, "r")
            assert (stop < 0.0, red) == (True, True)


def test_one_off_its_path_gets_another_one() -> None:
    """Behind the corner at which it should have turned, it turns back; it would walk beside the old path otherwise."""
    with SumoSession(find_scenario("signalised"), seed=1) as session:
        libsumo.person.add("walker", "in0", 70.0, typeID="pedestrian1")
        libsumo.person.appendWalkingStage("walker", ["in0", "out1"], 25.0)
        session.step()
        tracker = PedestrianTracker(libsumo, session.network)
        track = tracker.observed("walker", *libsumo.person.getPosition("walker"), 0.0)
        path = track.path
        assert path is not None
        left = tracker.remaining_distance("walker")
        x, y, heading = path.line.at(path.ends[0])
        for distance, moved in zip((ASTRAY - 0.5, ASTRAY + 0.5), (False, True), strict=True):
            place = x + distance * math.sin(heading), y - distance * math.cos(heading)
            if path.line.place(*place, 0.0, path.line.end)[2] < distance - 0.2:  # the path turns to that side
                place = x - distance * math.sin(heading), y + distance * math.cos(heading)
            track.s = path.ends[0]
            assert tracker.observed("walker", *place, heading) is track
            assert (track.path is not path) == moved
        assert track.path is not None
        assert track.path.line.place(*place, 0.0, track.path.line.end)[2] < 2.0
        assert track.path.line.at(track.path.line.end) == pytest.approx(path.line.at(path.line.end))
        assert tracker.remaining_distance("walker") < left
