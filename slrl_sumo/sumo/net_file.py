"""Networks from files without a scenario."""

import tempfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

from slrl_sumo.errors import InputError
from slrl_sumo.sumo.isolation import isolated
from slrl_sumo.sumo.links import SignalLink, signal_links
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.scenario import Scenario, find_scenario, read_scenario
from slrl_sumo.sumo.scenario.options import input_files
from slrl_sumo.sumo.session import SumoSession


def read_net_file(net: Path) -> Network:
    """The network of a .net.xml or .net.xml.gz, read in a child process. Raises InputError (about --net) where SUMO
    cannot read it."""
    return read_net_signals(net)[0]


def read_net_signals(net: Path) -> tuple[Network, list[SignalLink]]:
    """The network as `read_net_file` reads it, with the links that traffic lights control."""
    if not net.exists():
        raise InputError(f"--net {net}: there is no such file; give a SUMO network (.net.xml)")
    with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder:
        config = Path(folder) / "net.sumocfg"
        config.write_text(
            f"<configuration><input><net-file value={quoteattr(str(net.absolute()))}/></input></configuration>",
            encoding="utf-8",
        )
        try:
            return isolated(_network, config, config)
        except InputError as error:
            reason = str(error).removeprefix(f"{config}: ").removeprefix(f"{net.absolute()}: ")
            raise InputError(f"--net {net}: {reason}") from None


def _network(config: Path) -> tuple[Network, list[SignalLink]]:
    with SumoSession(read_scenario(config)) as session:
        return session.network, signal_links(session.api)


def find_net(text: str, argument: str = "--net ") -> tuple[Path, Scenario | None]:
    """The network file that `text` names; with the scenario, if it names one (shipped, a folder, or a .sumocfg).

    `argument`: what messages begin with."""
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
