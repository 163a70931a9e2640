"""Learned road users beside other tools in one simulation: signals as sumo-rl controls them, vehicles that a script
drives itself, further TraCI clients, and networks that SUMO's netconvert imports from OpenStreetMap."""

import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest
import sumo
import sumolib
import traci
from lxml import etree

import slrl_sumo
from slrl_sumo.simulation.takeover import drawn
from slrl_sumo.sumo.scenario import find_scenario

Cli = Callable[..., "subprocess.CompletedProcess[str]"]

OPTIONS = ["--step-length", "0.4", "--time-to-teleport", "-1", "--collision.action", "warn", "--no-step-log"]
OPTIONS += ["--no-warnings", "--seed", "3"]
CAR = "passenger"
GREEN_STEPS, YELLOW_STEPS = 25, 8
"""SUMO steps: 10 s of green at least, 3.2 s of yellow."""


@pytest.fixture
def signalised() -> Any:
    """libsumo with the shipped signalised intersection, 40 s after its begin."""
    libsumo.start([sumolib.checkBinary("sumo"), "-c", str(find_scenario("signalised").config), *OPTIONS])
    try:
        for _ in range(100):
            libsumo.simulationStep()
        yield libsumo
    finally:
        libsumo.close()


class LongestQueue:
    """Controls one traffic light as an agent of sumo-rl does: it observes halting vehicles on the incoming lanes,
    chooses a green phase, and sets the states itself, with yellow in between."""

    def __init__(self, api: Any) -> None:
        self.api, self.id = api, api.trafficlight.getIDList()[0]
        states = [phase.state for phase in api.trafficlight.getAllProgramLogics(self.id)[0].phases]
        self.greens = [state for state in states if "y" not in state and set("gG") & set(state)]
        links = api.trafficlight.getControlledLinks(self.id)
        self.lanes = [
            {link[0][0] for link, signal in zip(links, state, strict=True) if link and signal in "gG"}
            for state in self.greens
        ]
        self.state, self.wanted, self.since = self.greens[0], self.greens[0], GREEN_STEPS
        self.switches = 0

    def act(self) -> None:
        self.since += 1
        if self.state != self.wanted and self.since >= YELLOW_STEPS:
            self.state, self.since = self.wanted, 0
        elif self.state == self.wanted and self.since >= GREEN_STEPS:
            queues = [sum(self.api.lane.getLastStepHaltingNumber(lane) for lane in lanes) for lanes in self.lanes]
            wanted = self.greens[queues.index(max(queues))]
            if wanted != self.state:
                pairs = zip(self.state, wanted, strict=True)
                self.state = "".join("y" if a in "gG" and b not in "gG" else "r" if a == "r" else a for a, b in pairs)
                self.wanted, self.since = wanted, 0
                self.switches += 1
        self.api.trafficlight.setRedYellowGreenState(self.id, self.state)


def test_signals_are_another_scripts_and_learned_vehicles_obey_them(signalised: Any) -> None:
    signals, red, seen = LongestQueue(signalised), [], set[str]()
    links = signalised.trafficlight.getControlledLinks(signals.id)
    index = {link[0][2]: k for k, link in enumerate(links) if link}
    with slrl_sumo.attach(signalised, takeover={"car": 1, "bicycle": 1}) as learned:
        before: dict[str, str] = {}
        for _ in range(300):
            signals.act()
            world = learned.step()
            assert signalised.trafficlight.getRedYellowGreenState(signals.id) == signals.state
            lanes = {
                i: signalised.vehicle.getLaneID(i) for i, own in zip(world.ids, world.learned, strict=True)
                if own and i in signalised.vehicle.getIDList()
            }  # fmt: skip
            entered = {i: lane for i, lane in lanes.items() if lane in index and before.get(i, lane)[0] != ":"}
            seen |= set(entered)
            red += [
                i
                for i, lane in entered.items()
                if before.get(i) not in (None, lane) and signals.state[index[lane]] == "r"
            ]
            before = lanes
    assert signals.switches >= 3
    assert len(seen) >= 8
    assert red == []


@pytest.mark.slow
def test_sumo_rl_controls_the_signals_of_learned_road_users() -> None:
    """The example, with the package sumo-rl itself: 12 decisions of 5 s in a minute."""
    example = Path(slrl_sumo.__file__).parent.parent / "docs" / "examples" / "attach_sumo_rl.py"
    folder = find_scenario("signalised").config.parent
    files = [folder / "signalised.net.xml", folder / "signalised.rou.xml"]
    done = subprocess.run([sys.executable, example, *files, "60"], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found = re.search(r"12 decisions of the signal earned -?\d+\.\d\d; at most (\d+) road users", done.stdout)
    assert found, done.stdout
    assert int(found[1]) >= 5


def test_another_traci_client_steps_and_controls_in_the_same_simulation() -> None:
    """Two clients: one has learned road users, the other one sets the signals; SUMO waits for both in every step."""
    port, steps = sumolib.miscutils.getFreeSocketPort(), 150
    command = [sumolib.checkBinary("sumo"), "-c", str(find_scenario("signalised").config), *OPTIONS]
    command += ["--remote-port", str(port), "--num-clients", "2"]
    seen: list[tuple[float, str]] = []

    def control() -> None:
        other = traci.connect(port, numRetries=100, waitBetweenRetries=0.1)
        other.setOrder(2)
        signals = LongestQueue(other)
        for _ in range(steps):
            signals.act()
            other.simulationStep()
            seen.append((other.simulation.getTime(), other.trafficlight.getRedYellowGreenState(signals.id)))
        other.close()

    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process, ThreadPoolExecutor(1) as pool:
        done = pool.submit(control)  # SUMO gives no answer before all clients are there
        try:
            own = traci.connect(port, numRetries=100, waitBetweenRetries=0.1)
            own.setOrder(1)
            counts = []
            with slrl_sumo.attach(own, agents=3, takeover={"car": 1}) as learned:
                for _ in range(steps):
                    counts.append(int(learned.step().learned.sum()))
                end = own.simulation.getTime()
            own.close()
            done.result(timeout=60)
            process.wait(60)
        finally:
            process.kill()
    assert max(counts) > 3
    assert end == pytest.approx(0.4 * steps)
    assert [time for time, _ in seen] == pytest.approx([0.4 * (k + 1) for k in range(steps)])
    assert len({state for _, state in seen}) > 1


def is_car(api: Any, name: str) -> bool:
    return name in api.vehicle.getIDList() and api.vehicle.getVehicleClass(name) == CAR


def test_vehicles_that_a_script_drives_itself_stay_its_own(signalised: Any) -> None:
    own: dict[str, list[float]] = {}
    background, shares = Counter[str](), np.array([0.5, 0.0, 0.0])
    # Else the brakes of yielding would replace the speeds that the script sets.
    with slrl_sumo.attach(signalised, takeover={"car": 0.5}, background_yields=False) as learned:
        for _ in range(200):
            world = learned.step()
            there = dict(zip(world.ids, world.learned.tolist(), strict=True))
            # Cars that the draw has left to SUMO.
            cars = [i for i in there if is_car(signalised, i) and not drawn((i,), np.zeros(1, np.int8), shares, 1)[0]]
            background.update(cars)
            for i in [i for i, count in background.items() if count == 5 and i in there and len(own) < 3]:
                own[i] = []
                signalised.vehicle.setSpeedMode(i, 0)
                signalised.vehicle.setSpeed(i, 3.0)
            for i in own.keys() & there.keys():
                assert not there[i]
                own[i].append(signalised.vehicle.getSpeed(i))
        assert world.learned.any()
    assert len(own) == 3
    for speeds in own.values():
        assert len(speeds) > 20
        assert speeds[15:] == pytest.approx([3.0] * len(speeds[15:]))


def node(number: int, x: float, y: float) -> str:
    """A node x, y m from 9.0° E, 52.0° N."""
    return f'<node id="{number}" version="1" lat="{52.0 + y / 111_250:.7f}" lon="{9.0 + x / 68_680:.7f}"/>'


def way(number: int, nodes: list[int], **tags: str) -> str:
    refs = "".join(f'<nd ref="{n}"/>' for n in nodes)
    pairs = "".join(f'<tag k="{key.replace("__", ":")}" v="{value}"/>' for key, value in tags.items())
    return f'<way id="{number}" version="1">{refs}{pairs}</way>'


RING = [(18, 0), (0, 18), (-18, 0), (0, -18)]
OSM = "".join(
    [
        '<?xml version="1.0" encoding="UTF-8"?><osm version="0.6" generator="by hand">',
        *(node(k + 1, x, y) for k, (x, y) in enumerate(RING)),
        *(node(number, x, y) for number, x, y in (
            (11, 150, 0), (12, 0, 150), (13, -150, 0), (14, 0, -150), (15, 150, 120), (16, 150, -120), (17, 280, 0),
        )),
        way(1, [1, 2, 3, 4, 1], highway="tertiary", junction="roundabout", oneway="yes", lanes="1"),
        way(2, [1, 11], highway="secondary", sidewalk="both", cycleway="lane", maxspeed="50", name="East street"),
        way(3, [2, 12], highway="residential", sidewalk="both"),
        way(4, [3, 13], highway="residential", sidewalk="both"),
        way(5, [4, 14], highway="residential", sidewalk="both"),
        way(6, [15, 11, 16], highway="tertiary", oneway="yes", lanes="2", sidewalk="right"),
        way(7, [11, 17], highway="secondary", sidewalk="both", lanes="2", maxspeed="50"),
        way(8, [17, 11, 1], railway="tram", electrified="contact_line"),
        way(9, [12, 15], highway="cycleway"),
        "</osm>",
    ]
)  # fmt: skip
TYPEMAPS = ("osmNetconvert", "osmNetconvertUrbanDe", "osmNetconvertPedestrians", "osmNetconvertBicycle")


@pytest.mark.slow
def test_a_town_of_openstreetmap_runs_and_is_replayed(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "town.osm.xml").write_text(OSM)
    typemaps = ",".join(str(Path(sumo.SUMO_HOME) / "data" / "typemap" / f"{name}.typ.xml") for name in TYPEMAPS)
    words = ["--osm-files", "town.osm.xml", "--type-files", typemaps, "--sidewalks.guess", "--crossings.guess"]
    words += [
        "--roundabouts.guess",
        "--junctions.join",
        "--tls.guess-signals",
        "--geometry.remove",
        "-o",
        "town.net.xml",
    ]
    command = [sumolib.checkBinary("netconvert"), *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    net = sumolib.net.readNet(str(tmp_path / "town.net.xml"))
    assert len(net.getRoundabouts()) == 1
    assert any(lane.allows("tram") for edge in net.getEdges() for lane in edge.getLanes())
    fringe = {kind: [e for e in net.getEdges() if e.allows(kind)] for kind in ("passenger", "tram")}
    start = next(e for e in fringe["passenger"] if e.getFromNode().getID() == "13")
    goal = next(e for e in fringe["passenger"] if e.getToNode().getID() == "17")
    tram = next(e for e in fringe["tram"] if e.getFromNode().getID() == "17")
    cars = "".join(f'<trip id="car{k}" depart="{3 * k}" from="{start.getID()}" to="{goal.getID()}"/>' for k in range(8))
    (tmp_path / "town.rou.xml").write_text(
        f'<routes><vType id="tram" vClass="tram"/>{cars}<trip id="tram0" type="tram" depart="30" from="{tram.getID()}" '
        f'to="{tram.getID()}"/></routes>'
    )
    (tmp_path / "town.sumocfg").write_text(
        '<configuration><net-file value="town.net.xml"/><route-files value="town.rou.xml"/>'
        '<end value="60"/></configuration>'
    )
    assert cli("doctor", "town.sumocfg", cwd=tmp_path).returncode == 0
    ran = cli(
        *("run", "town.sumocfg", "--agents", 9, "--takeover", "car=1", "--fcd", "a.xml", "--summary", "s.json"),
        cwd=tmp_path,
    )
    assert ran.returncode == 0, ran.stderr
    shown = cli("replay", "a.xml", "--net", "town.sumocfg", "--out", "a.html", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert 'type="tram"' in (tmp_path / "a.xml").read_text()
    # The exporter takes longitudes and latitudes as they are in the trace; SUMO converts ours.
    trace = etree.parse(str(tmp_path / "a.xml"))
    libsumo.start([sumolib.checkBinary("sumo"), "-n", str(tmp_path / "town.net.xml"), "--no-step-log"])
    for user in trace.getroot().iterfind("timestep/*"):
        place = libsumo.simulation.convertGeo(float(user.get("x", "")), float(user.get("y", "")))
        user.set("x", f"{place[0]:.7f}")
        user.set("y", f"{place[1]:.7f}")
    libsumo.close()
    trace.write(str(tmp_path / "geo.xml"))
    tool = Path(sumo.SUMO_HOME) / "tools" / "traceExporter.py"
    words = ["-i", "geo.xml", "--orig-ids", "--persons", "--gpx-output", "a.gpx"]
    done = subprocess.run([sys.executable, tool, *words], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    points = [e.attrib for e in etree.parse(str(tmp_path / "a.gpx")).getroot().iter("{*}trkpt")]
    # The town lies 150 m to the west and 280 m to the east of 9.0° E, 52.0° N; learned road users may be beside it.
    east = [68_680 * (float(point["lon"]) - 9.0) for point in points]
    north = [111_250 * (float(point["lat"]) - 52.0) for point in points]
    assert len(points) > 500
    assert (min(east), max(east)) == (pytest.approx(-150, abs=30), pytest.approx(280, abs=30))
    assert (min(north), max(north)) == (pytest.approx(-150, abs=30), pytest.approx(150, abs=30))
