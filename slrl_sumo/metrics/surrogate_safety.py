"""Surrogate safety measures: time to collision, post-encroachment time, deceleration to avoid a crash.

Boxes are rows of centre x, centre y (m), heading (rad counter-clockwise from +x), length and width (m), as in
`slrl_sumo.scene.geometry.boxes_overlap`. The measures are those of the Surrogate Safety Assessment Model (SSAM; Gettman
et al., FHWA-HRT-08-051, 2008), computed from the boxes themselves instead of from lanes.
"""

import numpy as np

from slrl_sumo.scene.geometry import Floats, boxes_overlap, to_ego, wrap_angle

REAR_END = np.radians(30.0)
"""Angle (rad) between the headings below which SSAM calls conflicts rear-end conflicts."""


def time_to_collision(*, a: Floats, b: Floats, velocity_a: Floats, velocity_b: Floats) -> Floats:
    """Time until boxes touch if both keep their velocity and do not turn, pair by pair, s, (n,).

    `a`, `b`: boxes (n, 5); velocities: (n, 2) in m/s. 0 for boxes that overlap now, inf for boxes that never touch.

    Hayward (1972), Near-miss determination through use of a scale of danger, for boxes in the plane: it holds for any
    angle, not only for car-following. Boxes that do not turn overlap while their projections overlap on each of the
    four normals of their sides (separating axes), which is an interval of time for each normal: the result is exact. On
    curved lanes, constant velocity is pessimistic: oncoming vehicles in a bend are briefly on a collision course.
    """
    enter, leave = np.full(len(a), -np.inf), np.full(len(a), np.inf)
    for gap, slope, reach in _projections(a, b, velocity_b - velocity_a):
        with np.errstate(divide="ignore", invalid="ignore"):
            first, second = (-reach - gap) / slope, (reach - gap) / slope
        still = slope == 0.0
        always = still & (np.abs(gap) <= reach)
        never = still & ~always
        begin = np.where(still, -np.inf, np.minimum(first, second))
        end = np.where(still, np.inf, np.maximum(first, second))
        enter = np.maximum(enter, np.where(never, np.inf, begin))
        leave = np.minimum(leave, np.where(never, -np.inf, end))
    return np.where((enter <= leave) & (leave >= 0.0), np.maximum(enter, 0.0), np.inf)


def deceleration_to_avoid_crash(*, ttc: Floats, closing: Floats) -> Floats:
    """The constant deceleration of the closing motion that just avoids the crash (DRAC), m/s², (n,).

    `ttc`: s, inf for never. `closing`: relative speed |velocity_a - velocity_b| in m/s. The result is closing / (2
    ttc): until the contact, the road users cover closing x ttc relative to each other, and a stop within a distance d
    needs closing² / (2 d). For a follower, this is (v2 - v1)² / (2 gap) of Cooper and Ferguson (1976, Traffic studies
    at T-junctions). 0 for pairs that do not touch, inf for pairs that already overlap. More than 3.35 m/s² is often
    called a conflict (Archer 2005).
    """
    with np.errstate(divide="ignore"):
        needed = closing / (2.0 * np.where(ttc > 0.0, ttc, 1.0))
    return np.where(ttc > 0.0, np.where(np.isinf(ttc), 0.0, needed), np.inf)


def post_encroachment_time(*, a: Floats, b: Floats, times_a: Floats, times_b: Floats) -> tuple[float, float] | None:
    """Post-encroachment time (PET), s, and the time of the second arrival, s.

    The PET is the shortest time between the departure of one road user from a place and the arrival of the other one.
    `a` (n, 5) and `b` (m, 5): the boxes of the two road users at `times_a` (n,) and `times_b` (m,), s; close enough in
    time that a box does not jump over its own width. None if the ways have no place in common.

    Allen, Shin and Cooper (1978), Analysis of traffic conflicts and collisions. A place is left at t and reached at
    t + PET if and only if the box at t and the other box at t + PET overlap: the PET is the smallest time between
    overlapping boxes. 0 if both are there at the same time. From samples dt apart, it is up to 2 dt too long, never too
    short.
    """
    i, j = (index.ravel() for index in np.indices((len(a), len(b))))
    met = boxes_overlap(a[i], b[j])
    if not met.any():
        return None
    apart, arrival = np.abs(times_a[i] - times_b[j])[met], np.maximum(times_a[i], times_b[j])[met]
    best = int(np.lexsort((arrival, apart))[0])
    return float(apart[best]), float(arrival[best])


def crossing_angle(heading_a: Floats, heading_b: Floats) -> Floats:
    """Angle between two headings, rad, in [0, pi], (n,)."""
    return np.abs(wrap_angle(heading_a - heading_b))


def box_distance(*, a: Floats, b: Floats) -> Floats:
    """Distances between boxes (n, 5), pair by pair, m, (n,); negative for an overlap: the least movement that ends
    it."""
    depth = np.full(len(a), np.inf)
    for gap, _, reach in _projections(a, b, np.zeros((len(a), 2))):
        depth = np.minimum(depth, reach - np.abs(gap))
    # The nearest point of one of two separate boxes to the other box is a corner.
    nearest = np.full(len(a), np.inf)
    for p, q in ((a, b), (b, a)):
        for along in (-0.5, 0.5):
            for aside in (-0.5, 0.5):
                c, s = np.cos(q[:, 2]), np.sin(q[:, 2])
                x = q[:, 0] + along * q[:, 3] * c - aside * q[:, 4] * s
                y = q[:, 1] + along * q[:, 3] * s + aside * q[:, 4] * c
                u, v = to_ego(x - p[:, 0], y - p[:, 1], p[:, 2])
                out_u = np.maximum(np.abs(u) - 0.5 * p[:, 3], 0.0)
                out_v = np.maximum(np.abs(v) - 0.5 * p[:, 4], 0.0)
                nearest = np.minimum(nearest, np.hypot(out_u, out_v))
    return np.where(depth >= 0.0, -depth, nearest)


def _projections(a: Floats, b: Floats, velocity: Floats) -> list[tuple[Floats, Floats, Floats]]:
    """For each of the four normals of sides: centre of b relative to a (m), relative speed (m/s), sum of extents
    (m)."""
    dx, dy, turn = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1], b[:, 2] - a[:, 2]
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    found = []
    for p, q in ((a, b), (b, a)):
        u, v = to_ego(dx, dy, p[:, 2])
        speed_u, speed_v = to_ego(velocity[:, 0], velocity[:, 1], p[:, 2])
        found.append((u, speed_u, 0.5 * (p[:, 3] + q[:, 3] * c + q[:, 4] * s)))
        found.append((v, speed_v, 0.5 * (p[:, 4] + q[:, 3] * s + q[:, 4] * c)))
    return found
