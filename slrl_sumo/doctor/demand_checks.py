"""Consequences of a scenario's demand for a run with learned road users, without starting SUMO."""

from collections.abc import Iterator

from slrl_sumo.doctor.finding import Finding, counted, some
from slrl_sumo.formats.sumo_time import parse_time
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.demand import Demand
from slrl_sumo.sumo.scenario.options import is_output, option, switched_on
from slrl_sumo.sumo.spawned import LEARNED_TYPES
from slrl_sumo.sumo.vehicle_classes import MAX_LENGTH, MAX_WIDTH

KEPT = {"pedestrian": (0.73, 1.57), "bicycle": (0.0, 6.93)}
"""m/s at which learned ones of each class go on a free way, measured with the bundle `intersection`."""
SPEED_SPREAD = 0.1
"""Share by which a desired speed may exceed these speeds: types within the usual spread are not reported."""


def demand_findings(scenario: Scenario, demand: Demand) -> Iterator[Finding]:
    """Consequences of the route and additional files for a run."""
    for path, reason in demand.unreadable.items():
        yield Finding("problem", "files", f"{path} is not well-formed: {reason}", "correct the file or make it again")
    yield from _name_findings(demand)
    begin, end = parse_time(option(scenario, "begin")) or 0.0, parse_time(option(scenario, "end"))
    if not demand.road_users:
        yield Finding(
            "warning",
            "demand",
            "there is no background traffic: no vehicle, flow or person in the route and additional files",
            "add demand (randomTrips.py makes some), unless learned road users shall be alone",
        )
    elif demand.first is not None and end is not None and 0 < end <= demand.first:
        yield Finding(
            "warning",
            "demand",
            f"the first departure ({demand.first:g} s) is not before the end ({end:g} s)",
            "correct end, or the departures",
        )
    elif demand.first is not None and demand.first >= begin + 60:
        yield Finding(
            "warning",
            "demand",
            f"the scenario begins at {begin:g} s, but no road user departs before {demand.first:g} s: learned road "
            "users start at once and are alone until then",
            f"set begin to {demand.first:g}",
        )
    for path, (count, first) in demand.unsorted.items():
        yield Finding(
            "warning",
            "demand",
            f"{path.name}: {count} not in the order of departure (first: {first}); SUMO drops them silently in a run",
            f"sort it: python $SUMO_HOME/tools/route/sort_routes.py {path.name} -o sorted.rou.xml",
        )
    if demand.stopping:
        yield Finding(
            "note",
            "stops",
            f"{counted(demand.stopping, 'vehicle or flow has', 'vehicles or flows have')} stops on the way "
            f"(first: {demand.first_stopping})",
            "none needed: a moved vehicle would lose its stops, so --takeover leaves them to SUMO",
        )
    if unsuited := demand.without_models():
        reasons = ", ".join(f"{reason} {count}" for reason, count in unsuited.items())
        yield Finding(
            "note",
            "vehicle classes",
            f"vehicles and flows that models of cars and bicycles do not suit: {reasons} (size: longer than "
            f"{MAX_LENGTH:g} m or wider than {MAX_WIDTH:g} m)",
            "none needed: --takeover leaves them to SUMO and counts them",
        )
    if demand.riding:
        yield Finding(
            "note",
            "rides",
            f"{counted(demand.riding, 'person or person flow rides', 'persons or person flows ride')} in vehicles",
            "none needed: SUMO moves them while they ride or wait",
        )
    yield from _speed_findings(demand)
    yield from _rerouting_findings(scenario, demand)


def _speed_findings(demand: Demand) -> Iterator[Finding]:
    """Desired speeds that learned pedestrians and bicycles do not reach or keep."""
    beyond = sorted(
        name
        for name, (of, wanted) in demand.wanted_speeds.items()
        if not (1.0 - SPEED_SPREAD) * KEPT[of][0] <= wanted <= (1.0 + SPEED_SPREAD) * KEPT[of][1]
    )
    parts = []
    if beyond:
        parts.append(f"{counted(len(beyond), 'vehicle type wants', 'vehicle types want')} them ({some(beyond)})")
    if count := demand.walks_of_own_speed:
        parts.append(
            f"{counted(count, 'person or person flow has', 'persons or person flows have')} a walk with speed or "
            "duration, which SUMO does not tell"
        )
    if parts:
        (slow, fast), (_, riding) = KEPT["pedestrian"], KEPT["bicycle"]
        yield Finding(
            "note",
            "speeds",
            f"speeds that learned road users do not keep: {'; '.join(parts)}. Learned pedestrians walk at {slow:g} to "
            f"{fast:g} m/s, as their type wants, and learned bicycles ride at most at {riding:g} m/s",
            "leave these road users to SUMO (take over cars alone), or give persons a type with the speed",
        )


def _name_findings(demand: Demand) -> Iterator[Finding]:
    """Names that are reserved for learned road users."""
    if demand.own_ids:
        # A flow "learned_car" makes vehicles "learned_car.0", which are the names of ours.
        clash = [name for name in demand.own_ids if name.partition(".")[0] in LEARNED_TYPES]
        yield Finding(
            "problem" if clash else "warning",
            "ids",
            f"the scenario has road users named like learned ones ({some(clash or demand.own_ids)})",
            "rename them: ids that begin with learned_ are taken"
            + ("" if clash else "; in traces they would be mistaken for learned road users"),
        )
    if demand.own_routes:
        yield Finding(
            "warning",
            "ids",
            f"the scenario has routes named like those of learned road users ({some(demand.own_routes)})",
            "rename them: run would send learned road users onto these routes",
        )
    ours = sorted(demand.types & set(LEARNED_TYPES))
    if ours:
        yield Finding(
            "warning",
            "vehicle types",
            f"the scenario defines {', '.join(ours)}: learned road users would take its length, class and model",
            "rename these types",
        )


def _rerouting_findings(scenario: Scenario, demand: Demand) -> Iterator[Finding]:
    options = scenario.options
    sources = []
    if (parse_time(options.get("device.rerouting.probability")) or 0) > 0:
        period = options.get("device.rerouting.period", "0")
        when = "at departure only" if not parse_time(period) else f"every {period} s"
        sources.append(f"device.rerouting.probability {options['device.rerouting.probability']}, {when}")
    sources += [name for name in ("device.rerouting.explicit", "device.rerouting.knownveh") if options.get(name)]
    if demand.rerouting_types:
        sources.append(f"vehicle types with a device: {some(sorted(demand.rerouting_types))}")
    if demand.rerouters:
        sources.append(counted(demand.rerouters, "rerouter", "rerouters"))
    if sources:
        weights = "".join(
            f", {name.rpartition('.')[2]} {options[name]}"
            for name in sorted(options)
            if name.startswith("device.rerouting.adaptation")
        )
        yield Finding(
            "note",
            "rerouting",
            f"background vehicles choose new routes under way ({'; '.join(sources)}{weights}), also round jams that "
            "learned road users cause",
            "none needed: learned road users follow rerouters, but get no device; to compare with plain SUMO on equal "
            "routes, switch it off",
        )


def output_findings(scenario: Scenario, demand: Demand) -> Iterator[Finding]:
    """Output files of the scenario."""
    written = sorted(filter(is_output, scenario.options))
    if demand.writers:
        written.append(counted(demand.writers, "detector or data collector", "detectors or data collectors"))
    if written:
        yield Finding(
            "note",
            "outputs",
            f"the scenario writes files of its own: {', '.join(written)}",
            "run leaves them out; --sumo-outputs writes them",
        )


def unknown_names(scenario: Scenario, demand: Demand, edges: frozenset[str]) -> Iterator[Finding]:
    """Demand on edges and of types that do not exist. SUMO loads demand during a run, so it stops with an error then.

    `edges`: all edges of the network.
    """
    end = parse_time(option(scenario, "end"))
    tolerated = switched_on(scenario, "ignore-route-errors")
    for topic, used, known in (
        ("edges", demand.edges_used, edges),
        ("vehicle types", demand.types_used, demand.types),
    ):
        lost = sorted(
            (when, name, user)
            for name, (user, when) in used.items()
            if name not in known and not name.startswith("DEFAULT_") and (end is None or end < 0 or when < end)
        )
        if lost:
            when, name, user = lost[0]
            kind = "edge" if topic == "edges" else "vehicle type"
            more = f", and {len(lost) - 1} more" if len(lost) > 1 else ""
            dropped = tolerated and topic == "edges"
            yield Finding(
                "warning" if dropped else "problem",
                topic,
                f"{user} uses {kind} '{name}', which does not exist{more}: SUMO "
                + ("leaves it out" if dropped else f"stops with an error at {when:g} s or before"),
                f"correct or remove it{' (duarouter --repair mends routes)' if topic == 'edges' else ''}",
            )
