"""Angles, ego frame and boxes."""

import cv2
import numpy as np
import pytest

from slrl_sumo.scene.geometry import (
    boxes_overlap,
    centre_from_front,
    cos_sin,
    from_ego,
    front_from_centre,
    heading_from_sumo,
    heading_to_sumo,
    to_ego,
    wrap_angle,
)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0, 0),
        (np.pi, np.pi),
        (-np.pi, np.pi),
        (1.5 * np.pi, -0.5 * np.pi),
        (-1.5 * np.pi, 0.5 * np.pi),
        (7 * np.pi, np.pi),
    ],
)
def test_wrap_angle_lands_in_the_half_open_interval(angle: float, wrapped: float) -> None:
    assert wrap_angle(angle) == pytest.approx(wrapped)


def test_wrap_angle_keeps_the_direction_near_pi() -> None:
    angles = np.pi + np.array([-1e-6, 1e-6])
    assert wrap_angle(angles) == pytest.approx([np.pi - 1e-6, -np.pi + 1e-6], abs=1e-12)


@pytest.mark.parametrize(
    ("degrees", "heading"), [(0, np.pi / 2), (90, 0), (180, -np.pi / 2), (270, np.pi), (45, np.pi / 4)]
)
def test_sumo_angles_by_hand(degrees: float, heading: float) -> None:
    assert heading_from_sumo(degrees) == pytest.approx(heading)
    assert heading_to_sumo(heading) == pytest.approx(degrees)


def test_sumo_angles_there_and_back() -> None:
    heading = np.concatenate([np.linspace(-np.pi, np.pi, 1000)[1:], np.pi - np.array([0, 1e-9])])
    back = heading_from_sumo(heading_to_sumo(heading))
    assert np.abs(wrap_angle(back - heading)).max() < 1e-12
    degrees = np.linspace(0, 360, 1000, endpoint=False)
    assert heading_to_sumo(heading_from_sumo(degrees)) == pytest.approx(degrees)


def test_front_and_centre() -> None:
    assert front_from_centre(1.0, 2.0, np.pi / 2, 5.0) == (pytest.approx(1.0), pytest.approx(4.5))
    rng = np.random.default_rng(1)
    x, y, heading, length = rng.uniform(-50, 50, (4, 100))
    back = centre_from_front(*front_from_centre(x, y, heading, length), heading, length)
    assert np.allclose(back, (x, y), atol=1e-12)


def test_ego_frame() -> None:
    # Looking north, something 3 m north is ahead and something 2 m west is on the left.
    assert np.allclose(to_ego([0.0, -2.0], [3.0, 0.0], np.pi / 2), ([3.0, 0.0], [0.0, 2.0]))
    dx, dy, heading = np.random.default_rng(2).uniform(-9, 9, (3, 100))
    assert np.allclose(from_ego(*to_ego(dx, dy, heading), heading), (dx, dy))


@pytest.mark.parametrize(
    ("other", "hit"),
    [
        ((4.9, 0.0, 0.0, 5.0, 2.0), True),  # bumper to bumper, 10 cm inside
        ((5.1, 0.0, 0.0, 5.0, 2.0), False),
        ((5.0, 0.0, 0.0, 5.0, 2.0), True),  # touching counts
        ((0.0, 2.1, np.pi, 5.0, 2.0), False),  # side by side
        ((3.4, 0.0, np.pi / 2, 5.0, 2.0), True),  # crossing its nose
        ((3.6, 0.0, np.pi / 2, 5.0, 2.0), False),
        ((3.6, 2.1, np.pi / 4, 4.0, 1.0), True),  # the turned one's tail reaches over the front left corner
        ((4.6, 2.1, np.pi / 4, 4.0, 1.0), False),  # axis-aligned boxes overlap, the boxes do not
        ((0.0, 0.0, 1.0, 0.2, 0.2), True),  # inside
    ],
)
def test_boxes_overlap_by_hand(other: tuple[float, ...], hit: bool) -> None:
    box = np.array([[0.0, 0.0, 0.0, 5.0, 2.0]])
    assert boxes_overlap(box, np.array([other])).tolist() == [hit]
    assert boxes_overlap(np.array([other]), box).tolist() == [hit]


def test_boxes_overlap_agrees_with_clipped_polygons() -> None:
    rng = np.random.default_rng(3)
    n = 3000
    a, b = (
        np.column_stack(
            [rng.uniform(-4, 4, (n, 2)), rng.uniform(-np.pi, np.pi, n), rng.uniform(0.5, 6, n), rng.uniform(0.3, 3, n)]
        )
        for _ in range(2)
    )
    found = boxes_overlap(a, b)
    assert 0.2 < found.mean() < 0.8
    for p, q, hit in zip(a, b, found, strict=True):
        kind, _ = cv2.rotatedRectangleIntersection(_as_cv2(p), _as_cv2(q))
        grown, shrunk = (boxes_overlap(p[None], (q + by)[None])[0] for by in (_MARGIN, -_MARGIN))
        if grown == shrunk:  # all but what single precision cannot tell
            assert hit == (kind != cv2.INTERSECT_NONE), (p, q)


_MARGIN = np.array([0.0, 0.0, 0.0, 1e-3, 1e-3])


def _as_cv2(box: np.ndarray) -> tuple[tuple[float, float], tuple[float, float], float]:
    x, y, heading, length, width = box.tolist()
    return (x, y), (length, width), float(np.degrees(heading))


@pytest.mark.parametrize("shape", [(), (0,), (7,), (3, 0), (40, 25)])
def test_cosines_and_sines_are_those_of_numpy(shape: tuple[int, ...]) -> None:
    angles = np.random.default_rng(2).uniform(-20.0, 20.0, shape)
    c, s = cos_sin(angles)
    assert c.shape == s.shape == shape
    assert np.allclose(c, np.cos(angles), rtol=0.0, atol=1e-15)
    assert np.allclose(s, np.sin(angles), rtol=0.0, atol=1e-15)
    # Also where they do not lie side by side in memory.
    assert np.array_equal(
        cos_sin(angles.T[..., ::-1] if angles.ndim else angles)[0], c.T[..., ::-1] if angles.ndim else c
    )


def test_angles_in_range_stay_as_they_are() -> None:
    angles = np.random.default_rng(3).uniform(-np.pi, np.pi, 1000)
    assert np.array_equal(wrap_angle(angles), angles)
