"""Speeds at which a road user can be inserted at a place so that all road users can stop comfortably, as in SUMO."""

import math

import numpy as np

from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState

BRAKING, REACTION = 2.0, 1.0
"""Deceleration (m/s²) and reaction time (s) with which an inserted road user can stop behind its leader, and its
follower behind it, as in the model of Krauss (1998)."""

SIDE = 0.5
"""Lateral clearance (m) beside a road user's box that belongs to its way ahead."""

ROUNDING = 1e-6
"""Tolerance (m) for comparisons of squared distances."""


def boxes_of(*worlds: WorldState) -> Floats:
    """Columns x, y (m), heading (rad), speed (m/s), length and width (m) of all road users, (n, 6)."""
    return np.concatenate([np.column_stack([w.x, w.y, w.heading, w.speed, w.length, w.width]) for w in worlds])


def safe_speed(free: Floats) -> Floats:
    """Speed (m/s) from which a road user stops within `free` m, any shape."""
    lost = BRAKING * REACTION
    return np.sqrt(lost * lost + 2.0 * BRAKING * np.maximum(free, 0.0)) - lost


@compiled
def insertions(x: Floats, y: Floats, heading: Floats, crowd: Floats, own: int) -> tuple[Floats, Floats, Floats]:
    """Gap, least and greatest speed of road user `own` of a `crowd` (see boxes_of) at each of n places, (n,) each.

    The gap (m) is the distance of its circle to the nearest other circle. Between the two speeds (m/s), BRAKING
    suffices for its follower, and for itself behind its leader, along a straight line.
    """
    long, wide = crowd[own, 4], crowd[own, 5]
    radius, lost = 0.5 * math.hypot(long, wide), BRAKING * REACTION
    radii, top, longest = np.empty(len(crowd)), crowd[0, 3], crowd[0, 4]
    for one in range(len(crowd)):
        radii[one] = 0.5 * math.hypot(crowd[one, 4], crowd[one, 5])
        # A loop instead of crowd.max(), for which numba imports scipy's BLAS, a sixth of a start.
        top, longest = max(top, crowd[one, 3]), max(longest, crowd[one, 4])
    reach = top * REACTION + top * top / (2.0 * BRAKING) + 2.0 * longest
    gaps, slowest, fastest = np.full(len(x), reach), np.zeros(len(x)), np.full(len(x), np.inf)
    # Select the road users within reach of the box around all places, which lie close together.
    west, east, south, north = np.inf, -np.inf, np.inf, -np.inf
    for place in range(len(x)):
        west, east, south, north = min(west, x[place]), max(east, x[place]), min(south, y[place]), max(north, y[place])
    near, many = np.empty(len(crowd), np.intp), 0
    for one in range(len(crowd)):
        at_x, at_y = crowd[one, 0], crowd[one, 1]
        if one != own and west - reach <= at_x <= east + reach and south - reach <= at_y <= north + reach:
            near[many], many = one, many + 1
    for place in range(len(x)):
        c, s = math.cos(heading[place]), math.sin(heading[place])
        for one in near[:many]:
            dx, dy = crowd[one, 0] - x[place], crowd[one, 1] - y[place]
            # Any further computation for each of 400,000 pairs takes longer than a decision of 64 road users.
            square = dx * dx + dy * dy
            if square > reach * reach:
                continue
            if square < (gaps[place] + radii[one] + radius + ROUNDING) ** 2:
                gaps[place] = min(gaps[place], math.hypot(dx, dy) - radii[one] - radius)
            other_long, other_wide = crowd[one, 4], crowd[one, 5]
            if abs(dy * c - dx * s) - 0.5 * (wide + other_wide + other_long) > SIDE:
                continue  # however it is turned
            along, across = math.cos(crowd[one, 2] - heading[place]), math.sin(crowd[one, 2] - heading[place])
            aside = abs(dy * c - dx * s) - 0.5 * (wide + abs(along) * other_wide + abs(across) * other_long)
            if aside > SIDE:
                continue
            ahead = dx * c + dy * s
            free = max(abs(ahead) - 0.5 * (long + abs(along) * other_long + abs(across) * other_wide), 0.0)
            pace = max(crowd[one, 3] * along, 0.0)
            if ahead >= 0.0:
                safe = math.sqrt(lost * lost + pace * pace + 2.0 * BRAKING * free) - lost
                fastest[place] = min(fastest[place], max(safe, 0.0))
            else:
                behind = pace * pace + 2.0 * (lost * pace - BRAKING * free)
                slowest[place] = max(slowest[place], math.sqrt(max(behind, 0.0)))
    return gaps, slowest, fastest
