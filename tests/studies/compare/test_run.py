"""One run of a comparison: the road users that it takes over."""

from slrl_sumo.studies.compare.run import LEARNED, ComparedScenario, Run, run_comparison


def test_excluded_road_users_are_measured_and_not_taken_over() -> None:
    common = ComparedScenario("signalised", "intersection", decisions=20, selector="lane")
    whole = run_comparison(common, Run(1, LEARNED))
    assert whole["learned"]["taken_over"] > 2
    excluded = ComparedScenario("signalised", "intersection", 20, exclude=",".join(whole["trips"]), selector="lane")
    record = run_comparison(excluded, Run(1, LEARNED))
    assert record["learned"]["taken_over"] == 0
    assert set(record["trips"]) == set(whole["trips"])
