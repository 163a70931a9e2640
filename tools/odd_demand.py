"""Random demand for a network: every vehicle class, every kind of stage of persons and containers, and what SUMO has to
interfere: rerouters, calibrators, vaporizers, stops, detectors.

The same `Random` gives the same files.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from lxml import etree

CLASSES = (
    *("passenger", "passenger", "passenger", "bicycle", "bicycle", "bus", "coach", "tram", "truck", "trailer", "taxi"),
    *("motorcycle", "moped", "scooter", "emergency", "authority", "army", "vip", "private", "hov", "evehicle"),
    *("delivery", "ship", "rail", "rail_urban", "rail_electric", "custom1", "wheelchair", "pedestrian", "ignoring"),
)
HORIZON = 90.0
"""s after its begin in which road users depart."""


@dataclass(frozen=True)
class Street:
    """An edge outside junctions."""

    id: str
    lanes: tuple[tuple[str, frozenset[str] | None, frozenset[str], float], ...]
    """Of each lane: id, classes that are allowed (None: all), classes that are not, length in m."""

    def lane_for(self, vehicle_class: str) -> tuple[str, float] | None:
        """The first lane that a class may use, and its length."""
        for lane, allowed, barred, length in self.lanes:
            if (allowed is None or vehicle_class in allowed) and not barred & {vehicle_class, "all"}:
                return lane, length
        return None


@dataclass(frozen=True)
class Streets:
    """What the demand needs to know of a network."""

    edges: tuple[Street, ...]
    follows: dict[str, list[str]]
    """Edges one step further."""

    def admitting(self, vehicle_class: str) -> list[Street]:
        """Edges with a lane for a class."""
        return [edge for edge in self.edges if edge.lane_for(vehicle_class)]

    def goal(self, random: Random, start: str, choice: Sequence[Street]) -> str:
        """Where to go from `start`: mostly an edge that can be reached, else any of `choice`."""
        return random.choice(choice).id if random.random() < 0.15 else self.walk(random, start, 9)[-1]

    def walk(self, random: Random, start: str, most: int) -> list[str]:
        """A random route of up to `most` edges along connections of any class."""
        route = [start]
        while len(route) < most and (following := self.follows.get(route[-1])):
            route.append(random.choice(following))
        return route


def read_streets(net: Path) -> Streets:
    """The streets of a network file."""
    root = etree.parse(net).getroot()
    edges = []
    for edge in root.iter("edge"):
        if "from" in edge.attrib:
            lanes = tuple(
                (
                    str(lane.get("id")),
                    frozenset(str(lane.get("allow")).split()) if "allow" in lane.attrib else None,
                    frozenset(str(lane.get("disallow", "")).split()),
                    float(lane.get("length", 0)),
                )
                for lane in edge.iter("lane")
            )
            edges.append(Street(str(edge.get("id")), lanes))
    follows: dict[str, list[str]] = {}
    for connection in root.iter("connection"):
        start, end = str(connection.get("from")), str(connection.get("to"))
        if not start.startswith(":") and not end.startswith(":"):
            follows.setdefault(start, []).append(end)
    return Streets(tuple(edges), follows)


def draw_demand(random: Random, net: Path) -> Path:
    """Write a scenario for `net` beside it: routes, additional file and configuration. Returns the .sumocfg."""
    streets = read_streets(net)
    begin = random.choice((0.0, 0.0, 0.0, 3600.0, 100.5))
    places = etree.Element("additional")
    stops = _places(random, streets, places)
    _interference(random, streets, places, begin)
    routes = etree.Element("routes")
    for number, name in enumerate(sorted(set(CLASSES))):
        # Calibrators need them before the routes.
        places.insert(number, _vehicle_type(random, name))
    items: list[etree._Element] = []
    for number in range(random.choice((10, 40, 80))):
        depart = begin + max(0.0, random.uniform(-0.5 * HORIZON, HORIZON))
        make = random.choice((_vehicle, _vehicle, _vehicle, _flow, _person, _person, _person, _container))
        item = make(random, streets, stops, f"{number}", depart)
        if item is not None:
            items.append(item)
    routes.extend(sorted(items, key=lambda item: float(item.get("depart") or item.get("begin") or 0)))
    files = {"odd.add.xml": places, "odd.rou.xml": routes, "odd.sumocfg": _configuration(random, net, begin)}
    for name, root in files.items():
        (net.parent / name).write_bytes(etree.tostring(root, pretty_print=True))
    return net.parent / "odd.sumocfg"


def _vehicle_type(random: Random, name: str) -> etree._Element:
    item = etree.Element("vType", {"id": name, "vClass": name})
    for share, key, values in (
        (0.2, "length", ("0.6", "2", "9", "25")),
        (0.2, "width", ("0.3", "1", "2.6")),
        (0.2, "minGap", ("0", "0.5", "5")),
        (0.3, "speedFactor", ("0.4", "1.6", "normc(1,0.3,0.2,2)")),
        (0.2, "maxSpeed", ("0.3", "3", "50")),
        (0.15, "carFollowModel", ("IDM", "EIDM", "Wiedemann", "ACC", "KraussPS")),
        (0.2, "latAlignment", ("left", "right", "nice", "arbitrary", "compact")),
        (0.1, "jmIgnoreKeepClearTime", ("0",)),
        (0.1, "impatience", ("1",)),
    ):
        # SUMO checks some of these against the class: a wide person fails.
        if random.random() < share and name not in ("pedestrian", "wheelchair"):
            item.set(key, random.choice(values))
    return item


def _places(random: Random, streets: Streets, root: etree._Element) -> dict[str, list[tuple[str, str]]]:
    """Bus stops with access, parking areas and container stops: (id, edge) of each kind."""
    made: dict[str, list[tuple[str, str]]] = {"busStop": [], "parkingArea": [], "containerStop": []}
    for kind, places in made.items():
        choice = streets.admitting("bus" if kind == "busStop" else "passenger")
        for number, street in enumerate(random.sample(choice, min(len(choice), random.randint(0, 4)))):
            found = street.lane_for("bus" if kind == "busStop" else "passenger")
            if found is None or found[1] < 5.0:
                continue
            lane, length = found
            begin = random.uniform(0.0, 0.4 * length)
            where = {"lane": lane, "startPos": f"{begin:.2f}", "endPos": f"{random.uniform(begin + 2, length):.2f}"}
            place = etree.SubElement(root, kind, {"id": f"{kind}{number}", **where})
            if kind == "parkingArea":
                place.set("roadsideCapacity", str(random.randint(1, 5)))
            elif kind == "busStop":
                for way in random.sample(streets.edges, min(2, len(streets.edges))):
                    walkable = way.lane_for("pedestrian")
                    if walkable and way.id != street.id and random.random() < 0.7:
                        access = {"lane": walkable[0], "pos": f"{0.5 * walkable[1]:.2f}"}
                        etree.SubElement(place, "access", {**access, "length": str(random.choice((3, 20, 80)))})
            places.append((f"{kind}{number}", street.id))
    return made


def _interference(random: Random, streets: Streets, root: etree._Element, begin: float) -> None:
    """Rerouters, calibrators, vaporizers, variable speed signs and detectors."""
    drivable = streets.admitting("passenger")
    if not drivable:
        return
    while random.random() < 0.4:
        number, street, other = len(root), random.choice(drivable), random.choice(drivable)
        when = {"begin": f"{begin + random.uniform(0, 40):.1f}", "end": f"{begin + random.uniform(45, 200):.1f}"}
        found = street.lane_for("passenger")
        assert found is not None
        lane, length = found
        kind = random.choice(("rerouter", "rerouter", "calibrator", "vaporizer", "sign", "detector"))
        if kind == "rerouter":
            rerouter = etree.SubElement(root, "rerouter", {"id": f"re{number}", "edges": street.id})
            interval = etree.SubElement(rerouter, "interval", when)
            if random.random() < 0.5:
                etree.SubElement(interval, "closingReroute", {"id": other.id})
            else:
                etree.SubElement(interval, "destProbReroute", {"id": other.id, "probability": "1"})
        elif kind == "calibrator":
            calibrator = {"id": f"cal{number}", "lane": lane, "pos": "0", "freq": "5"}
            if random.random() < 0.5:
                del calibrator["lane"]
                calibrator["edge"] = street.id
            target = {"vehsPerHour": random.choice(("0", "600", "1800")), "speed": "8", "type": "passenger"}
            way = " ".join(streets.walk(random, street.id, 4))
            etree.SubElement(root, "route", {"id": f"cal{number}", "edges": way})
            item = etree.SubElement(root, "calibrator", calibrator)
            etree.SubElement(item, "flow", {**when, **target, "route": f"cal{number}"})
        elif kind == "vaporizer":
            etree.SubElement(root, "vaporizer", {"id": street.id, **when})
        elif kind == "sign":
            sign = etree.SubElement(root, "variableSpeedSign", {"id": f"sign{number}", "lanes": lane})
            etree.SubElement(sign, "step", {"time": when["begin"], "speed": random.choice(("0.1", "3", "30"))})
        else:
            detector = {"id": f"e1{number}", "lane": lane, "pos": f"{0.5 * length:.1f}", "period": "10"}
            etree.SubElement(root, "inductionLoop", {**detector, "file": "loops.xml"})


def _vehicle(
    random: Random, streets: Streets, stops: dict[str, list[tuple[str, str]]], name: str, depart: float
) -> etree._Element | None:
    kind = random.choice(CLASSES)
    edges = streets.admitting(kind)
    if not edges:
        return None
    common = {"id": f"v{name}", "type": kind, "depart": f"{depart:.2f}"}
    common["departLane"] = random.choice(("best", "random", "free", "allowed"))
    common["departSpeed"] = random.choice(("0", "max", "random"))
    common["departPos"] = random.choice(("base", "random", "last", "free"))
    if random.random() < 0.5:
        start = random.choice(edges).id
        return etree.Element("trip", {**common, "from": start, "to": streets.goal(random, start, edges)})
    item = etree.Element("vehicle", common)
    route = streets.walk(random, random.choice(edges).id, random.randint(1, 12))
    etree.SubElement(item, "route", {"edges": " ".join(route)})
    places = [(k, place) for k, made in stops.items() for place, edge in made if edge in route]
    if places and random.random() < 0.7:
        stop_kind, place = random.choice(places)
        stop = etree.SubElement(item, "stop", {stop_kind: place, "duration": str(random.choice((1, 10, 60)))})
        if random.random() < 0.2:
            stop.set("parking", "true")
    elif random.random() < 0.3:
        street = next(street for street in streets.edges if street.id == random.choice(route) or street.id == route[-1])
        found = street.lane_for(kind)
        if found is not None:
            where = {"lane": found[0], "endPos": f"{random.uniform(0.3, 1.0) * found[1]:.2f}"}
            etree.SubElement(item, "stop", {**where, "duration": str(random.choice((1, 10, 60)))})
    return item


def _flow(
    random: Random, streets: Streets, stops: dict[str, list[tuple[str, str]]], name: str, depart: float
) -> etree._Element | None:
    kind = random.choice((*CLASSES, "person", "person", "person"))
    edges = streets.admitting("pedestrian" if kind == "person" else kind)
    if not edges:
        return None
    rate = random.choice(({"probability": "0.2"}, {"period": "3"}, {"number": "9"}, {"vehsPerHour": "900"}))
    if kind == "person" and "vehsPerHour" in rate:
        rate = {"personsPerHour": "900"}
    common = {"id": f"f{name}", "begin": f"{depart:.2f}", "end": f"{depart + HORIZON:.2f}", **rate}
    start = random.choice(edges).id
    end = streets.goal(random, start, edges)
    if kind == "person":
        item = etree.Element("personFlow", common)
        etree.SubElement(item, "walk", {"from": start, "to": end})
        return item
    return etree.Element("flow", {**common, "type": kind, "from": start, "to": end, "departLane": "best"})


def _person(
    random: Random, streets: Streets, stops: dict[str, list[tuple[str, str]]], name: str, depart: float
) -> etree._Element | None:
    edges = streets.admitting("pedestrian")
    if not edges:
        return None
    item = etree.Element("person", {"id": f"p{name}", "depart": f"{depart:.2f}"})
    here = random.choice(edges).id
    stages: tuple[Callable[[], str | None], ...] = (
        lambda: _walk(random, item, here, streets.goal(random, here, edges)),
        lambda: _walk(random, item, here, streets.goal(random, here, edges)),
        lambda: _stay(random, item, here, streets),
        lambda: _ride(random, item, here, stops),
        lambda: _access(random, item, here, stops),
        lambda: _trip(random, item, here, streets.goal(random, here, edges)),
    )
    for _ in range(random.randint(1, 4)):
        there = random.choice(stages)()
        if there is not None:
            here = there
    if len(item) == 0:
        _walk(random, item, here, streets.goal(random, here, edges))
    return item


def _walk(random: Random, person: etree._Element, here: str, there: str) -> str:
    walk = etree.SubElement(person, "walk", {"from": here, "to": there})
    if random.random() < 0.2:
        walk.set("speed", random.choice(("0.1", "4")))
    return there


def _stay(random: Random, person: etree._Element, here: str, streets: Streets) -> str | None:
    lane = next(street for street in streets.edges if street.id == here).lane_for("pedestrian")
    if lane is None:
        return None
    stop = {"lane": lane[0], "endPos": f"{0.5 * lane[1]:.2f}", "duration": str(random.choice((1, 5, 30)))}
    etree.SubElement(person, "stop", {**stop, "actType": "waiting"})
    return here


def _ride(random: Random, person: etree._Element, here: str, stops: dict[str, list[tuple[str, str]]]) -> str | None:
    if not stops["busStop"]:
        return None
    stop, edge = random.choice(stops["busStop"])
    etree.SubElement(person, "ride", {"from": here, "busStop": stop, "lines": random.choice(("ANY", "v0 v1 v2 v3"))})
    return edge


def _access(random: Random, person: etree._Element, here: str, stops: dict[str, list[tuple[str, str]]]) -> str | None:
    """A walk to a bus stop, which ends in a stage of kind access where the stop has one."""
    if not stops["busStop"]:
        return None
    stop, edge = random.choice(stops["busStop"])
    etree.SubElement(person, "walk", {"from": here, "busStop": stop})
    if random.random() < 0.5:
        etree.SubElement(person, "stop", {"busStop": stop, "duration": "10"})
    return edge


def _trip(random: Random, person: etree._Element, here: str, there: str) -> str:
    modes = random.choice(("", "public", "bicycle", "car", "public car bicycle", "taxi"))
    trip = etree.SubElement(person, "personTrip", {"from": here, "to": there})
    if modes:
        trip.set("modes", modes)
    return there


def _container(
    random: Random, streets: Streets, stops: dict[str, list[tuple[str, str]]], name: str, depart: float
) -> etree._Element | None:
    edges = streets.admitting("passenger")
    if not edges:
        return None
    start = random.choice(edges).id
    item = etree.Element("container", {"id": f"c{name}", "depart": f"{depart:.2f}"})
    way = streets.walk(random, start, 3)
    etree.SubElement(item, "tranship", {"edges": " ".join(way), "speed": "2"})
    if stops["containerStop"] and random.random() < 0.5:
        stop, _ = random.choice(stops["containerStop"])
        etree.SubElement(item, "transport", {"from": way[-1], "containerStop": stop, "lines": "ANY"})
    return item


def _configuration(random: Random, net: Path, begin: float) -> etree._Element:
    options = {
        "net-file": net.name,
        "route-files": "odd.rou.xml",
        "additional-files": "odd.add.xml",
        "begin": f"{begin:g}",
        "step-length": random.choice(("0.05", "0.1", "0.2", "0.4", "1")),
        # Random trips and routes: what has none is left out.
        "ignore-route-errors": "true",
    }
    for share, name, values in (
        (0.3, "end", (f"{begin + 20:g}", f"{begin + 600:g}")),
        (0.3, "lateral-resolution", ("0.2", "0.8", "1.5", "4")),
        (0.3, "time-to-teleport", ("-1", "3", "60")),
        (0.3, "collision.action", ("teleport", "remove", "warn", "none")),
        (0.2, "collision.check-junctions", ("true",)),
        (0.2, "device.rerouting.probability", ("0.5", "1")),
        (0.2, "pedestrian.model", ("striping", "nonInteracting")),
        (0.2, "scale", ("0.5", "2")),
        (0.1, "lanechange.duration", ("2",)),
        (0.1, "step-method.ballistic", ("true",)),
        (0.1, "max-depart-delay", ("5",)),
        (0.1, "time-to-impatience", ("5",)),
        (0.1, "emergency-insert", ("true",)),
        (0.1, "default.speeddev", ("0",)),
        (0.1, "device.taxi.dispatch-algorithm", ("greedy",)),
        (0.1, "ride.stop-tolerance", ("1",)),
        (0.1, "fcd-output", ("own.fcd.xml",)),
        (0.1, "tripinfo-output", ("own.trips.xml",)),
    ):
        if random.random() < share:
            options[name] = random.choice(values)
    if "lateral-resolution" in options:
        options.pop("lanechange.duration", None)
    root = etree.Element("configuration")
    for name, value in options.items():
        etree.SubElement(root, name, {"value": value})
    return root
