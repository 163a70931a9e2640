"""The picture of some cars' paths."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from benchmarks.takeover.paths_picture import beside, choose_paths, draw_paths
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession


def test_ten_cars_are_drawn_by_the_seed_among_those_that_drove_for_a_while() -> None:
    paths = {f"long{i}": [(float(k), 0.0, 5.0) for k in range(40)] for i in range(30)}
    paths |= {f"short{i}": [(0.0, 0.0, 0.0)] for i in range(30)}
    chosen = choose_paths(paths, 1)
    assert len(chosen) == 10
    assert all(car.startswith("long") for car in chosen)
    assert list(chosen) == list(choose_paths(dict(reversed(paths.items())), 1))
    assert list(chosen) != list(choose_paths(paths, 2))
    assert list(choose_paths({"short": [(0.0, 0.0, 0.0)]}, 1)) == ["short"]


def test_slow_and_fast_cars_have_different_colours_where_they_drove(
    tmp_path: Path, bare_network: Callable[[str], Path]
) -> None:
    with SumoSession(find_scenario(str(bare_network('<edge id="ab" from="a" to="b"/>')))) as session:
        network = session.network
    x = np.linspace(0.0, 90.0, 60)
    paths = {"slow": np.column_stack([x, 0 * x - 1.0, 0 * x]), "fast": np.column_stack([x, 0 * x + 9.0, 0 * x + 14.0])}
    draw_paths(network, paths, "made", tmp_path / "new" / "paths.png")
    picture = cv2.imread(str(tmp_path / "new" / "paths.png")).astype(int)
    assert picture.shape[1] == 2000
    # viridis: dark violet for 0, yellow for the fastest (BGR).
    purple = (np.abs(picture - (84, 1, 68)).sum(axis=2) < 20).sum()
    yellow = (np.abs(picture - (37, 231, 253)).sum(axis=2) < 20).sum()
    assert purple > 500
    assert yellow > 500
    draw_paths(network, {}, "made", tmp_path / "none.png")
    assert not (tmp_path / "none.png").exists()


def test_a_line_beside_another_lies_to_its_left() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0]])
    assert beside(line, 2.0).tolist() == [[0.0, 2.0], [10.0, 2.0]]
