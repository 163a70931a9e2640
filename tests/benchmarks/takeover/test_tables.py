"""Figures of several runs, by hand."""

from typing import Any

import pytest

from benchmarks.takeover.tables import (
    TABLES,
    add_time_ratios,
    aligned,
    cell,
    collisions,
    crossings_at,
    markdown,
    on_route_share,
    table,
    time_inside,
)
from benchmarks.takeover.trip_outcomes import Fate, TakenTrip, count_outcomes
from slrl_sumo.scene.types import RoadUserType


def row(selector: str, seed: int = 1, **users: tuple[str, bool, float]) -> dict[str, Any]:
    """A run with some users (type, left, seconds) and made-up figures."""
    no_trips = dict.fromkeys(
        ("taken", "on_route", "counted", "returned_to_route", "left_network_at_end", "off_route", "lost"), 0
    ) | dict.fromkeys(("unfinished", "arrived_later", "under_way"), 0)
    figures = ("mean_speed_mps", "standing_share", "off_surface_share", "hard_braking_share", "lane_distance_mean_m")
    figures += ("lane_distance_p95_m", "sways_per_100_m", "against_share")
    kinds = ("car", "bicycle", "pedestrian", "all")
    return {
        "scenario": "made",
        "region": None,
        "seconds": 600.0,
        "selector": selector,
        "seed": seed,
        "trip_outcomes": {kind: dict(no_trips) for kind in kinds},
        "signal_crossings": {kind: {"all": 0, "red": 0, "yellow": 0} for kind in kinds},
        "driving_stats": {
            kind: dict.fromkeys(figures) | dict.fromkeys(("collisions", "collisions_with_background", "near_misses"), 0)
            for kind in kinds
        },
        "hand_back": dict.fromkeys(("jumps", "teleports"), 0)
        | dict.fromkeys(f"hard_braking_{when}_per_1000_s" for when in ("after", "otherwise")),
        "throughput": {"agent_steps_per_s": 1.0, "ms_per_decision": 2.0, "mean_learned": 3.0},
        "users": {i: {"type": kind, "left": left, "inside_s": s} for i, (kind, left, s) in users.items()},
    }


def test_times_are_compared_over_the_same_road_users_of_the_same_seed() -> None:
    rows = [
        row("sumo", a=("car", True, 10.0), b=("car", True, 20.0), c=("car", True, 40.0), d=("car", False, 0.0)),
        row("sumo", seed=2, a=("car", True, 1000.0)),
        row("greedy", a=("car", True, 30.0), b=("car", True, 20.0), c=("car", False, 9.0), d=("car", True, 1.0)),
        {
            "scenario": "made",
            "region": None,
            "seconds": 600.0,
            "seed": 3,
            "selector": "greedy",
            "failed": "exit code -11",
        },
    ]
    add_time_ratios(rows)
    # Of a and b: medians 25 and 15, ratios 3 and 1.
    assert rows[2]["time_ratio"]["car"] == {"of_medians": 25.0 / 15.0, "median": 2.0, "n": 2}
    assert rows[2]["time_ratio"]["bicycle"] == {"of_medians": None, "median": None, "n": 0}
    assert rows[0]["time_ratio"]["car"]["of_medians"] == 1.0
    assert time_inside("car")(rows[2]) == 20.0
    assert "time_ratio" not in rows[3]


def test_shares_and_rates_are_over_their_own_denominators() -> None:
    run = row("greedy")
    run["trip_outcomes"]["car"] |= {"taken": 50, "on_route": 30, "counted": 40}
    run["trip_outcomes"]["bicycle"] |= {"taken": 10, "on_route": 0, "counted": 10}
    run["signal_crossings"]["car"] = {"all": 30, "red": 3, "yellow": 6}
    run["signal_crossings"]["bicycle"] = {"all": 10, "red": 1, "yellow": 0}
    run["driving_stats"]["car"] |= {"collisions": 4, "near_misses": 1}
    assert on_route_share(["car", "bicycle"])(run) == 60.0
    assert on_route_share(["pedestrian"])(run) is None
    assert crossings_at(["car", "bicycle"], "red")(run) == 100.0
    assert crossings_at(["car"], "yellow")(run) == 200.0
    assert collisions("car")(run) == 80.0
    assert collisions("car", "near_misses")(run) == 20.0
    assert collisions("pedestrian")(run) is None


@pytest.mark.parametrize(
    ("values", "text"),
    [([1.0, 2.0, 6.0], "3.0 (1.0..6.0)"), ([2.0, 2.04], "2.0"), ([None, 5.0], "5.0"), ([None], "–"), ([], "–")],
)
def test_a_cell_is_the_mean_and_the_range(values: list[float | None], text: str) -> None:
    assert cell(values, 1) == text


def test_a_table_has_one_line_for_each_selector_and_counts_runs_that_failed() -> None:
    rows = [row("sumo"), row("greedy"), row("greedy", seed=2), {**row("greedy", seed=3), "failed": "exit code -11"}]
    rows[1]["trip_outcomes"]["all"]["taken"], rows[2]["trip_outcomes"]["all"]["taken"] = 10, 20
    rows[3]["trip_outcomes"]["all"]["taken"] = 999
    lines = table("Trips", rows)
    assert [line[:4] for line in lines] == [
        ["scenario", "selector", "runs", "taken"],
        ["made", "sumo", "1", "0"],
        ["made", "greedy", "2 (1 failed)", "15 (10..20)"],
    ]
    assert markdown(lines).splitlines()[3].startswith("| made | greedy | 2 (1 failed) | 15 (10..20) |")
    assert len({len(line) for line in aligned(lines).splitlines()}) == 1


@pytest.mark.parametrize("name", TABLES)
def test_every_table_can_be_made_of_runs_without_road_users(name: str) -> None:
    lines = table(name, [row("sumo")])
    assert len(lines[1]) == len(lines[0])


def test_counted_trips_and_trips_that_left_on_their_own_route() -> None:
    def trip(fate: Fate, taken: float, after: Fate | None = None, at_end: bool = False) -> TakenTrip:
        return TakenTrip(
            RoadUserType.CAR, taken, fate, 0.0, after or fate, ends=None, edges=(), left_network_at_end=at_end
        )  # type: ignore[arg-type]

    trips = [
        trip("arrived", 10.0),
        trip("arrived", 550.0),
        trip("left", 20.0),
        trip("left", 20.0, after="lost"),
        trip("returned_to_route", 30.0),
        trip("returned_to_route", 30.0, at_end=True),
        trip("off_route", 40.0),
        trip("elsewhere", 40.0),
        trip("lost", 50.0),
        trip("inside", 480.0, after="arrived"),
        trip("inside", 481.0, after="arrived"),
        trip("inside", 481.0),
    ]
    found = count_outcomes(trips, end=600.0, time_to_leave=120.0, under_way=1)
    assert (found.taken, found.on_route, found.counted) == (12, 4, 10)
    assert (found.returned_to_route, found.left_network_at_end, found.off_route, found.lost) == (2, 1, 2, 2)
    assert (found.unfinished, found.arrived_later, found.under_way) == (3, 2, 1)
