"""Files of a situation: a network that netconvert builds from a plan, its demand and a .sumocfg."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lxml import etree

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.netgen.plan import Edge, Node, Plan, write_plan

SPEED_LIMIT = 13.89
"""m/s: speed limit of all roads, 50 km/h."""
CONFIG = "flow.sumocfg"
TYPES = """<vType id="car" vClass="passenger"/>
<vType id="exact" vClass="passenger" sigma="0" speedDev="0"/>
<vType id="rider" vClass="bicycle" sigma="0" speedDev="0"/>"""
"""`car`: SUMO's default driver. `exact`, `rider`: drivers without imperfection that go exactly as fast as they may."""


def road(start: str, end: str, lanes: int = 1, speed: float = SPEED_LIMIT) -> Edge:
    """One direction of a road with car lanes."""
    return Edge(start, end, speed, ({},) * lanes)


def nodes(places: dict[str, tuple[float, float]], **kinds: str) -> dict[str, Node]:
    """Nodes at `places` (m); `kinds`: their types, `priority` where none is given."""
    return {name: Node(x, y, kinds.get(name, "priority")) for name, (x, y) in places.items()}


def element(tag: str, **attributes: Any) -> str:
    """An XML element without content; a trailing underscore of a name is dropped (`from_`)."""
    made = etree.Element(tag, {name.rstrip("_"): str(value) for name, value in attributes.items()})
    return etree.tostring(made, encoding="unicode")


def flow(name: str, start: str, end: str, per_hour: float, **attributes: Any) -> str:
    """Cars with Poisson arrivals from edge `start` to edge `end`, that enter at the highest possible speed."""
    usual = {"type": "car", "departLane": "best", "departSpeed": "max", "begin": 0, "end": 3600}
    period = f"exp({per_hour / 3600.0:.6f})"
    return element("flow", id=name, from_=start, to=end, period=period, **(usual | attributes))


def write_situation(
    folder: Path,
    plan: Plan,
    demand: Sequence[str],
    seconds: float,
    *,
    options: Sequence[str] = (),
    connections: str = "",
    additional: str = "",
) -> Path:
    """Write network, demand and configuration into `folder`; returns the .sumocfg.

    `demand`: elements of the routes file, in the order of their departures; `options`: of netconvert; `connections`,
    `additional`: elements of such files. Raises NetgenError where netconvert fails.
    """
    words = write_plan(plan, folder)
    if connections:
        (folder / "flow.con.xml").write_text(f"<connections>{connections}</connections>\n")
        words += ["--connection-files", "flow.con.xml"]
    run_program("netconvert", [*words, "--no-turnarounds", "--output-file", "flow.net.xml", *options], folder)
    if additional:
        (folder / "flow.add.xml").write_text(f"<additional>{additional}</additional>\n")
    return write_demand(folder, demand, seconds, additional="flow.add.xml" if additional else "")


def write_demand(folder: Path, demand: Sequence[str], seconds: float, *, additional: str = "") -> Path:
    """Write demand and configuration for flow.net.xml in `folder`; see `write_situation`."""
    (folder / "flow.rou.xml").write_text("\n".join(["<routes>", TYPES, *demand, "</routes>"]) + "\n")
    return write_config(folder, seconds, additional=additional)


def write_config(
    folder: Path, seconds: float, *, net: str = "flow.net.xml", routes: str = "flow.rou.xml", additional: str = ""
) -> Path:
    """Write a .sumocfg into `folder`; the names of files are absolute, or relative to it, with commas between them."""
    named = {"net-file": net, "route-files": routes} | ({"additional-files": additional} if additional else {})
    inputs = "".join(element(option, value=value) for option, value in named.items())
    times = element("end", value=f"{seconds:g}") + element("step-length", value="0.4")
    processing = element("ignore-route-errors", value="true")
    config = folder / CONFIG
    config.write_text(
        f"<configuration><input>{inputs}</input><time>{times}</time><processing>{processing}</processing>"
        "</configuration>\n"
    )
    return config
