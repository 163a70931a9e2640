"""Networks from files without a scenario."""

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar
from xml.sax.saxutils import quoteattr

from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.scene.types import SPAWNED_PREFIX
from slrl_sumo.sumo.isolation import isolated
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.links import LaneLinks, SignalLink, signal_links
from slrl_sumo.sumo.road_users import Motor, motors
from slrl_sumo.sumo.scenario import Scenario, find_scenario, read_scenario
from slrl_sumo.sumo.scenario.options import input_files
from slrl_sumo.sumo.scenario.trace_types import trace_types
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.vehicle_classes import DESIRED_SPEEDS

Answer = TypeVar("Answer")


def read_net_file(net: Path) -> Network:
    """The network of a .net.xml or .net.xml.gz, read in a child process. Raises InputError (about --net) if SUMO cannot
    read it."""
    return read_net_signals(net)[0]


def read_net_signals(net: Path) -> tuple[Network, list[SignalLink]]:
    """The network from `read_net_file`, and the links that traffic lights control."""
    return _read(_network, net, None)


def read_net_lanes(net: Path) -> tuple[Network, dict[str, tuple[str, ...]]]:
    """The network from `read_net_file`, and the ids of the lanes that follow each lane, also inside junctions."""
    return _read(_lanes, net, None)


def read_net_motors(net: Path, scenario: Scenario | None) -> tuple[Network, Mapping[str, Motor]]:
    """The network from `read_net_file`, and SUMO's default vehicle types and those of the scenario, by id.

    Top speeds are limited to the desired speeds of the types on a free road.
    """
    types = etree.Element("additional") if scenario is None else trace_types(scenario)
    for vtype in list(types):
        if vtype.get("id", "").startswith(SPAWNED_PREFIX):  # which the session defines itself
            types.remove(vtype)
    network, found = _read(_motors, net, etree.tostring(types))
    wanted = {vtype.get("id", ""): float(speed) for vtype in types if (speed := vtype.get("desiredMaxSpeed"))}
    return network, {name: _wanting(motor, wanted.get(name)) for name, motor in found.items()}


def _wanting(motor: Motor, speed: float | None) -> Motor:
    usual = DESIRED_SPEEDS.get(motor.vehicle_class, motor.max_speed)
    return motor._replace(max_speed=min(motor.max_speed, usual if speed is None else speed))


def _read(read: Callable[[Path], Answer], net: Path, additional: bytes | None) -> Answer:
    """The result of `read` in a simulation of only the network, with an additional file of the content `additional`."""
    if not net.exists():
        raise InputError(f"--net {net}: there is no such file; give a SUMO network (.net.xml)")
    with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder:
        config = Path(folder) / "net.sumocfg"
        inputs = f"<net-file value={quoteattr(str(net.absolute()))}/>"
        if additional is not None:
            (Path(folder) / "types.add.xml").write_bytes(additional)
            inputs += '<additional-files value="types.add.xml"/>'
        config.write_text(f"<configuration><input>{inputs}</input></configuration>", encoding="utf-8")
        try:
            return isolated(read, config, config)
        except InputError as error:
            reason = str(error).removeprefix(f"{config}: ").removeprefix(f"{net.absolute()}: ")
            raise InputError(f"--net {net}: {reason}") from None


def _network(config: Path) -> tuple[Network, list[SignalLink]]:
    with SumoSession(read_scenario(config)) as session:
        return session.network, signal_links(session.api)


def _lanes(config: Path) -> tuple[Network, dict[str, tuple[str, ...]]]:
    with SumoSession(read_scenario(config)) as session:
        links = LaneLinks(session.api, session.network)
        following = {
            lane.id: tuple(dict.fromkeys(via or target for target, via in links(lane.id)))
            for lane in session.network.lanes
        }
        return session.network, following


def _motors(config: Path) -> tuple[Network, dict[str, Motor]]:
    with SumoSession(read_scenario(config)) as session:
        return session.network, motors(session.api)


def find_net(text: str, argument: str = "--net ") -> tuple[Path, Scenario | None]:
    """The network file that `text` names, and the scenario, if `text` names a scenario (shipped, folder or .sumocfg).

    `argument`: begin of messages."""
    path = Path(text)
    if path.is_file() and path.suffix != ".sumocfg":
        return path, None
    if path.name.endswith((".xml", ".xml.gz")):
        raise InputError(
            f"{argument}{text}: there is no such file; give a SUMO network (.net.xml), .sumocfg or shipped name"
        )
    try:
        scenario = find_scenario(text)
    except InputError as error:
        raise InputError(f"{argument}{error}") from None
    nets = input_files(scenario, "net-file")
    if len(nets) != 1:
        raise InputError(f"{argument}{text}: {scenario.config} names no network; give its .net.xml")
    return nets[0], scenario
