"""Lines on small pictures, and pictures made small: the same pixels as OpenCV's."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from slrl_sumo.perception import ego_image as raster
from slrl_sumo.perception.line_raster import EDGE, draw_lines

ROWS, COLS = 40, 80


def ours(line: NDArray[np.int64], thickness: int, first: bool = True) -> NDArray[np.uint8]:
    canvas = np.zeros((ROWS + 2 * EDGE, COLS + 2 * EDGE), np.uint8)
    draw_lines(canvas, np.array([[*line, 9, thickness, first]], np.int64), 1)
    return canvas[EDGE:-EDGE, EDGE:-EDGE]


def opencvs(points: NDArray[np.int64], thickness: int) -> NDArray[np.uint8]:
    """With room above and below, because OpenCV's lines change where they are cut."""
    canvas = np.zeros((ROWS + 60, COLS), np.uint8)
    shifted = points.reshape(1, -1, 2) + np.array([0, 30 * 16])
    cv2.polylines(canvas, list(shifted.astype(np.int32)), False, 9, thickness, cv2.LINE_8, 4)
    return canvas[30:-30]


@pytest.mark.parametrize("thickness", raster.THICKNESS.tolist())
def test_lines_are_opencvs_to_the_pixel(thickness: int) -> None:
    rng = np.random.default_rng(thickness)
    n = 2500
    x, y = rng.uniform(-4, COLS + 4, n), rng.uniform(-5, ROWS + 5, n)
    x[: n // 4] = rng.uniform(-3, 3, n // 4)  # across the border, where lines are cut
    length = rng.choice([0.3, 2.0, 9.0, 30.0, 90.0], n)
    angle = rng.uniform(-np.pi, np.pi, n)
    angle[::5] = rng.integers(-2, 3, len(angle[::5])) * np.pi / 2
    ends = np.column_stack([x, y, x + length * np.cos(angle), y + length * np.sin(angle)])
    ends = np.rint(16 * ends[np.abs(ends[:, 3] - ROWS / 2) < ROWS / 2 + 5]).astype(np.int64)
    drawn = [ours(line, thickness) for line in ends]
    assert len(drawn) > n / 2
    assert np.mean(np.array(drawn) > 0) > 0.005
    different = sum(not np.array_equal(a, opencvs(line, thickness)) for a, line in zip(drawn, ends, strict=True))
    # Older releases of OpenCV may round otherwise at the border.
    assert different <= (0 if cv2.__version__ >= "5" else n / 100)


def test_a_point_is_a_disc_and_a_line_goes_on_without_a_second_one() -> None:
    point = np.array([16 * 20, 16 * 10] * 2)
    assert ours(point, 2).astype(bool).sum() == 5
    assert np.array_equal(ours(point, 7), opencvs(point, 7))
    bend = np.array([16 * 20, 16 * 10, 16 * 30, 16 * 12, 16 * 33, 16 * 30])
    both = ours(bend[:4], 3) | ours(bend[2:], 3, first=False)
    assert np.array_equal(both, opencvs(bend, 3))


@pytest.mark.parametrize("far", [2**21, -(2**21), np.iinfo(np.int64).min])
def test_lines_beyond_all_bounds_draw_nothing(far: int) -> None:
    for place in range(4):
        line = np.array([16 * 20, 16 * 10, 16 * 30, 16 * 12])
        line[place] = far
        assert not ours(line, 3).any()


@pytest.mark.parametrize(
    ("palette", "colours"),
    [(raster.PAPER_PALETTE, raster.PAPER_COLOURS), (raster.EXTENDED_PALETTE, raster.EXTENDED_COLOURS)],
)
def test_small_pictures_are_the_mean_colours(palette: NDArray[np.uint8], colours: NDArray[np.uint32]) -> None:
    view = np.random.default_rng(0).integers(0, raster.VALUES, (ROWS, COLS)).astype(np.uint8)
    small = np.zeros((2, ROWS // 2, COLS // 2, 3), np.uint8)
    raster._shrink(np.pad(view, EDGE), small, 1, colours)
    large = cv2.applyColorMap(view, palette)
    assert np.array_equal(small[1], cv2.resize(large, (COLS // 2, ROWS // 2), interpolation=cv2.INTER_AREA))
    assert not small[0].any()
