"""The rows of an evaluation, by hand."""

import numpy as np
import pytest

from slrl_sumo.metrics.outcomes import TypeOutcome
from slrl_sumo.studies.episodes.episode import Episode
from slrl_sumo.studies.episodes.published import published_rows
from slrl_sumo.studies.episodes.tables import COLUMNS, EpisodeTables


def outcome(survived: tuple[int, ...], speed: float, kind: str = "car", off_surface: int | None = 2) -> TypeOutcome:
    """Road users that are there for 10 decisions, and stand in one of them."""
    steps = 10 * len(survived)
    return TypeOutcome(
        type=kind,
        present=(10,) * len(survived),
        paper_survived=survived,
        succeeded=len(survived) - 1,
        speed_sum=speed * steps,
        moving_speed_sum=speed * steps,
        standing=len(survived),
        collisions=1,
        near_misses=3,
        paper_collisions=2,
        off_surface=off_surface,
    )


def table_rows(
    played: dict[Episode, tuple[TypeOutcome, ...]], steps: int, per_seed: int = 2
) -> list[dict[str, object]]:
    tables = EpisodeTables(list(dict.fromkeys((e.selector, e.agents) for e in played)), steps, per_seed)
    for episode, parts in played.items():
        tables.add(episode, parts)
    return tables.rows()


def test_figures_of_two_seeds_with_two_episodes() -> None:
    played = {
        Episode("prior", 2, 1, 0): (outcome((10, 5), 4.0),),
        Episode("prior", 2, 1, 1): (outcome((10, 10), 6.0),),
        Episode("prior", 2, 2, 0): (outcome((0, 5), 2.0),),
        Episode("prior", 2, 2, 1): (outcome((10, 10), 8.0),),
    }
    (row,) = table_rows(played, 10)
    assert tuple(row) == COLUMNS
    assert (row["selector"], row["type"], row["agents"]) == ("prior", "car", 2)
    assert (row["episodes"], row["seeds"], row["road_users"]) == (4, 2, 8)
    assert row["success_rate"] == 4 / 8
    assert row["paper_success_rate"] == 5 / 8
    assert row["paper_survival_steps"] == pytest.approx(60 / 8)
    assert row["paper_collisions_per_1000_steps"] == pytest.approx(100.0)
    assert row["mean_speed_mps"] == pytest.approx(5.0)
    assert row["mean_speed_moving_mps"] == pytest.approx(5.0 / 0.9, abs=1e-6)
    assert row["standing_share"] == pytest.approx(0.1)
    assert row["collisions_per_1000_steps"] == pytest.approx(50.0)
    assert row["near_misses_per_1000_steps"] == pytest.approx(150.0)
    assert row["off_surface_share"] == pytest.approx(0.1)
    # Episodes 1/2, 1, 0, 1; seeds 3/4, 1/2.
    assert row["paper_success_rate_std"] == pytest.approx((11 / 48) ** 0.5, abs=1e-6)
    assert row["paper_success_rate_seed_std"] == pytest.approx(0.125 * 2**0.5, abs=1e-6)
    assert row["mean_speed_mps_std"] == pytest.approx((20 / 3) ** 0.5, abs=1e-6)
    assert row["mean_speed_mps_seed_std"] == 0.0


def test_absent_types_are_left_out_and_not_counted_as_zero() -> None:
    played = {
        Episode("sumo", 0, 1, 0): (
            outcome((10,), 4.0, off_surface=0),
            outcome((10,), 1.0, "pedestrian", off_surface=None),
        ),
        Episode("sumo", 0, 1, 1): (outcome((10,), 4.0),),
    }
    car, pedestrian = table_rows(played, 10)
    assert (car["episodes"], pedestrian["episodes"]) == (2, 2)
    assert (pedestrian["paper_survival_steps"], pedestrian["mean_speed_mps"]) == (10.0, 1.0)
    assert pedestrian["mean_speed_mps_std"] is None
    assert pedestrian["mean_speed_mps_seed_std"] is None
    assert (car["off_surface_share"], pedestrian["off_surface_share"]) == (0.1, None)


def test_a_road_user_that_always_stands_has_no_moving_speed() -> None:
    still = TypeOutcome("car", (4,), (4,), 1, 0.0, 0.0, 4, 0, 0, 0, 0)
    (row,) = table_rows({Episode("prior", 1, 1, 0): (still,)}, 4)
    assert (row["mean_speed_mps"], row["mean_speed_moving_mps"], row["standing_share"]) == (0.0, None, 1.0)


def test_published_rows_are_marked_and_their_speeds_given_in_both_units() -> None:
    rows = {(row["table"], row["method"], row["type"]): row for row in published_rows()}
    assert all(row["measured_elsewhere"] for row in rows.values())
    ours = rows["Table 1", "SL+RL", "car"]
    assert (ours["paper_success_rate"], ours["paper_survival_steps"]) == (0.43, 79)
    assert (ours["mean_speed_printed_mps"], ours["mean_speed_if_per_step_mps"]) == (2.4, 6.0)
    truth = rows["Table 2", "ground truth", "bicycle"]
    assert (truth["mean_speed_printed_mps"], truth["mean_speed_if_per_step_mps"]) == (2.96, None)
    assert rows["Table 2", "SL", "bicycle"]["paper_success_rate"] is None


def test_the_order_in_which_episodes_end_does_not_change_a_bit() -> None:
    speeds = np.random.default_rng(1).lognormal(0.0, 3.0, 60)
    played = {
        Episode("prior", 2, number // 6, number % 6): (outcome((10, number % 10), speed),)
        for number, speed in enumerate(speeds.tolist())
    }
    assert len({sum(np.random.default_rng(seed).permutation(speeds)) for seed in range(9)}) > 1  # floats would differ
    rows = table_rows(played, 10, 6)
    for seed in range(9):
        order = np.random.default_rng(seed).permutation(60)
        shuffled = {episode: played[episode] for episode in [list(played)[i] for i in order]}
        assert repr(table_rows(shuffled, 10, 6)) == repr(rows)


def test_a_seed_of_which_episodes_are_left_out_counts_with_the_others() -> None:
    tables = EpisodeTables([("prior", 2)], 10, 2)
    tables.add(Episode("prior", 2, 1, 0), (outcome((10, 5), 4.0),))
    tables.leave_out(Episode("prior", 2, 1, 1))
    tables.add(Episode("prior", 2, 2, 0), (outcome((0, 5), 2.0),))  # its second episode never comes
    (row,) = tables.rows()
    assert (row["episodes"], row["seeds"], row["mean_speed_mps"]) == (2, 2, 3.0)
    assert row["mean_speed_mps_seed_std"] == pytest.approx(2**0.5, abs=1e-6)
