"""Taken-over road users that leave the network return to their route and are not moved across the map."""

from pathlib import Path

import numpy as np
from builders import make_scenario

from slrl_sumo.agent.make_driver import make_driver
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
        cosimulation = CoSimulation(session, driver, takeover=everywhere)
        cosimulation.start()
        strayed: set[str] = set()
        arrived: set[str] = set()
        for _ in range(500):
            decision = cosimulation.decide()
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


def _streets(folder: Path) -> Path:
    """A street of three edges, and two cars: "ends" 2 m before its destination, "turns" around 1 m on."""
    nodes = "".join(f'<node id="{name}" x="{x}" y="0"/>' for name, x in (("a", 0), ("b", 100), ("c", 120), ("d", 300)))
    edges = "".join(
        f'<edge id="{way}" from="{way[0]}" to="{way[1]}" speed="13.9"/>' for way in ("ab", "ba", "bc", "cd")
    )
    users = (
        '<vehicle id="ends" depart="0" departPos="-2" departSpeed="13"><route edges="bc"/></vehicle>'
        '<vehicle id="turns" depart="0" departPos="-1"><route edges="ab ba"/></vehicle>'
    )
    return make_scenario(folder, nodes, edges, users)


def test_cars_that_depart_just_before_a_turn_or_their_destination_arrive(tmp_path: Path) -> None:
    with SumoSession(find_scenario(str(_streets(tmp_path))), seed=1) as session:
        driver = make_driver("rule", load_bundle("intersection"), session.api, session.network, 1)
        everywhere = Takeover(np.array([1.0, 0.0, 0.0]), parse_region(None, session.network), 1)
        cosimulation = CoSimulation(session, driver, takeover=everywhere)
        cosimulation.start()
        arrived: set[str] = set()
        turned = 0
        for _ in range(100):
            decision = cosimulation.decide()
            assert not decision.lost.any()
            assert not decision.returned_to_route
            world = cosimulation.world
            headings = [world.heading[world.ids.index(car)] for car in decision.taken_over if car == "turns"]
            # Back on the street, not while it still turns.
            assert np.allclose(np.abs(headings), np.pi, atol=0.05)
            turned += len(headings)
            arrived.update(session.api.simulation.getArrivedIDList())
    assert arrived == {"ends", "turns"}
    assert turned == 1


def test_a_car_that_stands_in_a_junction_is_learned_there_and_goes_on(tmp_path: Path) -> None:
    """Another one that it stands before would wait for it for ever."""
    nodes = "".join(f'<node id="{n}" x="{x}" y="{y}"/>' for n, x, y in (("a", 0, 0), ("b", 24, 0), ("c", 24, 200)))
    nodes += '<node id="d" x="300" y="0"/>'
    edges = "".join(f'<edge id="{e}" from="{e[0]}" to="{e[1]}" speed="13.9"/>' for e in ("ab", "bc", "cb", "bd", "db"))
    car = '<vehicle id="car" depart="0" departPos="-1" departSpeed="3"><route edges="ab bd"/></vehicle>'
    with SumoSession(find_scenario(str(make_scenario(tmp_path, nodes, edges, car))), seed=1) as session:
        driver = make_driver("rule", load_bundle("intersection"), session.api, session.network, 1)
        everywhere = Takeover(np.array([1.0, 0.0, 0.0]), parse_region(None, session.network), 1)
        cosimulation = CoSimulation(session, driver, takeover=everywhere)
        cosimulation.start()
        vehicle, began, arrived = session.api.vehicle, set[str](), set[str]()
        for _ in range(100):
            inside = "car" in vehicle.getIDList() and vehicle.getLaneID("car").startswith(":")
            if inside and not began:
                assert "car" not in cosimulation.population.ids
                vehicle.setSpeed("car", 0.0)
            if cosimulation.decide().taken_over:
                began.add(vehicle.getLaneID("car"))
            arrived.update(session.api.simulation.getArrivedIDList())
    assert [lane.startswith(":") for lane in began] == [True]
    assert arrived == {"car"}
