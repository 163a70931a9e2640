"""Vehicle types that are read with a network."""

import pytest

from slrl_sumo.sumo.net_file import find_net, read_net_motors


def test_types_of_a_scenario_have_the_speeds_that_they_want() -> None:
    net, scenario = find_net("signalised")
    network, motors = read_net_motors(net, scenario)
    assert network.lanes
    assert motors["bicycle0"].max_speed == 5.29  # desiredMaxSpeed of the route file
    assert motors["bicycle0"].emission_class == "Zero/default"
    assert motors["DEFAULT_BIKETYPE"].max_speed == pytest.approx(20.0 / 3.6)
    assert motors["DEFAULT_VEHTYPE"].max_speed == pytest.approx(200.0 / 3.6)
    assert motors["DEFAULT_VEHTYPE"].emission_class.startswith("HBEFA4/PC")


def test_a_network_alone_has_sumos_default_types() -> None:
    _, motors = read_net_motors(find_net("signalised")[0], None)
    assert "DEFAULT_VEHTYPE" in motors
    assert not any(name.startswith("bicycle") for name in motors)
