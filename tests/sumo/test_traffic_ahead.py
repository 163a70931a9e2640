"""Signals, leaders and limits against what the network says."""

import numpy as np
import pytest

from slrl_sumo.agent.driver import make_driver
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.simulation.cosimulation import CoSimulation, Takeover
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.traffic_ahead import traffic_ahead


def test_taken_over_cars_see_signals_leaders_and_limits_in_the_signalised_scenario() -> None:
    seen_red = seen_green = seen_leader = 0
    with SumoSession(find_scenario("signalised"), seed=3) as session:
        driver = make_driver("lane", load_bundle("intersection"), session.api, session.network, 3)
        rule = Takeover(np.array([1.0, 0.0, 0.0]), parse_region(None, session.network), 3)
        loop = CoSimulation(session, driver, takeover=rule)
        loop.start()
        lanes = {lane.id: lane for lane in session.network.lanes}
        stop_lines = {lane: np.array(session.api.lane.getShape(lane)[-1]) for lane in lanes if lane.startswith("in")}
        for _ in range(150):
            loop.decide()
            ids = loop.population.world.ids
            rows, ahead = loop.traffic_ahead()
            assert rows.tolist() == list(range(len(ids)))
            for row, vehicle in enumerate(ids):
                lane = session.api.vehicle.getLaneID(vehicle)
                assert ahead.speed_limit[row] == pytest.approx(lanes[lane].max_speed)
                if lane not in stop_lines:
                    continue
                # On an arm the distance to the signal is the way to the end of the lane.
                assert ahead.has_signal[row]
                front = np.array(session.api.vehicle.getPosition(vehicle))
                assert ahead.signal_distance[row] == pytest.approx(np.hypot(*(stop_lines[lane] - front)), abs=1.0)
                link = session.api.vehicle.getNextTLS(vehicle)[0]
                state = session.api.trafficlight.getRedYellowGreenState(link[0])[link[1]]
                assert ahead.signal_red[row] == (state in "ru")
                assert ahead.signal_yellow[row] == (state in "yY")
                seen_red += bool(ahead.signal_red[row])
                seen_green += not (ahead.signal_red[row] or ahead.signal_yellow[row])
                seen_leader += bool(ahead.has_leader[row] and ahead.leader_gap[row] < 20)
    assert seen_red > 20
    assert seen_green > 20
    assert seen_leader > 20


def test_road_users_without_a_route_have_a_limit_and_masks_instead_of_made_up_values() -> None:
    with SumoSession(find_scenario("signalised"), seed=3) as session:
        driver = make_driver("prior", load_bundle("intersection"), session.api, session.network, 3)
        loop = CoSimulation(session, driver)
        loop.spawn(np.array([3, 0, 0]), load_bundle("intersection").max_speed, 3)
        loop.start()
        loop.decide()
        ahead = traffic_ahead(session.api, loop.population.world.ids)
    assert ahead.has_limit.any()
    assert np.all(ahead.speed_limit[~ahead.has_limit] == 0)
    assert np.all(ahead.leader_gap[~ahead.has_leader] == 0)
    assert np.all(ahead.signal_distance[~ahead.has_signal] == 0)
