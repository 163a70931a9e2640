"""Compiled functions for single road users give what their counterparts on arrays give."""

import math

import numpy as np
import pytest

from slrl_sumo.scene.geometry import Box, boxes_overlap, wrap_angle
from slrl_sumo.scene.kernels import moved, overlap, wrapped


def test_wrapped_angles_are_those_of_arrays() -> None:
    angles = np.concatenate([np.random.default_rng(0).uniform(-20.0, 20.0, 500), np.arange(-6, 7) * np.pi])
    assert [wrapped(angle) for angle in angles.tolist()] == wrap_angle(angles).tolist()


def test_overlaps_are_those_of_arrays() -> None:
    rng = np.random.default_rng(1)
    a, b = (np.column_stack([rng.uniform(-3, 3, (500, 3)), rng.uniform(0.2, 6, (500, 2))]) for _ in range(2))
    found = []
    for p, q in zip(a.tolist(), b.tolist(), strict=True):
        mine, theirs = (Box(math.cos(row[2]), math.sin(row[2]), row[3], row[4]) for row in (p, q))
        found.append(overlap(q[0] - p[0], q[1] - p[1], mine, theirs))
    assert found == boxes_overlap(a, b).tolist()
    assert 100 < sum(found) < 400


def test_motion_is_along_the_mean_heading() -> None:
    assert moved(1.0, 2.0, 0.0, 3.0, 0.0) == (4.0, 2.0, 0.0)
    x, y, heading = moved(0.0, 0.0, 0.5 * math.pi, 2.0, math.pi)
    assert (x, y, heading) == pytest.approx((-2.0, 0.0, 1.5 * math.pi))
