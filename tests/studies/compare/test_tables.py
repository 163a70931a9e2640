"""Tables of a comparison, from runs made up by hand."""

import math
from typing import Any

import pytest

from slrl_sumo.studies.compare.measures import MEASURES
from slrl_sumo.studies.compare.run import Record, Run
from slrl_sumo.studies.compare.tables import confidence_interval, distances, rows
from slrl_sumo.studies.compare.verdicts import too_few, verdict

CAR, WALKER = 0, 2
KINDS = ("car", "bicycle", "pedestrian", "all")


def record(trips: dict[str, list[Any]], **other: Any) -> Record:
    stats = {
        "steps": 9000,
        "mean_speed_mps": 4.0,
        "hard_braking_share": 0.01,
        "off_surface_share": 0.0,
        "near_misses": 1,
        "collisions": 0,
    }
    return {
        "trips": trips,
        "driving_stats": {kind: dict(stats) for kind in KINDS},
        "signal_crossings": {kind: {"all": 50 * (kind == "car"), "red": 2 * (kind == "car")} for kind in KINDS[:3]},
        "conflicts": {"ttc": [], "pet": []},
        "emissions": {"co2": 500.0, "nox": 1.0, "pmx": 0.1, "fuel": 160.0, "metres": 2000.0, "unknown": []},
        "histograms": {"speed": {"car": [0.5, 0.5]}, "acceleration": {}, "yaw_rate": {}},
        "learned": {"steps": 0},
    } | other


def car(departed: float, arrived: float | None, loss: float = 0.0, stops: int = 0, delay: float = 0.0) -> list[Any]:
    return [CAR, "passenger", departed, delay, arrived, loss, stops, 2.0 * stops, 100.0]


def row(runs: dict[Run, Record], measure: str, kind: str) -> dict[str, Any]:
    (found,) = (r for r in rows(runs) if (r["measure"], r["type"]) == (measure, kind))
    return found


def two_seeds() -> dict[Run, Record]:
    return {
        # a arrives in both arms, b and c in one of them.
        Run(1, "sumo"): record({"a": car(0, 20, 3, 1), "b": car(5, 15), "c": car(6, None)}),
        Run(1, "learned"): record({"a": car(0, 26, 9, 0, 1.0), "b": car(5, None), "c": car(6, 99)}),
        Run(2, "sumo"): record({"a": car(0, 20, 4, 1)}),
        Run(2, "learned"): record({"a": car(0, 30, 8, 1)}),
    }


def test_travel_times_are_of_those_that_arrived_in_both_arms() -> None:
    found = row(two_seeds(), "travel_time", "car")
    assert (found["sumo"], found["learned"], found["difference"]) == (20.0, 28.0, 8.0)
    assert found["by_seed"] == {"1": {"sumo": 20.0, "learned": 26.0}, "2": {"sumo": 20.0, "learned": 30.0}}
    # Differences 6 and 10: mean 8, standard error 2, t(0.975; 1) = 12.706.
    assert (found["difference_low"], found["difference_high"]) == pytest.approx((8 - 25.412, 8 + 25.412), abs=1e-3)
    assert (found["sumo_low"], found["sumo_high"]) == (20.0, 20.0)
    assert row(two_seeds(), "trips", "car")["sumo"] == 1.5


def test_delay_is_the_loss_and_the_wait_to_depart() -> None:
    assert row(two_seeds(), "time_loss", "car")["learned"] == 8.5
    assert row(two_seeds(), "delay", "car")["learned"] == 9.0
    assert row(two_seeds(), "way", "car")["learned"] == 100.0
    assert row(two_seeds(), "stops", "car")["difference"] == -0.5
    assert row(two_seeds(), "standing", "car")["difference"] == -1.0


def test_one_seed_has_no_interval_and_absent_types_have_no_rows() -> None:
    runs = {run: one for run, one in two_seeds().items() if run.seed == 1}
    found = row(runs, "travel_time", "car")
    assert (found["difference"], found["difference_low"], found["difference_high"]) == (6.0, None, None)
    assert not [r for r in rows(runs) if r["type"] == "bicycle" and r["measure"] in ("travel_time", "delay", "red")]


def test_conflicts_count_for_both_types_and_once_for_all() -> None:
    meetings = [["a", "p", "car", "pedestrian", 3.0, 0, 0, 1.0, 5, 1], ["a", "b", "car", "car", 9.0, 0, 0, 0.5, 5, 0]]
    runs = two_seeds()
    runs[Run(1, "learned")]["conflicts"] = {"ttc": meetings, "pet": meetings[:1]}
    assert [row(runs, "ttc", kind)["by_seed"]["1"]["learned"] for kind in KINDS] == [2, 0, 1, 2]
    assert row(runs, "pet", "all")["difference"] == 0.5
    # 9000 steps of 0.4 s are an hour.
    assert row(runs, "ttc_rate", "all")["by_seed"]["1"] == {"sumo": 0.0, "learned": 2.0}


def test_rates_have_their_units() -> None:
    runs = two_seeds()
    assert row(runs, "co2_per_km", "all")["sumo"] == 250.0
    assert row(runs, "co2", "all")["sumo"] == 0.5
    assert row(runs, "red", "car")["sumo"] == 40.0
    assert row(runs, "hard_braking", "car")["sumo"] == 1.0


def test_every_measure_has_a_unit_and_a_definition() -> None:
    assert len({measure.name for measure in MEASURES}) == len(MEASURES)
    assert all(measure.unit and len(measure.definition) > 20 for measure in MEASURES)


def test_distances_of_distributions() -> None:
    runs = two_seeds()
    runs[Run(2, "learned")]["histograms"]["speed"] = {"car": [1.0, 0.0]}
    (found,) = distances(runs)
    moved = math.sqrt(0.5 * math.log2(4 / 3) + 0.5 * (0.5 * math.log2(2 / 3) + 0.5))
    assert (found["type"], found["quantity"], found["seeds"]) == ("car", "speed", 2)
    assert found["distance"] == pytest.approx(0.5 * moved)


def test_an_interval_by_students_t() -> None:
    # Mean 2, standard deviation 1, n = 3: t(0.975; 2) = 4.3027.
    assert confidence_interval([1.0, 2.0, 3.0]) == pytest.approx((2 - 4.3027 / 3**0.5, 2 + 4.3027 / 3**0.5), abs=1e-4)
    assert confidence_interval([1.0]) is None


@pytest.mark.parametrize(
    ("low", "high", "own", "expected"),
    [
        (None, None, 10.0, "too few seeds"),
        (0.5, 2.0, 10.0, "higher"),
        (-2.0, -0.1, 10.0, "lower"),
        (-1.0, 1.0, 10.0, "no difference shown"),
        (-8.0, 9.0, 10.0, "too few seeds"),
        (-1.0, 3.0, 0.0, "too few seeds"),
        (0.0, 0.0, 0.0, "no difference shown"),
    ],
)
def test_wide_intervals_say_nothing(low: float | None, high: float | None, own: float, expected: str) -> None:
    row = {"difference_low": low, "difference_high": high, "sumo": own}
    assert verdict(row, "sumo") == expected
    assert bool(too_few([{"verdict": verdict(row, "sumo")}], 2)) == (expected == "too few seeds")
