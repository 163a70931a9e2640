"""Examines a scenario before learned road users run in it: what will cause trouble, and how to correct it."""

from collections.abc import Iterator

from slrl_sumo.doctor.demand_checks import demand_findings, output_findings, unknown_names
from slrl_sumo.doctor.finding import Finding, Severity, counted, some
from slrl_sumo.doctor.model_checks import fast_lane_findings, turn_findings
from slrl_sumo.doctor.option_checks import missing_inputs, option_findings
from slrl_sumo.doctor.signal_checks import signal_findings
from slrl_sumo.doctor.versions import version_findings
from slrl_sumo.errors import InputError
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.scene.types import DEFAULT_LENGTH, TYPE_NAMES, RoadUserType
from slrl_sumo.simulation.placement.spawn import legal_lanes, starting_points
from slrl_sumo.sumo.network import LANE_WIDTH, Network
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.demand import Demand, read_demand
from slrl_sumo.sumo.scenario.loaded_files import overtaking_lanes
from slrl_sumo.sumo.scenario.options import input_files
from slrl_sumo.sumo.session import SumoSession

__all__ = ["SEVERITIES", "Finding", "examine"]

SEVERITIES: tuple[Severity, ...] = ("problem", "warning", "note", "ok")
"""The gravest first."""


def examine(scenario: Scenario) -> list[Finding]:
    """Everything that matters to a run with learned road users in `scenario`, the gravest first.

    Reads its files, then loads it with SUMO (without a step) where nothing forbids that; nothing is written.
    """
    demand = read_demand(scenario)
    findings = list(missing_inputs(scenario))
    startable = not findings and not demand.unreadable
    try:
        findings += option_findings(scenario)
        findings += demand_findings(scenario, demand)
        findings += output_findings(scenario, demand)
    except InputError as error:
        findings.append(Finding("problem", "options", str(error), "correct the option"))
        startable = False
    findings += version_findings(scenario)
    if startable and not any(f.severity == "problem" and f.topic == "end" for f in findings):
        findings += _loaded_findings(scenario, demand)
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))


def _loaded_findings(scenario: Scenario, demand: Demand) -> Iterator[Finding]:
    try:
        with SumoSession(scenario) as session:
            network = session.network
            beyond = [
                *turn_findings(session.api, network),
                *fast_lane_findings(network),
                *signal_findings(session.api, network),
            ]
    except InputError as error:
        reason = str(error).removeprefix(f"{scenario.config}: ")
        yield Finding("problem", "SUMO", reason, f"correct it until plain SUMO runs it: sumo -c {scenario.config.name}")
        return
    yield from unknown_names(scenario, demand, frozenset(lane.edge for lane in network.lanes))
    yield from network_findings(network)
    yield from _overtaking(scenario)
    yield from beyond


def network_findings(network: Network) -> Iterator[Finding]:
    """Surfaces of the network for learned road users."""
    places = starting_points(network)
    possible = [kind for kind in RoadUserType if len(places[kind])]
    if not possible:
        yield Finding(
            "problem",
            "surfaces",
            "no lane for cars, bicycles or pedestrians: no road user can be placed",
            "use a network with streets, or set the permissions of its lanes",
        )
        return
    for kind in RoadUserType:
        if kind not in possible:
            yield Finding("note", "surfaces", *_missing_surface(network, kind))
    reach = {k: sum(lane.length for lane in legal_lanes(network, k)) / 1000 for k in possible}
    yield Finding(
        "ok",
        "surfaces",
        "lanes: " + ", ".join(f"{km:.1f} km for {TYPE_NAMES[kind]}s" for kind, km in reach.items()),
        "nothing to do",
    )
    yield from _odd_lanes(network)
    if network.removing:
        edges = sorted(network.removing)
        yield Finding(
            "note",
            "removing edges",
            f"{counted(len(edges), 'edge has', 'edges have')} a calibrator or vaporizer ({some(edges)}), which may "
            "remove vehicles",
            "none needed: SUMO drives vehicles that are taken over along them; added ones are removed before them",
        )
    yield from _short_edges(network)
    yield from _junction_findings(network)
    yield from _bridges(network)


def _missing_surface(network: Network, kind: RoadUserType) -> tuple[str, str]:
    """Missing surfaces, and how to add them."""
    name = TYPE_NAMES[kind]
    mend = {
        RoadUserType.CAR: "lanes that allow passenger cars",
        RoadUserType.BICYCLE: "cycle lanes (netconvert --bikelanes.guess)",
        RoadUserType.PEDESTRIAN: "sidewalks and crossings (netconvert --sidewalks.guess --crossings.guess)",
    }[kind]
    return (
        f"no lane where a {name} may be",
        f"run gives their share to the other types, but refuses a --mix with {name}; to have them, add {mend}",
    )


def _odd_lanes(network: Network) -> Iterator[Finding]:
    """Lanes without a width, and lanes that no class of road users may use."""
    if network.without_width:
        yield Finding(
            "warning",
            "lane widths",
            f"{counted(len(network.without_width), 'lane has', 'lanes have')} no width that a lane can have "
            f"({some(network.without_width)})",
            f"give them a width in m; run takes {LANE_WIDTH:g} m",
        )
    closed = [lane.id for lane in network.lanes if not lane.allowed and not lane.internal]
    if closed:
        yield Finding(
            "note",
            "permissions",
            f"{counted(len(closed), 'lane admits', 'lanes admit')} no vehicle class that SUMO knows ({some(closed)})",
            "none needed if no road user shall use them; else correct allow and disallow",
        )


def _short_edges(network: Network) -> Iterator[Finding]:
    """Edges on which a learned car would stick out into the junctions at both ends."""
    car = float(DEFAULT_LENGTH[RoadUserType.CAR])
    longest: dict[str, float] = {}
    for lane in legal_lanes(network, RoadUserType.CAR):
        longest[lane.edge] = max(longest.get(lane.edge, 0.0), lane.length)
    short = sorted((length, edge) for edge, length in longest.items() if length < car)
    if short:
        named = ", ".join(f"{edge} {length:.1f} m" for length, edge in short[:3]) + (", …" if len(short) > 3 else "")
        yield Finding(
            "note",
            "short edges",
            f"{len(short)} of {len(longest)} edges for cars are shorter than a car of {car:g} m ({named}): a car "
            "placed there stands in the junction",
            "netconvert -s NET --geometry.remove --junctions.join -o NEW merges most of them; "
            "then make the routes again",
        )


def _junction_findings(network: Network) -> Iterator[Finding]:
    if network.junctions and not any(lane.internal for lane in network.lanes):
        yield Finding(
            "warning",
            "junctions",
            "no lanes inside junctions: background vehicles jump across them, and learned ones collide there, because "
            "there are no conflict areas to keep clear",
            "make the network again without --no-internal-links",
        )
    elif any(lane.surface == Surface.SIDEWALK and not lane.internal for lane in network.lanes) and not any(
        lane.surface == Surface.CROSSING for lane in network.lanes
    ):
        yield Finding(
            "note",
            "crossings",
            "sidewalks, but no pedestrian crossings: learned pedestrians cross the carriageway where no vehicle yields",
            "netconvert -s NET --crossings.guess --walkingareas -o NEW adds them",
        )


def _overtaking(scenario: Scenario) -> Iterator[Finding]:
    """Lanes from which SUMO's vehicles overtake on the opposite lane."""
    lanes = overtaking_lanes(",".join(str(path) for path in input_files(scenario, "net-file")))
    if lanes:
        yield Finding(
            "note",
            "overtaking",
            f"{counted(len(lanes), 'lane has', 'lanes have')} an opposite lane for overtaking ({some(lanes)}): learned "
            "vehicles do not overtake there, and SUMO's may be held up behind them",
            "none needed; travel times behind slow vehicles are longer than in SUMO",
        )


def _bridges(network: Network) -> Iterator[Finding]:
    """Streets that cross without a junction; only the user knows whether this is intended."""
    crossing = sorted({separation.edges for separation in network.grade_separations})
    if crossing:
        named = ", ".join(" over or under ".join(pair) for pair in crossing[:2])
        yield Finding(
            "note",
            "bridges",
            f"{len(crossing)} pairs of edges cross without a junction ({named}{', …' if len(crossing) > 2 else ''}): "
            "learned road users do not meet those on the other level, as in SUMO",
            "where a junction was meant, insert it with netedit, or draw the streets anew",
        )
