"""Where road users arrive, in real SUMO."""

import numpy as np

from benchmarks.takeover.trip_outcomes import TakenTrips, count_outcomes
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.background_state import background_world
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def test_sumos_own_arrive_home_and_one_sent_elsewhere_does_not() -> None:
    with SumoSession(find_scenario("intersection"), seed=3) as session:
        api = session.api
        trips = TakenTrips(api, session.step_length)
        sent = removed = None
        for _ in range(375):
            session.step()
            world = background_world(session.reader.read(), session.time, frozenset())
            trips.update(world, session.time)
            if session.time > 100.0:
                continue
            for i in np.flatnonzero([road_user not in trips.all for road_user in world.ids]).tolist():
                trips.take(world.ids[i], RoadUserType(world.type[i]), session.time)
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
    fates = {road_user: trip.fate for road_user, trip in trips.all.items()}
    assert sent is not None
    assert fates[sent] == "elsewhere"
    others = [fate for road_user, fate in fates.items() if road_user not in (sent, removed)]
    assert set(others) <= {"arrived", "inside"}
    assert others.count("arrived") > 8
    kinds = {trip.type for trip in trips.all.values() if trip.fate == "arrived"}
    assert kinds >= {RoadUserType.CAR, RoadUserType.PEDESTRIAN}
    assert all(10.0 < j.inside_s < end for j in trips.all.values() if j.fate == "arrived")
    assert count_outcomes(trips.all.values(), end, 120.0, 0).on_route == others.count("arrived")


def test_stays_add_up_and_fates_keep_what_they_were_at_the_end_of_the_takeover() -> None:
    with SumoSession(find_scenario("intersection"), seed=3) as session:
        api = session.api
        trips = TakenTrips(api, session.step_length)
        while not api.vehicle.getIDCount() or not api.vehicle.getLaneID(api.vehicle.getIDList()[0]):
            session.step()
        car = api.vehicle.getIDList()[0]
        trips.take(car, RoadUserType.CAR, 10.0)
        trips.give_back(car, 14.0, returned_to_route=False, inside=False)
        assert trips.all[car].fate == "left"
        trips.take(car, RoadUserType.CAR, 20.0)
        assert trips.all[car].fate == "inside"
        trips.give_back(car, 23.0, returned_to_route=False, inside=False)
        assert trips.all[car].inside_s == 7.0
        trips.take(car, RoadUserType.CAR, 30.0)
        trips.close()
        trips.give_back(car, 31.0, returned_to_route=False, inside=False)
        assert trips.all[car].fate == "inside"
        while trips.under_way:
            session.step()
            trips.update(background_world(session.reader.read(), session.time, frozenset()), session.time)
    assert (trips.all[car].fate, trips.all[car].after) == ("inside", "arrived")
