from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.geometry import wrap_angle

DATA = Path(__file__).parents[4] / "shared" / "data"

Write = Callable[[str, Sequence[str], Sequence[Sequence[object]]], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a CSV file with a header, below tmp_path."""

    def write(name: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = [",".join(columns), *(",".join(str(cell) for cell in row) for row in rows)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    return write


@pytest.fixture
def data() -> Path:
    """The folder with real recordings."""
    if not DATA.is_dir():
        pytest.skip(f"no recordings at {DATA}")
    return DATA


@pytest.fixture
def sideslip() -> Callable[[Trajectories], np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """Angle (rad) between motion and mean heading in each interval of more than 0.5 m/s; backwards counts as along."""

    def sideslip(t: Trajectories) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        row = np.flatnonzero((np.diff(t.track) == 0) & (t.speed[1:] > 0.5))
        middle = t.heading[row] + 0.5 * wrap_angle(t.heading[row + 1] - t.heading[row])
        slip = np.abs(wrap_angle(np.arctan2(np.diff(t.y)[row], np.diff(t.x)[row]) - middle))
        return np.minimum(slip, np.where(t.type[t.track[row]] == 0, np.pi - slip, slip))

    return sideslip
