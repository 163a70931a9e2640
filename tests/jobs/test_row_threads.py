"""Decisions with several threads are those with one."""

import hashlib
from pathlib import Path
from threading import get_ident

import numpy as np
import pytest
from conftest import Cli

from slrl_sumo.jobs.row_threads import FEWEST_ROWS, RowThreads


def test_parts_cover_all_rows_in_order_in_several_threads() -> None:
    threads = set()

    def work(some: slice) -> list[int]:
        threads.add(get_ident())
        return list(range(some.start, some.stop))

    for rows in (0, 1, 2 * FEWEST_ROWS - 1, 2 * FEWEST_ROWS, 10 * FEWEST_ROWS + 7):
        parts = RowThreads(3).each(work, rows)
        assert [row for part in parts for row in part] == list(range(rows))
        assert len(parts) == max(1, min(3, rows // FEWEST_ROWS))
    assert len(threads) > 1


def test_errors_in_other_threads_are_raised() -> None:
    def work(some: slice) -> None:
        if some.start:
            raise ValueError("late")

    with pytest.raises(ValueError, match="late"):
        RowThreads(2).each(work, 4 * FEWEST_ROWS)


@pytest.mark.parametrize(
    "words",
    [["--selector", "greedy", "--guard"], ["--selector", "prior", "--bundle", "intersection-paper", "--guard"]],
)
def test_a_run_is_bit_equal_for_any_number_of_threads(cli: Cli, tmp_path: Path, words: list[str]) -> None:
    digests = []
    for threads in (1, 3):
        trace = tmp_path / f"{threads}.csv"
        common = ["run", "district", "--agents", "200", "--mix", "car=0.2,bicycle=0.2,pedestrian=0.6", "--steps", "8"]
        cli(*common, *words, "--threads", str(threads), "--quiet", "--fcd", str(trace))
        digests.append(hashlib.sha256(trace.read_bytes()).hexdigest())
    assert len(np.unique(digests)) == 1
