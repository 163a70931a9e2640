"""How many of each type, and where they start."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from builders import make_world
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.scene.contacts import close_pairs, contact_pairs
from slrl_sumo.scene.geometry import to_ego, wrap_angle
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.simulation.placement.spawn import (
    DEFAULT_MIX,
    draw_starts,
    legal_lanes,
    starting_points,
    starting_speed,
    starting_speeds,
    type_counts,
)
from slrl_sumo.simulation.shares import parse_mix
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.lanes import LanePoints
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

Floats = NDArray[np.float64]


@cache
def network(config: str) -> Network:
    with SumoSession(find_scenario(config)) as session:
        return session.network


def boxes(kinds: NDArray[np.int8], x: Floats, y: Floats, heading: Floats) -> WorldState:
    return make_world(x, y, heading, type=kinds)


@pytest.mark.parametrize(
    ("text", "shares"),
    [
        ("car=0.5,bicycle=0.2,pedestrian=0.3", [0.5, 0.2, 0.3]),
        ("car=1", [1, 0, 0]),
        ("pedestrian=3,car=1", [0.25, 0, 0.75]),
        (" bicycle = 2 , car=0", [0, 1, 0]),
        ("car=1e-3,bicycle=3e-3", [0.25, 0.75, 0]),
        ("car=1e308,bicycle=1e308", [0.5, 0.5, 0]),
    ],
)
def test_a_mix_is_shares_that_add_up_to_one(text: str, shares: list[float]) -> None:
    assert parse_mix(text).tolist() == pytest.approx(shares)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "car",
        "car=",
        "car=x",
        "car=nan",
        "car=inf",
        "car=-1",
        "train=1",
        "car=0",
        "car=0.5;bicycle=0.5",
        "Car=1",
        "=1",
    ],
)
def test_a_mix_that_says_nothing_clear_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^mix=") as caught:
        parse_mix(text)
    assert caught.value.as_options().startswith("--mix")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("agents", [1, 2, 3, 7, 10, 64, 999])
@pytest.mark.parametrize("mix", [None, "car=1,bicycle=1,pedestrian=1", "car=0.98,bicycle=0.01,pedestrian=0.01"])
def test_counts_add_up_and_come_close_to_the_shares(agents: int, mix: str | None) -> None:
    shares = None if mix is None else parse_mix(mix)
    counts, notices = type_counts(agents, shares, starting_points(network("intersection")), "here")
    assert counts.sum() == agents
    assert np.abs(counts - agents * (DEFAULT_MIX if shares is None else shares)).max() < 1
    assert notices == []


def test_types_without_a_surface_give_their_share_to_the_others(game: Path) -> None:
    points = starting_points(network(str(game / "cross.sumocfg")))
    counts, notices = type_counts(70, None, points, "here")
    assert counts.tolist() == [50, 20, 0]
    assert len(notices) == 1
    assert "pedestrian" in notices[0]


def test_a_mix_that_asks_for_a_type_without_a_surface_is_refused(game: Path) -> None:
    points = starting_points(network(str(game / "cross.sumocfg")))
    with pytest.raises(InputError, match=r"cross\.sumocfg: the network has no surface for pedestrian"):
        type_counts(10, parse_mix("car=1,pedestrian=0.01"), points, "cross.sumocfg")
    counts, notices = type_counts(10, parse_mix("car=1"), points, "cross.sumocfg")
    assert (counts.tolist(), notices) == ([10, 0, 0], [])


def test_a_network_for_trains_alone_holds_no_road_users(bare_network: Callable[[str], Path]) -> None:
    config = bare_network('<edge id="ab" from="a" to="b" allow="rail"/><edge id="bc" from="b" to="c" allow="tram"/>')
    points = starting_points(network(str(config)))
    assert [len(p) for p in points] == [0, 0, 0]
    with pytest.raises(InputError, match="no lane for cars, bicycles or pedestrians"):
        type_counts(1, None, points, "here")


@pytest.mark.parametrize("agents", [0, -3])
def test_at_least_one_road_user_must_be_requested(agents: int) -> None:
    with pytest.raises(InputError, match=f"agents={agents}: at least one"):
        type_counts(agents, None, starting_points(network("intersection")), "here")


def test_road_users_keep_to_the_ground_of_their_type() -> None:
    lanes = network("intersection")
    assert {lane.id[-1] for lane in legal_lanes(lanes, RoadUserType.CAR)} == {"2"}
    assert {lane.id[-1] for lane in legal_lanes(lanes, RoadUserType.PEDESTRIAN)} == {"0"}
    assert {lane.id[-1] for lane in legal_lanes(lanes, RoadUserType.BICYCLE)} >= {"1"}
    for kind in RoadUserType:
        assert not any(lane.internal for lane in legal_lanes(lanes, kind))
        # A shared space is ground for all types.
        assert len(legal_lanes(network("shared-space"), kind)) == 8


def test_no_walking_or_cycling_on_a_fast_road_that_only_lacks_a_rule(bare_network: Callable[[str], Path]) -> None:
    config = bare_network('<edge id="ab" from="a" to="b" speed="30"/><edge id="bc" from="b" to="c" speed="8.3"/>')
    lanes = network(str(config))
    ids = {kind: {lane.edge for lane in legal_lanes(lanes, kind)} for kind in RoadUserType}
    assert ids == {
        RoadUserType.CAR: {"ab", "bc"},
        RoadUserType.BICYCLE: {"bc"},
        RoadUserType.PEDESTRIAN: {"bc"},
    }


CROWDS = {
    "intersection": (64, None),
    "shared-space": (64, None),
    "signalised": (64, None),
    "district": (200, None),
    # Nearly as many as there is room for: these start in the tight order.
    "intersection, full": (200, "car=0.22,bicycle=0.28,pedestrian=0.5"),
    "shared-space, full": (124, None),
}


@pytest.mark.parametrize("crowd", CROWDS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_starts_do_not_touch_each_other(crowd: str, seed: int) -> None:
    agents, mix = CROWDS[crowd]
    points = starting_points(network(crowd.split(",")[0]))
    counts, _ = type_counts(agents, None if mix is None else parse_mix(mix), points, "here")
    kinds, x, y, heading, limit, _ = draw_starts(counts, points, np.random.default_rng(seed))
    assert np.bincount(kinds, minlength=3).tolist() == counts.tolist()
    assert len(kinds) == agents
    start = boxes(kinds, x, y, heading)
    assert contact_pairs(start)[1].tolist() == []
    assert close_pairs(start, 0.9).tolist() == []
    assert (limit > 0).all()


@pytest.mark.parametrize("seed", [1, 2])
def test_road_users_start_at_speeds_from_which_they_can_stop(seed: int) -> None:
    """Behind the next one on the same line, and vehicles before the junction, within 2 m/s² after a second."""
    points = starting_points(network("intersection"))
    starts = draw_starts(np.array([24, 8, 12]), points, np.random.default_rng(seed))
    most = np.array([14.0, 7.0, 1.8])
    speed = starting_speeds(starts, most, np.random.default_rng(seed))
    usual = starting_speed(most[starts.type], starts.limit, np.random.default_rng(seed).random(len(speed)))
    assert (speed <= usual + 1e-9).all()
    assert 0 < (speed < usual - 0.1).sum() < len(speed)
    needed = speed + speed**2 / 4.0
    vehicles = starts.type != RoadUserType.PEDESTRIAN
    assert (needed[vehicles] <= starts.rest[vehicles] + 1e-6).all()
    world = boxes(starts.type, starts.x, starts.y, starts.heading)
    pairs = 0
    for row in range(len(speed)):
        ahead, aside = to_ego(starts.x - starts.x[row], starts.y - starts.y[row], starts.heading[row])
        same = (np.abs(wrap_angle(starts.heading - starts.heading[row])) < 0.1) & (np.abs(aside) < 0.5) & (ahead > 0)
        for leader in np.flatnonzero(same):
            gap = ahead[leader] - 0.5 * (world.length[row] + world.length[leader])
            assert needed[row] - speed[leader] ** 2 / 4.0 <= gap + 0.5
            pairs += 1
    assert pairs > 10


@pytest.mark.parametrize("config", ["intersection", "shared-space", "district"])
def test_starts_are_places_of_their_type_heading_along_it(config: str) -> None:
    points = starting_points(network(config))
    counts, _ = type_counts(64, None, points, "here")
    kinds, x, y, heading, limit, _ = draw_starts(counts, points, np.random.default_rng(5))
    turned = 0
    for kind in RoadUserType:
        rows = np.flatnonzero(kinds == kind)
        nearest = points[kind].nearest(x[rows], y[rows])[:, 0]
        assert np.array_equal(points[kind].x[nearest], x[rows])
        assert np.array_equal(points[kind].y[nearest], y[rows])
        turn = np.abs(wrap_angle(heading[rows] - points[kind].heading[nearest]))
        if kind == RoadUserType.PEDESTRIAN:
            turned = int((turn > 3).sum())
            turn = np.minimum(turn, np.pi - turn)
        assert turn.max() < 1e-9
        lanes = points[kind].lanes
        assert limit[rows].tolist() == [lanes[lane].max_speed for lane in points[kind].lane[nearest]]
    # Pedestrians walk either way.
    assert 0 < turned < counts[RoadUserType.PEDESTRIAN]


def test_the_seed_decides_the_places() -> None:
    points = starting_points(network("district"))
    draws = [draw_starts(np.array([10, 5, 5]), points, np.random.default_rng(seed)) for seed in (4, 4, 9)]
    for a, b in zip(draws[0], draws[1], strict=True):
        assert np.array_equal(a, b)
    assert not np.array_equal(draws[0][1], draws[2][1])


def test_more_than_fit_is_refused_with_how_many_do() -> None:
    points = starting_points(network("intersection"))
    counts = np.array([100_000, 10, 10])
    with pytest.raises(InputError, match=r"agents=100020: only \d+ of 100000 car road users fit") as caught:
        draw_starts(counts, points, np.random.default_rng(1))
    fitting = int(str(caught.value).split("only ")[1].split()[0])
    kinds, *_ = draw_starts(np.array([fitting, 10, 10]), points, np.random.default_rng(1))
    assert len(kinds) == fitting + 20
    with pytest.raises(InputError, match="fit into this network"):
        draw_starts(np.array([fitting + 1, 10, 10]), points, np.random.default_rng(1))


def test_every_number_of_cars_up_to_the_most_starts_apart() -> None:
    """The loose order gives way to the tight one somewhere in between: no gap, no overlap."""
    points = starting_points(network("intersection"))
    for number in (20, 32, 44, 52):
        kinds, x, y, heading, *_ = draw_starts(np.array([number, 20, 30]), points, np.random.default_rng(number))
        assert len(kinds) == number + 50
        assert len(contact_pairs(boxes(kinds, x, y, heading))[1]) == 0


def test_points_of_no_network_are_no_starts() -> None:
    empty = tuple(LanePoints([], 2.0) for _ in RoadUserType)
    kinds, x, *_ = draw_starts(np.zeros(3, np.int64), empty, np.random.default_rng(1))
    assert (len(kinds), len(x)) == (0, 0)
    with pytest.raises(InputError, match="only 0 of 1 pedestrian"):
        draw_starts(np.array([0, 0, 1]), empty, np.random.default_rng(1))


def test_places_are_farther_apart_where_there_would_be_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    with SumoSession(find_scenario("district")) as session:
        usual = starting_points(session.network)
        monkeypatch.setattr("slrl_sumo.simulation.placement.spawn.MOST_STARTING_POINTS", 1000)
        fewer = starting_points(session.network)
    # Short lanes have one place however few there are to be.
    assert [len(points) <= max(1000, 2 * len(points.lanes)) for points in fewer] == [True] * 3
    assert len(fewer[2]) < len(usual[2])
    # Every lane still has a place.
    assert all(len(np.unique(points.lane)) == len(points.lanes) for points in fewer)
