"""Random road networks with odd options: netgenerate draws the streets, netconvert builds them after an edit.

The plain XML between the two is edited: bends, heights, missing edges, permissions, widths and kinds of junctions. The
same `Random` gives the same network.
"""

from math import radians, tan
from pathlib import Path
from random import Random

from lxml import etree

from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.netgen.errors import NetgenError

JUNCTIONS = (
    *("priority", "traffic_light", "right_before_left", "left_before_right", "unregulated", "priority_stop"),
    *("allway_stop", "zipper", "traffic_light_right_on_red", "rail_crossing", "rail_signal"),
)
WIDTHS = (0.5, 1.3, 2.0, 2.75, 3.2, 5.0, 9.0)
"""m."""
PERMISSIONS = (
    {"allow": "tram"},
    {"allow": "tram bus taxi"},
    {"allow": "bicycle"},
    {"allow": "pedestrian"},
    {"allow": "pedestrian bicycle"},
    {"allow": "bus coach"},
    {"allow": "ship"},
    {"allow": "rail rail_urban"},
    {"allow": "delivery emergency"},
    {"disallow": "all"},
    {"disallow": "passenger"},
    {"disallow": "pedestrian"},
)
BENDS = (30.0, 60.0, 90.0, 110.0, 130.0)
"""Degrees."""
ATTEMPTS = 20


def draw_network(random: Random, net: Path) -> list[str]:
    """Draw a network and write it to `net`. Returns what is odd about it, and netgenerate's and netconvert's options.

    Options that netconvert refuses together are drawn again; NetgenError after ATTEMPTS.
    """
    for _ in range(ATTEMPTS - 1):
        try:
            return _attempt(random, net)
        except NetgenError:
            continue
    return _attempt(random, net)


def _attempt(random: Random, net: Path) -> list[str]:
    folder = net.parent
    drawn = [*_streets(random), "--seed", str(random.randrange(10**6))]
    run_program("netgenerate", [*drawn, "--plain-output-prefix", "drawn", "--output-file", "drawn.net.xml"], folder)
    odd = [" ".join(drawn)]
    nodes, edges = (etree.parse(folder / f"drawn.{kind}.xml").getroot() for kind in ("nod", "edg"))
    if random.random() < 0.3:
        odd.append("heights")
        for node in nodes.iter("node"):
            node.set("z", f"{random.uniform(-15.0, 15.0):.2f}")
    if random.random() < 0.4:
        odd.append("mixed junctions")
        for node in nodes.iter("node"):
            if random.random() < 0.5:
                node.set("type", random.choice(JUNCTIONS))
    odd += _edit_edges(random, nodes, edges)
    for kind, root in (("nod", nodes), ("edg", edges)):
        (folder / f"edited.{kind}.xml").write_bytes(etree.tostring(root))
    options = _build_options(random)
    files = ["--node-files", "edited.nod.xml", "--edge-files", "edited.edg.xml", "--output-file", net.name]
    run_program("netconvert", [*files, *options], folder)
    odd.append(" ".join(options))
    odd += _edit_net(random, net)
    for file in folder.glob("drawn.*"):
        file.unlink()
    return odd


def _streets(random: Random) -> list[str]:
    """Options of netgenerate."""
    length = random.choice((8, 12, 20, 35, 60, 100, 100, 160, 300))
    family = random.choice(("grid", "spider", "rand"))
    lanes = ["--default.lanenumber", str(random.choice((1, 1, 1, 2, 3, 4)))]
    if random.random() < 0.2:
        lanes.append("--random-lanenumber")
    if family == "grid":
        size = ["--grid.x-number", str(random.randint(1, 4)), "--grid.y-number", str(random.randint(2, 4))]
        attach = ["--grid.attach-length", str(random.choice((0, length, 40)))]
        return ["--grid", *size, "--grid.length", str(length), *attach, *lanes]
    if family == "spider":
        size = ["--spider.arm-number", str(random.randint(3, 9)), "--spider.circle-number", str(random.randint(1, 3))]
        hole = ["--spider.omit-center"] if random.random() < 0.5 else []
        return ["--spider", *size, "--spider.space-radius", str(length), *hole, *lanes]
    size = ["--rand.iterations", str(random.randint(5, 30)), "--rand.min-angle", str(random.choice((15, 30, 45)))]
    reach = ["--rand.min-distance", str(0.5 * length), "--rand.max-distance", str(1.5 * length)]
    both = ["--bidi-probability", str(random.choice((0.0, 0.5, 1.0)))]
    return ["--rand", *size, *reach, *both, *lanes]


def _edit_edges(random: Random, nodes: etree._Element, edges: etree._Element) -> list[str]:
    """Bends, one-way streets, permissions, widths and speeds; what was done."""
    places = {node.get("id"): (float(node.get("x", 0)), float(node.get("y", 0))) for node in nodes.iter("node")}
    shares = {
        name: random.random() * (random.random() < 0.3)
        for name in ("bends", "one-way streets", "permissions", "widths", "speeds")
    }
    shares["one-way streets"] *= 0.5
    widest = random.choice(WIDTHS)
    for edge in list(edges.iter("edge")):
        if random.random() < shares["one-way streets"]:
            edges.remove(edge)
            continue
        if random.random() < shares["bends"]:
            start, end = places[edge.get("from")], places[edge.get("to")]
            shape = _bent(start, end, radians(random.choice(BENDS)) * random.choice((-1, 1)))
            edge.set("shape", " ".join(f"{x:.2f},{y:.2f}" for x, y in shape))
        if random.random() < shares["permissions"]:
            for name in ("allow", "disallow"):
                edge.attrib.pop(name, "")
            for name, value in random.choice(PERMISSIONS).items():
                edge.set(name, value)
        if random.random() < shares["widths"]:
            edge.set("width", f"{random.choice((widest, widest, 3.2)):g}")
        if random.random() < shares["speeds"]:
            edge.set("speed", random.choice(("0.5", "4.17", "8.33", "27.8", "60")))
    return [f"{name} {share:.2f}" for name, share in shares.items() if share]


def _bent(start: tuple[float, float], end: tuple[float, float], turn: float) -> list[tuple[float, float]]:
    """The line from `start` to `end` with one corner of `turn` rad half way."""
    (x0, y0), (x1, y1) = start, end
    aside = 0.5 * tan(0.5 * turn)
    corner = 0.5 * (x0 + x1) + aside * (y1 - y0), 0.5 * (y0 + y1) - aside * (x1 - x0)
    return [start, corner, end]


def _build_options(random: Random) -> list[str]:
    """Options of netconvert."""
    options: list[str] = []
    for share, words in (
        (0.1, ["--no-internal-links"]),
        (0.15, ["--lefthand"]),
        (0.5, ["--sidewalks.guess", "--sidewalks.guess.min-speed", "0"]),
        (0.4, ["--crossings.guess"]),
        (0.15, ["--walkingareas"]),
        (0.25, ["--bikelanes.guess", "--bikelanes.guess.min-speed", "0"]),
        (0.3, ["--no-turnarounds"]),
        (0.3, ["--roundabouts.guess"]),
        (0.15, ["--tls.guess"]),
        (0.15, ["--junctions.join", "--junctions.join-dist", str(random.choice((10, 25)))]),
        (0.15, ["--geometry.remove"]),
        (0.1, ["--edges.join"]),
        (0.1, ["--opposites.guess"]),
        (0.1, ["--rectangular-lane-cut"]),
        (0.1, ["--junctions.minimal-shape"]),
        (0.2, ["--default.junctions.radius", str(random.choice((0.5, 1.5, 12)))]),
        (0.15, ["--junctions.corner-detail", str(random.choice((0, 10)))]),
        (0.15, ["--junctions.internal-link-detail", str(random.choice((2, 20)))]),
        (0.15, ["--tls.default-type", random.choice(("actuated", "delay_based", "static"))]),
        (0.15, ["--tls.layout", random.choice(("opposites", "incoming", "alternateOneWay"))]),
        (0.1, ["--default.spreadtype", random.choice(("center", "roadCenter"))]),
        (0.3, ["--default.lanewidth", str(random.choice(WIDTHS))]),
        (0.1, ["--turn-lanes", "1", "--turn-lanes.length", "15"]),
        (0.1, ["--offset.x", "500000", "--offset.y", "5800000", "--offset.disable-normalization"]),
    ):
        if random.random() < share:
            options += words
    return options


def _edit_net(random: Random, net: Path) -> list[str]:
    """Attributes of lanes that only other programs write: classes that SUMO does not know, no or infinite width."""
    if random.random() >= 0.1:
        return []
    name, value = random.choice((("allow", "-1"), ("width", "0"), ("width", "inf"), ("width", "-1"), ("speed", "0.01")))
    tree = etree.parse(net)
    lanes = [lane for lane in tree.iter("lane") if not str(lane.get("id")).startswith(":")]
    for lane in random.sample(lanes, max(1, len(lanes) // 10)):
        if name == "allow":
            lane.attrib.pop("disallow", "")
        lane.set(name, value)
    tree.write(str(net), encoding="UTF-8", xml_declaration=True)
    return [f'lanes with {name}="{value}"']
