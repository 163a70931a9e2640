"""Angles, poses and boxes, on arrays."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def wrap_angle(angle: ArrayLike) -> Floats:
    """Angles in rad brought into (-pi, pi]."""
    a = np.asarray(angle, np.float64)
    return np.pi - np.mod(np.pi - a, 2 * np.pi)


def heading_from_sumo(degrees: ArrayLike) -> Floats:
    """SUMO's angles (degrees clockwise from north) as headings (rad counter-clockwise from +x, wrapped)."""
    return wrap_angle(np.radians(90.0 - np.asarray(degrees, np.float64)))


def heading_to_sumo(heading: ArrayLike) -> Floats:
    """Headings (rad counter-clockwise from +x) as SUMO's angles (degrees clockwise from north, in [0, 360))."""
    return np.mod(90.0 - np.degrees(np.asarray(heading, np.float64)), 360.0)


def centre_from_front(x: ArrayLike, y: ArrayLike, heading: ArrayLike, length: ArrayLike) -> tuple[Floats, Floats]:
    """Centres of boxes from the middles of their front edges (SUMO's position of a vehicle); m and rad."""
    half = 0.5 * np.asarray(length, np.float64)
    return np.asarray(x) - half * np.cos(heading), np.asarray(y) - half * np.sin(heading)


def front_from_centre(x: ArrayLike, y: ArrayLike, heading: ArrayLike, length: ArrayLike) -> tuple[Floats, Floats]:
    """Middles of the front edges of boxes from their centres; the inverse of `centre_from_front`."""
    half = 0.5 * np.asarray(length, np.float64)
    return np.asarray(x) + half * np.cos(heading), np.asarray(y) + half * np.sin(heading)


def to_ego(dx: ArrayLike, dy: ArrayLike, heading: ArrayLike) -> tuple[Floats, Floats]:
    """World offsets (m) seen in the ego frame: +x along `heading` (rad), +y to its left."""
    c, s = np.cos(heading), np.sin(heading)
    dx, dy = np.asarray(dx, np.float64), np.asarray(dy, np.float64)
    return c * dx + s * dy, c * dy - s * dx


def from_ego(ex: ArrayLike, ey: ArrayLike, heading: ArrayLike) -> tuple[Floats, Floats]:
    """Ego-frame offsets (m) as world offsets; the inverse of `to_ego`."""
    c, s = np.cos(heading), np.sin(heading)
    ex, ey = np.asarray(ex, np.float64), np.asarray(ey, np.float64)
    return c * ex - s * ey, s * ex + c * ey


def boxes_overlap(a: Floats, b: Floats) -> NDArray[np.bool_]:
    """Whether boxes intersect, pair by pair (separating axes; touching counts as overlap).

    `a`, `b`: (n, 5) rows of centre x, centre y (m), heading (rad), length, width (m). Returns (n,).
    """
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    turn = b[:, 2] - a[:, 2]
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    hit = np.ones(len(a), np.bool_)
    for p, q in ((a, b), (b, a)):
        u, v = to_ego(dx, dy, p[:, 2])
        hit &= np.abs(u) <= 0.5 * (p[:, 3] + q[:, 3] * c + q[:, 4] * s)
        hit &= np.abs(v) <= 0.5 * (p[:, 4] + q[:, 3] * s + q[:, 4] * c)
    return hit
