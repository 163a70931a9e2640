"""Figures of several runs, by hand."""

from typing import Any

import pytest

from slrl_sumo.metrics.trip_outcomes import Fate, Journey, outcome
from slrl_sumo.scene.types import RoadUserType
from slrl_sumo.studies.takeover_tables import (
    TABLES,
    add_time_ratios,
    aligned,
    cell,
    markdown,
    on_route_share,
    overlaps,
    passages,
    table,
    time_inside,
)


def row(selector: str, seed: int = 1, **users: tuple[str, bool, float]) -> dict[str, Any]:
    """A run with some users (type, left, seconds) and made-up figures."""
    no_journeys = dict.fromkeys(
        ("taken", "on_route", "counted", "strayed", "strayed_at_end", "off_route", "lost"), 0
    ) | dict.fromkeys(("unfinished", "home_later", "under_way"), 0)
    figures = ("mean_speed_mps", "standing_share", "off_surface_share", "hard_braking_share", "lane_distance_mean_m")
    figures += ("lane_distance_p95_m", "sways_per_100_m", "against_share")
    kinds = ("car", "bicycle", "pedestrian", "all")
    return {
        "scenario": "made",
        "region": None,
        "seconds": 600.0,
        "selector": selector,
        "seed": seed,
        "journeys": {kind: dict(no_journeys) for kind in kinds},
        "passages": {kind: {"passages": 0, "red": 0, "yellow": 0} for kind in kinds},
        "conduct": {
            kind: dict.fromkeys(figures) | dict.fromkeys(("overlaps", "overlaps_background", "overlaps_shrunk"), 0)
            for kind in kinds
        },
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
            "died": "exit code -11",
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
    run["journeys"]["car"] |= {"taken": 50, "on_route": 30, "counted": 40}
    run["journeys"]["bicycle"] |= {"taken": 10, "on_route": 0, "counted": 10}
    run["passages"]["car"] = {"passages": 30, "red": 3, "yellow": 6}
    run["passages"]["bicycle"] = {"passages": 10, "red": 1, "yellow": 0}
    run["conduct"]["car"] |= {"overlaps": 4, "overlaps_shrunk": 1}
    assert on_route_share(["car", "bicycle"])(run) == 60.0
    assert on_route_share(["pedestrian"])(run) is None
    assert passages(["car", "bicycle"], "red")(run) == 100.0
    assert passages(["car"], "yellow")(run) == 200.0
    assert overlaps("car")(run) == 80.0
    assert overlaps("car", "overlaps_shrunk")(run) == 20.0
    assert overlaps("pedestrian")(run) is None


@pytest.mark.parametrize(
    ("values", "text"),
    [([1.0, 2.0, 6.0], "3.0 (1.0..6.0)"), ([2.0, 2.04], "2.0"), ([None, 5.0], "5.0"), ([None], "–"), ([], "–")],
)
def test_a_cell_is_the_mean_and_the_range(values: list[float | None], text: str) -> None:
    assert cell(values, 1) == text


def test_a_table_has_one_line_for_each_selector_and_counts_runs_that_died() -> None:
    rows = [row("sumo"), row("greedy"), row("greedy", seed=2), {**row("greedy", seed=3), "died": "exit code -11"}]
    rows[1]["journeys"]["all"]["taken"], rows[2]["journeys"]["all"]["taken"] = 10, 20
    rows[3]["journeys"]["all"]["taken"] = 999
    lines = table("Ways", rows)
    assert [line[:4] for line in lines] == [
        ["scenario", "selector", "runs", "taken"],
        ["made", "sumo", "1", "0"],
        ["made", "greedy", "2 (1 died)", "15 (10..20)"],
    ]
    assert markdown(lines).splitlines()[3].startswith("| made | greedy | 2 (1 died) | 15 (10..20) |")
    assert len({len(line) for line in aligned(lines).splitlines()}) == 1


@pytest.mark.parametrize("name", TABLES)
def test_every_table_can_be_made_of_runs_without_anybody(name: str) -> None:
    lines = table(name, [row("sumo")])
    assert len(lines[1]) == len(lines[0])


def test_who_is_counted_and_who_has_left_on_the_own_route() -> None:
    def journey(fate: Fate, taken: float, after: Fate | None = None, at_end: bool = False) -> Journey:
        return Journey(RoadUserType.CAR, taken, fate, 0.0, after or fate, ends=None, edges=(), strayed_at_end=at_end)  # type: ignore[arg-type]

    journeys = [
        journey("home", 10.0),
        journey("home", 550.0),
        journey("left", 20.0),
        journey("left", 20.0, after="lost"),
        journey("strayed", 30.0),
        journey("strayed", 30.0, at_end=True),
        journey("off_route", 40.0),
        journey("elsewhere", 40.0),
        journey("lost", 50.0),
        journey("inside", 480.0, after="home"),
        journey("inside", 481.0, after="home"),
        journey("inside", 481.0),
    ]
    found = outcome(journeys, end=600.0, time_to_leave=120.0, under_way=1)
    assert (found.taken, found.on_route, found.counted) == (12, 4, 10)
    assert (found.strayed, found.strayed_at_end, found.off_route, found.lost) == (2, 1, 2, 2)
    assert (found.unfinished, found.home_later, found.under_way) == (3, 2, 1)
