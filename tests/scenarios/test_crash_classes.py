"""The ways in which libsumo 1.28 dies of moved road users: we survive each, and the naive call still does not.

Every situation runs in a process of its own, because a crash of SUMO takes its process along: this file is also the
program that plays one. Where a naive call stops crashing, a rule of `slrl_sumo.sumo.spawned` can go.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.netgen.binaries import run_program
from slrl_sumo.scene.geometry import front_from_centre, heading_to_sumo, wrap_angle
from slrl_sumo.scene.types import DEFAULT_LENGTH, RoadUserType
from slrl_sumo.sumo.reader import Snapshot
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.scenario.options import with_options
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.taken_over import TakenOverControl

Copy = Callable[..., Path]
Floats = NDArray[np.float64]

SUBLANE = "--lateral-resolution 0.8"
TWO_LANES = pytest.mark.parametrize("options", [SUBLANE, "--lanechange.duration 2"])
"""With either, a vehicle may be on two lanes at once."""
CENTRE = (60.0, 140.0)
"""m; both axes, round the junction of the shipped intersection with its crossings."""
GRASS = (10.0, 80.0)
"""m; both axes, between two arms of it."""


def play(*words: object) -> subprocess.CompletedProcess[str]:
    """Play one of the situations below in a process of its own."""
    command = [sys.executable, __file__, *map(str, words)]
    # A process that crashes leaves its temporary files.
    with tempfile.TemporaryDirectory() as folder:
        env = os.environ | {"TMPDIR": folder}
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=240, env=env)


def _able(control: TakenOverControl, snapshot: Snapshot) -> NDArray[np.bool_]:
    """Which road users could be taken over by a driver without models."""
    return np.array([not why for why in control.obstacles(snapshot.ids, snapshot.person, models=False)], np.bool_)


def survived(*words: object) -> dict[str, Any]:
    """What a situation tells of itself at its end, which it must reach."""
    done = play(*words)
    assert done.returncode == 0, f"{words}: exit code {done.returncode}: {done.stderr[-1000:]}"
    return dict(json.loads(done.stdout.splitlines()[-1]))


def crashes(*words: object) -> None:
    done = play(*words)
    assert done.returncode == -signal.SIGSEGV, f"{words}: exit code {done.returncode}: {done.stderr[-1000:]}"


# --- 1: the first move of a vehicle puts it beside every lane


@pytest.mark.parametrize("options", ["", SUBLANE])
def test_road_users_may_start_beside_every_lane_while_sumo_writes_fcd(tmp_path: Path, options: str) -> None:
    end = survived("start_on_grass", tmp_path / "fcd.xml", options)
    assert end == {"missing": 0, "away": pytest.approx(0.0, abs=0.01), "steps": 50}


@pytest.mark.parametrize("keep_route", [2, 3, 7])
def test_sumo_dies_of_a_first_move_beside_every_lane(tmp_path: Path, keep_route: int) -> None:
    crashes("naive_first_move", tmp_path / "fcd.xml", keep_route)


# --- 2: long vehicles over sidewalks beside crossings


@pytest.mark.parametrize("options", ["", SUBLANE])
@pytest.mark.parametrize("situation", ["cars_over_sidewalks", "lent_cars_over_sidewalks"])
def test_cars_may_drive_over_sidewalks_beside_crossings(situation: str, options: str) -> None:
    end = survived(situation, options)
    assert end == {"missing": 0, "away": pytest.approx(0.0, abs=0.01), "steps": 300}


@pytest.mark.parametrize("options", ["", SUBLANE])
def test_sumo_dies_of_cars_that_may_be_mapped_to_sidewalks_beside_crossings(options: str) -> None:
    crashes("naive_cars_over_sidewalks", options)


# --- 3: moved persons


@pytest.mark.slow
def test_persons_walk_anywhere_for_long() -> None:
    end = survived("persons", 128, 2600)
    # Within MATCH_THRESHOLD_PERSON of a lane's edge SUMO pulls a few of 100,000 onto it.
    assert end == {"missing": 0, "away": pytest.approx(0.0, abs=0.2), "steps": 2600}


@pytest.mark.slow
def test_persons_of_the_scenario_walk_anywhere_for_long() -> None:
    end = survived("lent_persons", 1500)
    assert end["most"] >= 20
    assert (end["missing"], end["steps"]) == (0, 1500)


def test_sumo_dies_of_persons_whose_walk_is_changed_by_a_move() -> None:
    crashes("naive_persons")


# --- 4: the pedestrian model of another library


def test_persons_are_moved_although_the_scenario_asks_for_jupedsim(copy_scenario: Copy) -> None:
    config = copy_scenario("intersection", (".sumocfg", '"striping"', '"jupedsim"'))
    end = survived("person_on_the_road", config)
    assert end == {"missing": 0, "away": pytest.approx(0.0, abs=0.01), "steps": 50, "model": "striping"}


# --- 5: SUMO takes road users away that stand or overlap


def test_cars_that_stand_in_each_other_stay(copy_scenario: Copy) -> None:
    config = copy_scenario(
        "intersection",
        (".sumocfg", '<time-to-teleport value="-1"/>', '<time-to-teleport value="20"/>'),
        (".sumocfg", '"warn"', '"remove"'),
    )
    assert survived("standing_cars", config)["gone_at"] is None


def test_sumo_takes_away_what_stands_unless_it_is_told_not_to() -> None:
    assert survived("naive_standing_cars", "--collision.action", "none")["gone_at"] == pytest.approx(300, abs=2)


# --- 6: vehicles that leave all lanes from two lanes


@TWO_LANES
def test_a_car_may_leave_its_lane_while_its_rear_is_on_another_one(game: Path, options: str) -> None:
    end = survived("car_beside_its_lane", game / "fkk_in.sumocfg", options)
    assert end["lanes"][0] != "" == end["lanes"][-1]
    assert end["away"] == pytest.approx(0.0, abs=0.01)


@TWO_LANES
def test_sumo_dies_of_a_car_that_leaves_its_lane_while_its_rear_is_on_another_one(game: Path, options: str) -> None:
    crashes("naive_car_beside_its_lane", game / "fkk_in.sumocfg", options)


# --- 7: vehicles on walking areas


@pytest.fixture
def footpath(tmp_path: Path) -> Path:
    """A street of two edges with a sidewalk, and a walking area between the edges."""
    nodes = "".join(f'<node id="{name}" x="{x}" y="0"/>' for name, x in (("a", 0), ("b", 50), ("c", 100)))
    edge = '<edge id="{0}{1}" from="{0}" to="{1}" numLanes="1" speed="10" sidewalkWidth="2"/>'
    (tmp_path / "n.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (tmp_path / "n.edg.xml").write_text(f"<edges>{edge.format('a', 'b')}{edge.format('b', 'c')}</edges>")
    run_program("netconvert", ["-n", "n.nod.xml", "-e", "n.edg.xml", "--walkingareas", "-o", "n.net.xml"], tmp_path)
    # On a sidewalk such a vehicle has no way into the next edge.
    walker = '<vehicle id="v" type="t" depart="0" departLane="0" departPos="last" departSpeed="0"><route edges="{}"/>'
    walker = f'<vType id="t" vClass="pedestrian" length="0.2"/>{walker.format("ab bc")}</vehicle>'
    (tmp_path / "n.rou.xml").write_text(f"<routes>{walker}</routes>")
    files = '<net-file value="n.net.xml"/><route-files value="n.rou.xml"/><step-length value="0.4"/>'
    config = tmp_path / "n.sumocfg"
    config.write_text(f'<configuration>{files}<ignore-route-errors value="true"/></configuration>')
    return config


def test_vehicles_that_may_use_walking_areas_are_left_to_sumo(footpath: Path) -> None:
    assert survived("lent_vehicle_on_a_walking_area", footpath) == {"lane": "ab_0", "why": "class pedestrian"}


def test_sumo_dies_of_vehicles_on_walking_areas() -> None:
    crashes("naive_vehicles_on_walking_areas")


def test_networks_in_which_walking_areas_admit_cars_are_refused(footpath: Path) -> None:
    net = footpath.with_name("n.net.xml")
    text = net.read_text()
    area = ' allow="pedestrian"'
    at = text.index(area, text.index(':b_w0_0"'))
    net.write_text(text[:at] + text[at + len(area) :])
    with pytest.raises(InputError, match=r":b_w0_0 of a crossing or walking area admits cars"), _session(footpath):
        pass


# --- 8: vehicles that are moved to an edge with a vaporizer


@pytest.fixture
def vaporizer(copy_scenario: Copy) -> Path:
    """The shipped intersection with a vaporizer on one of its arms, in an included file."""
    config = copy_scenario("intersection").with_name("v.sumocfg")
    config.with_name("v.xml").write_text('<additional><vaporizer id="in0" begin="0" end="100"/></additional>')
    config.with_name("a.add.xml").write_text('<additional><include href="v.xml"/></additional>')
    files = '<net-file value="intersection.net.xml"/><additional-files value="a.add.xml"/>'
    config.write_text(f"<configuration>{files}</configuration>")
    return config


@pytest.mark.parametrize("options", ["", SUBLANE])
def test_cars_before_a_vaporizer_are_given_back(vaporizer: Path, options: str) -> None:
    end = survived("car_before_a_vaporizer", vaporizer, options)
    assert end["staged"] not in ("", "in0")
    assert "vaporizer" in end["refused"]["learned.0"]
    assert not end["left"]


def test_sumo_dies_of_a_car_that_is_staged_on_an_edge_with_a_vaporizer(vaporizer: Path) -> None:
    crashes("naive_car_before_a_vaporizer", vaporizer)


# --- the situations, each in its own process


class Wanderers:
    """Road users on random walks within a square, and how far SUMO has them from where they were put."""

    def __init__(self, n: int, area: tuple[float, float], speed: float) -> None:
        self._rng = np.random.default_rng(1)
        self._area, self._speed = area, speed
        self.x, self.y = self._rng.uniform(*area, n), self._rng.uniform(*area, n)
        self.heading = self._rng.uniform(-np.pi, np.pi, n)
        self.speed = np.full(n, speed)
        self.missing, self.away, self.steps = 0, 0.0, 0

    def wander(self) -> None:
        self.heading = wrap_angle(self.heading + self._rng.normal(0.0, 0.15, len(self.x)))
        self.x = self.x + 0.4 * self._speed * np.cos(self.heading)
        self.y = self.y + 0.4 * self._speed * np.sin(self.heading)
        low, high = self._area
        outside = (self.x < low) | (self.x > high) | (self.y < low) | (self.y > high)
        self.heading = wrap_angle(self.heading + np.pi * outside)
        self.x, self.y = np.clip(self.x, low, high), np.clip(self.y, low, high)

    def look(self, session: SumoSession, ids: tuple[str, ...]) -> None:
        snapshot = session.reader.read()
        row = {road_user: i for i, road_user in enumerate(snapshot.ids)}
        here = [i for i, road_user in enumerate(ids) if road_user in row]
        at = [row[ids[i]] for i in here]
        self.missing += len(ids) - len(here)
        self.steps += 1
        if self.steps > 1:
            # In the first step vehicles wait on a lane, see SpawnedControl.add.
            apart = np.hypot(snapshot.x[at] - self.x[here], snapshot.y[at] - self.y[here])
            self.away = max(self.away, float(apart.max(initial=0.0)))

    def end(self) -> dict[str, Any]:
        return {"missing": self.missing, "away": self.away, "steps": self.steps}


def place(session: SumoSession, kinds: NDArray[np.int8], crowd: Wanderers, steps: int) -> dict[str, Any]:
    """Wander with road users of ours."""
    ids = tuple(f"learned.{i}" for i in range(len(kinds)))
    session.spawned.add(ids, kinds, crowd.x, crowd.y)
    for _ in range(steps):
        session.spawned.move(ids, kinds, crowd.x, crowd.y, crowd.heading, crowd.speed, DEFAULT_LENGTH[kinds])
        session.step()
        crowd.look(session, ids)
        crowd.wander()
    return crowd.end()


def start_on_grass(fcd: str, options: str) -> dict[str, Any]:
    scenario = with_options(find_scenario("intersection"), ["--fcd-output", fcd, *options.split()])
    with SumoSession(scenario, keep_outputs=True) as session:
        kinds = np.repeat(np.arange(3, dtype=np.int8), 20)
        return place(session, kinds, Wanderers(60, GRASS, 0.0), 50)


def naive_first_move(fcd: str, keep_route: str) -> dict[str, Any]:
    scenario = with_options(find_scenario("intersection"), ["--fcd-output", fcd])
    with SumoSession(scenario, keep_outputs=True) as session:
        libsumo.route.add("r", ["in0"])
        libsumo.vehicle.add("v", "r")
        for _ in range(10):
            libsumo.vehicle.moveToXY("v", "", -1, 40.0, 40.0, 0.0, int(keep_route), 5.0)
            session.step()
    return {}


def cars_over_sidewalks(options: str) -> dict[str, Any]:
    with SumoSession(with_options(find_scenario("intersection"), options.split())) as session:
        return place(session, np.zeros(32, np.int8), Wanderers(32, CENTRE, 8.0), 300)


def lent_cars_over_sidewalks(options: str) -> dict[str, Any]:
    """With vehicles of the scenario, wherever they happen to be when they are taken."""
    with SumoSession(with_options(find_scenario("intersection"), options.split())) as session:
        for _ in range(375):
            session.step()
        snapshot = session.reader.read()
        control = TakenOverControl(libsumo, session.network)
        wheels = np.flatnonzero(~snapshot.person & _able(control, snapshot))
        ids, length = tuple(snapshot.ids[i] for i in wheels), snapshot.length[wheels]
        assert len(ids) >= 6
        crowd, person = Wanderers(len(ids), CENTRE, 8.0), np.zeros(len(ids), np.bool_)
        control.take_over(ids, person)
        for _ in range(300):
            control.move(ids, person, crowd.x, crowd.y, crowd.heading, crowd.speed, length)
            session.step()
            crowd.look(session, ids)
            crowd.wander()
        return crowd.end()


def naive_cars_over_sidewalks(options: str) -> dict[str, Any]:
    """Properly staged, then moved with permissions ignored."""
    with SumoSession(with_options(find_scenario("intersection"), options.split())) as session:
        kinds, crowd = np.zeros(32, np.int8), Wanderers(32, CENTRE, 8.0)
        ids = tuple(f"learned.{i}" for i in range(32))
        session.spawned.add(ids, kinds, crowd.x, crowd.y)
        session.step()
        for _ in range(300):
            x, y = front_from_centre(crowd.x, crowd.y, crowd.heading, DEFAULT_LENGTH[kinds])
            for i, angle in enumerate(heading_to_sumo(crowd.heading).tolist()):
                libsumo.vehicle.moveToXY(ids[i], "", -1, float(x[i]), float(y[i]), angle, 6, 5.0)
            session.step()
            crowd.wander()
    return {}


def persons(n: str, steps: str) -> dict[str, Any]:
    with SumoSession(find_scenario("intersection")) as session:
        kinds = np.full(int(n), RoadUserType.PEDESTRIAN, np.int8)
        return place(session, kinds, Wanderers(int(n), CENTRE, 1.4), int(steps))


def lent_persons(steps: str) -> dict[str, Any]:
    """All persons of the scenario, as they come, each on a random walk from where it was taken."""
    with SumoSession(find_scenario("intersection")) as session:
        control = TakenOverControl(libsumo, session.network)
        rng = np.random.default_rng(1)
        state: dict[str, list[float]] = {}
        missing = 0
        for _ in range(int(steps)):
            snapshot = session.reader.read()
            missing += len(set(state) - set(snapshot.ids))
            able = snapshot.person & _able(control, snapshot)
            for i in np.flatnonzero(able).tolist():
                if snapshot.ids[i] not in state:
                    control.take_over(snapshot.ids[i : i + 1], snapshot.person[i : i + 1])
                    state[snapshot.ids[i]] = [float(snapshot.x[i]), float(snapshot.y[i]), float(snapshot.heading[i])]
            for place in state.values():
                place[2] += rng.normal(0.0, 0.15)
                place[0] += 0.56 * np.cos(place[2])
                place[1] += 0.56 * np.sin(place[2])
                if not (20.0 < place[0] < 180.0 and 20.0 < place[1] < 180.0):
                    place[2] += np.pi
            table = np.array(list(state.values())).reshape(-1, 3)
            n = len(table)
            length = np.full(n, DEFAULT_LENGTH[RoadUserType.PEDESTRIAN])
            x, y, heading = table[:, 0], table[:, 1], wrap_angle(table[:, 2])
            control.move(tuple(state), np.ones(n, np.bool_), x, y, heading, np.full(n, 1.4), length)
            session.step()
        return {"missing": missing, "most": len(state), "steps": int(steps)}


def naive_persons() -> dict[str, Any]:
    """With a walk over several edges, which keepRoute 2 replaces."""
    with SumoSession(find_scenario("intersection")) as session:
        crowd = Wanderers(64, CENTRE, 1.4)
        for i in range(64):
            libsumo.person.add(f"p{i}", "in0", 1.0 + 0.5 * i)
            libsumo.person.appendWalkingStage(f"p{i}", ["in0", "out1"], 1.0)
        for _ in range(1500):
            for i, angle in enumerate(heading_to_sumo(crowd.heading).tolist()):
                libsumo.person.moveToXY(f"p{i}", "", float(crowd.x[i]), float(crowd.y[i]), angle, 2, 5.0)
            session.step()
            crowd.wander()
    return {}


def person_on_the_road(config: str) -> dict[str, Any]:
    with SumoSession(find_scenario(config)) as session:
        kinds = np.full(4, RoadUserType.PEDESTRIAN, np.int8)
        end = place(session, kinds, Wanderers(4, CENTRE, 1.4), 50)
        return {**end, "model": libsumo.simulation.getOption("pedestrian.model")}


def standing_cars(config: str) -> dict[str, Any]:
    """Two cars of ours in the same place on a lane, for 400 s."""
    with SumoSession(find_scenario(config)) as session:
        kinds, ids = np.zeros(2, np.int8), ("learned.0", "learned.1")
        x, y = libsumo.simulation.convert2D("in0", 30.0, 2)
        places, still = np.array([x, x + 1.0]), np.zeros(2)
        session.spawned.add(ids, kinds, places, np.full(2, y))
        for _ in range(1000):
            session.spawned.move(ids, kinds, places, np.full(2, y), still, still, DEFAULT_LENGTH[kinds])
            session.step()
            if not set(ids) <= set(libsumo.vehicle.getIDList()):
                return {"gone_at": session.time}
    return {"gone_at": None}


def naive_standing_cars(*options: str) -> dict[str, Any]:
    """The same with SUMO started with `options` alone, without a session that knows better."""
    folder = find_scenario("intersection").config.parent
    libsumo.start(
        ["sumo", "-n", str(folder / "intersection.net.xml"), "--step-length", "0.4", "--no-step-log", *options]
    )
    libsumo.route.add("r", ["in0"])
    x, y = libsumo.simulation.convert2D("in0", 30.0, 2)
    gone_at = None
    for name in ("a", "b"):
        libsumo.vehicle.add(name, "r")
        libsumo.vehicle.setSpeedMode(name, 0)
        libsumo.vehicle.moveToXY(name, "in0", 2, x, y, 90.0, 6, 5.0)
    for _ in range(1000):
        libsumo.simulationStep()
        if not {"a", "b"} <= set(libsumo.vehicle.getIDList()):
            gone_at = libsumo.simulation.getTime()
            break
        for name, ahead in (("a", 0.0), ("b", 1.0)):
            libsumo.vehicle.moveToXY(name, "", -1, x + ahead, y, 90.0, 2, 5.0)
            libsumo.vehicle.setSpeed(name, 0.0)
    libsumo.close()
    return {"gone_at": gone_at}


def two_cars(steps: int) -> list[tuple[Floats, Floats, Floats, Floats]]:
    """Front positions (m), headings and speeds of two cars: one drives off its lane over a short one of a junction.

    In fkk_in of the SUMO wheel, with the other one behind it.
    """
    heading, speed = np.array([0.3578, 0.3680]), np.array([4.33, 5.1])
    times = 0.2 * np.arange(steps) - 2.0
    return [
        (
            np.array([5846.2, 5816.7]) + time * speed * np.cos(heading),
            np.array([5704.97, 5685.40]) + time * speed * np.sin(heading),
            heading,
            speed,
        )
        for time in times
    ]


def car_beside_its_lane(config: str, options: str) -> dict[str, Any]:
    lanes, away = [], 0.0
    with SumoSession(with_options(find_scenario(config), options.split())) as session:
        kinds, ids, length = np.zeros(2, np.int8), ("learned.0", "learned.1"), np.full(2, 5.0)
        for number, (x, y, heading, speed) in enumerate(two_cars(40)):
            centre_x, centre_y = x - 2.5 * np.cos(heading), y - 2.5 * np.sin(heading)
            if number == 0:
                session.spawned.add(ids, kinds, centre_x, centre_y)
            session.spawned.move(ids, kinds, centre_x, centre_y, heading, speed, length)
            session.step()
            if number:
                lanes.append(libsumo.vehicle.getLaneID(ids[0]))
                away = max(away, float(np.hypot(*(np.array(libsumo.vehicle.getPosition(ids[0])) - (x[0], y[0])))))
    return {"lanes": lanes, "away": away}


def naive_car_beside_its_lane(config: str, options: str) -> dict[str, Any]:
    """Properly staged, then moved and nothing else."""
    with SumoSession(with_options(find_scenario(config), options.split())) as session:
        ids = ("learned.0", "learned.1")
        for number, (x, y, heading, speed) in enumerate(two_cars(40)):
            if number == 0:
                session.spawned.add(ids, np.zeros(2, np.int8), x, y)
                session.step()
            for i, angle in enumerate(heading_to_sumo(heading).tolist()):
                libsumo.vehicle.moveToXY(ids[i], "", -1, float(x[i]), float(y[i]), angle, 2, 5.0)
                libsumo.vehicle.setSpeed(ids[i], float(speed[i]))
            session.step()
    return {}


def _session(config: Path | str) -> SumoSession:
    return SumoSession(find_scenario(str(config)))


def lent_vehicle_on_a_walking_area(config: str) -> dict[str, Any]:
    with _session(config) as session:
        session.step()
        session.step()
        control = TakenOverControl(libsumo, session.network)
        (why,) = control.obstacles(["v"], np.array([False]), models=False)
        return {"lane": libsumo.vehicle.getLaneID("v"), "why": why}


def naive_vehicles_on_walking_areas() -> dict[str, Any]:
    """Of class pedestrian, around the crossings of a junction."""
    with _session("intersection") as session:
        libsumo.vehicletype.copy("DEFAULT_VEHTYPE", "t")
        libsumo.vehicletype.setVehicleClass("t", "pedestrian")
        libsumo.vehicletype.setLength("t", 0.2)
        libsumo.route.add("r", ["in0"])
        ids = tuple(f"v{i}" for i in range(16))
        for i, road_user in enumerate(ids):
            libsumo.vehicle.add(road_user, "r", typeID="t", departLane="0", departPos=str(5.0 + 4.0 * i))
        session.step()
        session.step()
        crowd = Wanderers(len(ids), CENTRE, 1.4)
        for _ in range(600):
            for i, angle in enumerate(heading_to_sumo(crowd.heading).tolist()):
                libsumo.vehicle.moveToXY(ids[i], "", -1, float(crowd.x[i]), float(crowd.y[i]), angle, 2, 5.0)
                libsumo.vehicle.setSpeed(ids[i], 1.4)
            session.step()
            crowd.wander()
    return {}


def car_before_a_vaporizer(config: str, options: str) -> dict[str, Any]:
    """Added in the middle of the edge with the vaporizer, and removed when it was refused."""
    ids, kinds, length = ("learned.0",), np.zeros(1, np.int8), np.full(1, 5.0)
    with SumoSession(with_options(find_scenario(config), options.split())) as session:
        at = [np.array([value]) for value in libsumo.simulation.convert2D("in0", 30.0, 2)]
        session.spawned.add(ids, kinds, at[0], at[1])
        session.spawned.move(ids, kinds, at[0], at[1], np.zeros(1), np.zeros(1), length)
        session.step()
        staged = libsumo.vehicle.getRoadID(ids[0])
        session.spawned.move(ids, kinds, at[0], at[1], np.zeros(1), np.zeros(1), length)
        refused = session.spawned.refusals.take()
        session.spawned.remove(tuple(refused))
        for _ in range(10):
            session.step()
        return {"staged": staged, "refused": refused, "left": libsumo.vehicle.getIDList()}


def naive_car_before_a_vaporizer(config: str) -> dict[str, Any]:
    """Staged on its edge, as on any other one."""
    with SumoSession(with_options(find_scenario(config), SUBLANE.split())) as session:
        libsumo.route.add("r", ["in0"])
        libsumo.vehicle.add("v", "r")
        libsumo.vehicle.moveToXY("v", "in0", 2, *libsumo.simulation.convert2D("in0", 30.0, 2), 90.0, 6, 5.0)
        session.step()
        session.step()
    return {}


SITUATIONS: dict[str, Callable[..., dict[str, Any]]] = {
    function.__name__: function
    for function in (
        *(start_on_grass, naive_first_move),
        *(cars_over_sidewalks, lent_cars_over_sidewalks, naive_cars_over_sidewalks),
        *(persons, lent_persons, naive_persons),
        person_on_the_road,
        *(standing_cars, naive_standing_cars),
        *(car_beside_its_lane, naive_car_beside_its_lane),
        *(lent_vehicle_on_a_walking_area, naive_vehicles_on_walking_areas),
        *(car_before_a_vaporizer, naive_car_before_a_vaporizer),
    )
}

if __name__ == "__main__":
    print(json.dumps(SITUATIONS[sys.argv[1]](*sys.argv[2:])))
