"""Links as traffic lights show them."""

import libsumo

from slrl_sumo.sumo.network.links import ShownLinks, read_links
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def test_shown_links_are_those_of_sumo_in_each_phase() -> None:
    with SumoSession(find_scenario("signalised")) as session:
        shown, phases = ShownLinks(libsumo), set[str]()
        for _ in range(400):
            session.step()
            shown.renew()
            for lane in libsumo.lane.getIDList():
                links = {(k.target, k.via): k._replace(is_open=True) for k in read_links(libsumo, lane)}
                assert {key: k._replace(is_open=True) for key, k in shown(lane).items()} == links
            phases.update(map(libsumo.trafficlight.getRedYellowGreenState, libsumo.trafficlight.getIDList()))
    assert len(phases) > 3
