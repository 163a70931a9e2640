"""Where road users arrive, in real SUMO."""

import numpy as np

from slrl_sumo.metrics.trip_outcomes import Journeys, outcome
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.background_state import background_world
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def test_sumos_own_arrive_home_and_one_sent_elsewhere_does_not() -> None:
    with SumoSession(find_scenario("intersection"), seed=3) as session:
        api = session.api
        journeys = Journeys(api, session.step_length)
        sent = removed = None
        for _ in range(375):
            session.step()
            world = background_world(session.reader.read(), session.time, frozenset())
            journeys.look(world, session.time)
            if session.time > 100.0:
                continue
            for i in np.flatnonzero([road_user not in journeys.all for road_user in world.ids]).tolist():
                journeys.take(world.ids[i], RoadUserType(world.type[i]), session.time)
            cars = [i for i in api.vehicle.getIDList() if api.vehicle.getRoadID(i).startswith("in")]
            cars = [i for i in cars if i.startswith("passenger") and api.vehicle.getRouteIndex(i) == 0]
            if sent is None and cars:
                sent, route = cars[0], api.vehicle.getRoute(cars[0])
                other = next(f"out{k}" for k in range(4) if f"out{k}" != route[-1] and f"in{k}" != route[0])
                api.vehicle.changeTarget(sent, other)
            elif removed is None and len(cars) > 1:
                removed = cars[-1]
                api.vehicle.remove(removed, 2)
        end = session.time
    fates = {road_user: journey.fate for road_user, journey in journeys.all.items()}
    assert sent is not None
    assert fates[sent] == "elsewhere"
    others = [fate for road_user, fate in fates.items() if road_user not in (sent, removed)]
    assert set(others) <= {"home", "inside"}
    assert others.count("home") > 8
    kinds = {journey.type for journey in journeys.all.values() if journey.fate == "home"}
    assert kinds >= {RoadUserType.CAR, RoadUserType.PEDESTRIAN}
    assert all(10.0 < j.inside_s < end for j in journeys.all.values() if j.fate == "home")
    assert outcome(journeys.all.values(), end, 120.0, 0).on_route == others.count("home")


def test_stays_add_up_and_fates_keep_what_they_were_at_the_end_of_the_takeover() -> None:
    with SumoSession(find_scenario("intersection"), seed=3) as session:
        api = session.api
        journeys = Journeys(api, session.step_length)
        while not api.vehicle.getIDCount() or not api.vehicle.getLaneID(api.vehicle.getIDList()[0]):
            session.step()
        car = api.vehicle.getIDList()[0]
        journeys.take(car, RoadUserType.CAR, 10.0)
        journeys.give_back(car, 14.0, strayed=False, inside=False)
        assert journeys.all[car].fate == "left"
        journeys.take(car, RoadUserType.CAR, 20.0)
        assert journeys.all[car].fate == "inside"
        journeys.give_back(car, 23.0, strayed=False, inside=False)
        assert journeys.all[car].inside_s == 7.0
        journeys.take(car, RoadUserType.CAR, 30.0)
        journeys.close()
        journeys.give_back(car, 31.0, strayed=False, inside=False)
        assert journeys.all[car].fate == "inside"
        while journeys.under_way:
            session.step()
            journeys.look(background_world(session.reader.read(), session.time, frozenset()), session.time)
    assert (journeys.all[car].fate, journeys.all[car].after) == ("inside", "home")
