from pathlib import Path

import cv2
import numpy as np
import pytest
from builders import make_recording

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.mask import everywhere_road, ground_of_mask
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.studies.prediction.given_ground import given_ground

ROOT = Path(__file__).parents[3]
NET = ROOT / "sumo_scenarios" / "intersection" / "intersection.net.xml"
WHITE, YELLOW = (255, 255, 255), (0, 255, 255)  # as OpenCV has it: BGR


def walk(x: float, y: float) -> Trajectories:
    """One pedestrian that walks from (x, y) to the east."""
    return make_recording((np.linspace(x, x + 14.5, 30), y, 0.0), type=2)


def painted(file: Path) -> Path:
    """60 x 40 pixels: road all over, with a hole in it, in the hole a sidewalk, in that a hole; above it a grey dot."""
    picture = np.full((40, 60, 3), WHITE, np.uint8)
    picture[10:30, 10:40] = 0
    picture[14:26, 14:36] = YELLOW
    picture[18:22, 20:30] = 0
    picture[2, 3] = 200
    cv2.imwrite(str(file), picture)
    return file


def test_a_mask_is_what_its_pixels_say(tmp_path: Path) -> None:
    file = painted(tmp_path / "mask.png")
    roadmap = ground_of_mask(file, 0.5)
    picture = cv2.imread(str(file))
    assert picture is not None
    row, col = (grid.ravel() for grid in np.mgrid[:40, :60])
    # Column c and row r lie at (c + 0.5, -(r + 0.5)) pixels.
    found = roadmap.surface_at(0.5 * (col + 0.5), -0.5 * (row + 0.5))
    blue, green = picture[row, col, 0] > 127, picture[row, col, 1] > 127
    expected = np.where(blue & green, Surface.ROAD, np.where(green, Surface.SIDEWALK, Surface.NONE))
    np.testing.assert_array_equal(found, expected)
    assert set(expected.tolist()) == {Surface.NONE, Surface.ROAD, Surface.SIDEWALK}
    assert roadmap.surface_at(np.array([-1.0, 5.0, 31.0]), np.array([-5.0, 1.0, -5.0])).tolist() == [0, 0, 0]


def test_a_network_is_the_ground_in_its_own_coordinates() -> None:
    found, name, routes = given_ground(walk(88.0, 95.0), NET, None, None, None)
    assert found is not None
    x0, y0, x1, y1 = found.bounds
    x, y = np.mgrid[x0:x1:0.5, y0:y1:0.5].reshape(2, -1)
    assert {Surface.ROAD, Surface.SIDEWALK} <= set(found.surface_at(x, y).tolist())
    assert (x0 + x1) / 2 == pytest.approx(95.0, abs=1.0)
    assert (y0 + y1) / 2 == pytest.approx(95.0, abs=1.0)
    assert name == f"SUMO network {NET}"
    # A car that comes from the west leaves to the east.
    assert routes is not None
    car = make_recording((np.linspace(60.0, 72.0, 6), 93.4, 0.0))
    (expected,) = routes.of(car, np.array([5]))
    assert expected is not None
    assert expected.line.end > 140.0
    x, _, heading = expected.line.at(140.0)
    assert x > 95.0
    assert heading == pytest.approx(0.0, abs=0.1)


def test_without_either_there_is_road_everywhere() -> None:
    made = walk(100.0, -20.0)
    assert given_ground(made, None, None, None, None) == (None, "", None)
    roadmap = everywhere_road(made.x, made.y)
    assert (roadmap.surface_at(made.x, made.y + 50.0) == Surface.ROAD).all()


def test_what_does_not_fit_gets_one_line(tmp_path: Path) -> None:
    mask, made = painted(tmp_path / "mask.png"), walk(5.0, -2.0)
    with pytest.raises(InputError, match="--net and --mask were both given"):
        given_ground(made, NET, None, mask, 0.5)
    for one, other in ((mask, None), (None, 0.5)):
        with pytest.raises(InputError, match="belong together"):
            given_ground(made, None, None, one, other)
    with pytest.raises(InputError, match="--metres-per-pixel 0: give the side of a pixel"):
        given_ground(made, None, None, mask, 0.0)
    with pytest.raises(InputError, match="0% of the recorded positions lie on its surfaces"):
        given_ground(walk(500.0, 500.0), None, None, mask, 0.5)
    with pytest.raises(InputError, match="there is no such file; give a SUMO network"):
        given_ground(made, tmp_path / "no.net.xml", None, None, None)
    (tmp_path / "text.png").write_text("no picture")
    for file in (tmp_path / "text.png", tmp_path / "none.png"):
        with pytest.raises(InputError, match=r"cannot be read as a picture .*; give a PNG"):
            given_ground(made, None, None, file, 0.5)
    with pytest.raises(InputError, match=r"^--net [^ ]*text\.png: cannot be read \(it is no XML"):
        given_ground(made, tmp_path / "text.png", None, None, None)
    red = np.zeros((4, 4, 3), np.uint8)
    red[1, 2] = (0, 0, 255)
    cv2.imwrite(str(tmp_path / "red.png"), red)
    with pytest.raises(InputError, match=r"pixel \(column 2, row 1\) is \(255, 0, 0\); paint white for road"):
        given_ground(made, None, None, tmp_path / "red.png", 0.5)
    cv2.imwrite(str(tmp_path / "red.png"), 0 * red)
    with pytest.raises(InputError, match="there is no road in it"):
        given_ground(made, None, None, tmp_path / "red.png", 0.5)
