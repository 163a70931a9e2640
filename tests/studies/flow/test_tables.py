"""The table: means over seeds, and ratios to SUMO's run of the same seed."""

from typing import Any

from slrl_sumo.studies.flow.run import SUMO, Record, Run
from slrl_sumo.studies.flow.tables import rows


def record(finished: int, **trips: tuple[float, float | None]) -> Record:
    return {"figures": {"finished": finished, "red_runs": 0.0, "start": None}, "trips": dict(trips)}


def test_ratios_are_those_to_sumo_of_the_same_seed() -> None:
    runs = {
        Run("queue", SUMO, 1): record(100, a=(0.0, 10.0), b=(0.0, 20.0), c=(0.0, 30.0)),
        Run("queue", SUMO, 2): record(50, a=(0.0, 10.0)),
        Run("queue", "lane", 1): record(90, a=(0.0, 20.0), b=(0.0, None), c=(5.0, 65.0)),
        Run("queue", "lane", 2): record(55, a=(0.0, 20.0)),
        Run("signal", "lane", 1): record(10, a=(0.0, 20.0)),
    }
    found: dict[tuple[str, str, str], dict[str, Any]] = {
        (row["situation"], row["figure"], row["arm"]): row for row in rows(runs)
    }
    lane = found["queue", "finished", "lane"]
    assert (lane["value"], lane["ratio"], lane["by_seed"]) == (72.5, 1.0, {"1": 90, "2": 55})
    assert found["queue", "finished", SUMO]["ratio"] is None
    # Of the vehicles that finished in both: a and c of seed 1 take 20 and 60 s beside 10 and 30 s of SUMO's.
    assert found["queue", "travel_time", "lane"]["by_seed"] == {"1": 40.0, "2": 20.0}
    assert found["queue", "travel_time", "lane"]["ratio"] == 2.0
    # Nothing to compare with, and no value.
    assert found["queue", "red_runs", "lane"]["ratio"] is None
    assert found["signal", "finished", "lane"]["ratio"] is None
    assert not any(figure == "start" for _, figure, _ in found)
