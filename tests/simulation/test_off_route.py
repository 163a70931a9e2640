"""Taken-over road users that leave the network return to their route and are not moved across the map."""

import numpy as np

from slrl_sumo.agent.driver import make_driver
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.region import parse_region
from slrl_sumo.simulation.takeover import Takeover
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def test_lent_cars_that_stray_are_put_on_their_route_and_arrive() -> None:
    with SumoSession(find_scenario("district"), seed=2) as session:
        driver = make_driver("prior", load_bundle("intersection"), session.api, session.network, 2)
        everywhere = Takeover(np.array([1.0, 0.0, 0.0]), parse_region(None, session.network), 2)
        loop = CoSimulation(session, driver, takeover=everywhere)
        loop.start()
        strayed: set[str] = set()
        arrived: set[str] = set()
        for _ in range(500):
            decision = loop.decide()
            assert not decision.wrapped_around.any()
            assert not decision.lost.any()
            assert strayed.isdisjoint(decision.taken_over)
            strayed.update(decision.returned_to_route)
            arrived.update(session.api.simulation.getArrivedIDList())
        present = set(session.api.vehicle.getIDList())
    assert len(strayed) >= 5
    # Returned or under way, none vanished.
    assert len(strayed & arrived) >= 3
    assert strayed <= arrived | present
