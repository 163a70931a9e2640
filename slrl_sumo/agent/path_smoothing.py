"""Constraint `path_smoothing`: smooth paths, and low speeds in curves, that the models of a bundle can follow."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.models.capability import SPEEDS, Capability
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import HERE, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, PEDESTRIAN, RoadUserType

SPARE = 0.95
"""Share of the greatest curvature of the models that a path may have: the rest serves the return to the path."""
COMFORT = 4.0
"""Greatest lateral acceleration (m/s²) in a curve."""
STRAIGHT = 1e-3
"""Curvature (1/m) below which a path counts as straight."""
BEST_TURNING = 0.95
"""Share of the greatest curvature from which a speed counts as a speed at which the models turn best."""
SLOWEST = 1.2
"""Least speed (m/s) to which road users slow down for a curve, however sharp."""
BRAKING = np.array([1.8, 1.0, 0.5])
"""Deceleration (m/s²) before curves, by type."""
REACTION = 2 * DECISION_INTERVAL
"""Time (s) until braking takes effect."""
PASSES = 60
"""Greatest number of smoothing passes over a path."""
NEIGHBOURS = 3
"""Number of points on either side of a sharp point that are smoothed, too."""
CHORD = 3
"""Number of segments spanned by the chords that measure curvature: lanes are drawn with corners."""

ROUNDED = 0.5
"""Distance (m) by which vehicles cut corners: less than the room of 0.7 m beside a car in a lane of 3.2 m. Chords grow
with the speed, as the spacing of points does: without this rounding, a corner of 4.4 degrees on a motorway allowed 26
m/s at 25 m/s, but 13 m/s in a queue at 8 m/s. With 0.3 m, trips in parts of The Hague, Leeds and Eskişehir took 3, 9
and 9 % longer than SUMO's, with 0.5 m 1, 4 and 6 %."""
FOLLOWED = 0.5
"""Greatest distance (m) by which smoothing may move a path: less than the room beside a car in a lane of 3.2 m, else
the car drives over the kerb in right turns, where persons walk and wait. With 1.6 m, 15 instead of 41 of 52 cars passed
a small junction with signals in 400 s. With 0.8 m, cars in a grid with crossings had 121 contacts with persons in two
runs, with 0.5 m 40. Without the limit, the corners of the shipped scenarios would move by up to 2.5 m, a bend of 130
degrees drawn without a radius by 7 m."""
OFF_LANE = 1.6
"""Distance (m) from a drawn turn at which a road user leaves its lane completely."""
TIGHT = 1.0
"""Greatest curvature (1/m) of tight turns, which networks draw sharper than vehicles can turn: SUMO's U-turns lead into
the next lane, 3.2 m away."""
NEAR = 3
"""Number of points behind and ahead of a road user within which steering uses the curvature of a tight turn."""


def smooth_paths(route: RouteAhead, users: WorldState, capability: Capability) -> tuple[RouteAhead, NDArray[np.bool_]]:
    """`route` with smoothed paths and lower desired speeds before curves, and whether each row changed, (n,).

    The routes belong to the first road users of `users`. Paths of pedestrians do not change.
    """
    changed = np.zeros(len(route), np.bool_)
    driving = route.known & (users.type[: len(route)] != PEDESTRIAN)
    if not driving.any():
        return route, changed
    x, y, desired, tight = route.x.copy(), route.y.copy(), route.desired_speed.copy(), np.zeros(len(route))
    largest = np.ascontiguousarray(capability.sharpest)
    rows, drawn = np.flatnonzero(driving), (route.x, route.y)
    _smooth(x, y, drawn, route.spacing, desired, tight, rows, users.type, users.speed, largest, changed)
    return replace(route, x=x, y=y, desired_speed=desired, tight_curvature=tight), changed


def too_sharp(route: RouteAhead, smoothed: RouteAhead) -> NDArray[np.bool_]:
    """Whether the path ahead has a turn that the models cannot follow, (n,).

    There, the path is farther than OFF_LANE from the path of `smoothed`, the result of `smooth_paths`.
    """
    moved = np.hypot(route.x - smoothed.x, route.y - smoothed.y)[:, HERE:]
    return np.asarray(route.known & (moved.max(axis=1, initial=0.0) > OFF_LANE))


def path_moved(points: Floats, capability: Capability, kind: RoadUserType) -> float:
    """Distance (m) by which smoothing moves a path, for a type of road user that turns no sharper than its models.

    `points`: (k, 2) in m, 1 m from each other.
    """
    x, y = np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 1])
    right, left = SPARE * capability.sharpest[kind, :, 0]
    _round(x, y, right, left, np.empty((3, len(x))), np.empty(len(x), np.bool_))
    return float(np.hypot(x - points[:, 0], y - points[:, 1]).max(initial=0.0))


@compiled
def _smooth(
    x: Floats,
    y: Floats,
    drawn: tuple[Floats, Floats],
    spacing: Floats,
    desired: Floats,
    tight: Floats,
    rows: NDArray[np.intp],
    kinds: NDArray[np.int8],
    speed: Floats,
    sharpest: Floats,
    changed: NDArray[np.bool_],
) -> None:
    """Smooth the paths `rows` of `x` and `y`, (n, points), in place; `drawn`: the paths before.

    Also lower `desired`, (n,), to the speeds that the curves allow, write the curvature of tight turns near the road
    user to `tight`, (n,), and mark the rows in `changed`, (n,).
    """
    points = x.shape[1]
    bends, sharp = np.empty((3, points)), np.empty(points, np.bool_)
    for row in rows:
        kind = kinds[row]
        right, left = sharpest[kind, 0], sharpest[kind, 1]
        changed[row], turns = _round(x[row], y[row], SPARE * right[0], SPARE * left[0], bends, sharp), False
        for k in range(HERE, points if changed[row] else 0):
            turns |= math.hypot(x[row, k] - drawn[0][row, k], y[row, k] - drawn[1][row, k]) > FOLLOWED
        if turns:
            x[row], y[row] = drawn[0][row], drawn[1][row]
            changed[row] = _round(x[row], y[row], TIGHT, TIGHT, bends, sharp)
        slowest = math.inf
        for k in range(HERE, points):
            allowed, straight = SPEEDS[-1], True
            if k < points - CHORD:
                # Most points are straight: an angle is smaller than its tangent, which needs no libm.
                straight = bends[0, k] > 0.0 and abs(bends[1, k]) < 0.99 * STRAIGHT * bends[2, k] * bends[0, k]
            if not straight:
                turn = math.atan2(bends[1, k], bends[0, k])
                signed = _rounded(x[row], y[row], k, turn, turn / bends[2, k], spacing[row])
                if abs(signed) >= STRAIGHT:
                    allowed = min(
                        _fastest(abs(signed), right if signed < 0.0 else left), math.sqrt(COMFORT / abs(signed))
                    )
            distance = max((k - HERE) * spacing[row] - REACTION * speed[row], 0.0)
            slowest = min(slowest, max(allowed, SLOWEST) ** 2 + 2.0 * BRAKING[kind] * distance)
        for k in range(HERE - NEAR, HERE + NEAR + 1 if turns else 0):
            curve = abs(math.atan2(bends[1, k], bends[0, k])) / bends[2, k]
            if curve > min(right[0], left[0]):
                tight[row] = max(tight[row], curve)
        allowed = math.sqrt(slowest)
        changed[row] |= allowed < desired[row]
        desired[row] = min(desired[row], allowed)


@compiled
def _round(x: Floats, y: Floats, right: float, left: float, bends: Floats, sharp: NDArray[np.bool_]) -> bool:
    """Smooth a path in place until its curvature is within `right` and `left` (1/m); returns whether it changed.

    `bends` (3, points) receives the result of the last `_bend`. `sharp` (points,) is a buffer.
    """
    points, moved = len(x), False
    # The curvature changes only near moved points.
    begin, end = (
        min(CHORD, points),
        points - CHORD,
    )  # not just CHORD: it would be compiled for that number, then for any
    for _ in range(PASSES):
        _bend(x, y, bends, begin, end)
        sharp[:] = False
        first, last = points, 0
        for k in range(begin, end):
            most = bends[2, k] * bends[0, k]
            if bends[0, k] > 0.0 and -right * most <= bends[1, k] <= left * most:
                continue  # its tangent is small enough: so is the angle
            curve = math.atan2(bends[1, k], bends[0, k]) / bends[2, k]
            if -right <= curve <= left:
                continue
            # Also smooth the neighbours of sharp points: the turn spreads to both sides.
            sharp[k - NEIGHBOURS : k + NEIGHBOURS + 1] = True
            first, last = min(first, k - NEIGHBOURS), k + NEIGHBOURS
        # The ends do not move.
        before_x, before_y = x[max(first, 1) - 1], y[max(first, 1) - 1]
        if first == points:
            return moved
        moved = True
        for k in range(max(first, 1), min(last, points - 2) + 1):
            here_x, here_y = x[k], y[k]
            if sharp[k]:
                x[k] += 0.25 * ((x[k + 1] - here_x) - (here_x - before_x))
                y[k] += 0.25 * ((y[k + 1] - here_y) - (here_y - before_y))
            before_x, before_y = here_x, here_y
        begin, end = max(first - CHORD, CHORD), min(last + 1, points - 2 * CHORD) + CHORD
    _bend(x, y, bends, begin, end)
    return moved


@compiled
def _bend(x: Floats, y: Floats, bends: Floats, begin: int, end: int) -> None:
    """Write the turns between the two chords that meet at each point, from `begin` to before `end`, to `bends`.

    Rows of `bends` (3, points): cosine and sine of the turn to the left, times both chord lengths, and their mean (m).
    """
    for k in range(begin, end):
        from_x, from_y = x[k] - x[k - CHORD], y[k] - y[k - CHORD]
        to_x, to_y = x[k + CHORD] - x[k], y[k + CHORD] - y[k]
        bends[0, k] = to_x * from_x + to_y * from_y
        bends[1, k] = to_y * from_x - to_x * from_y
        lengths = math.sqrt(to_x * to_x + to_y * to_y) + math.sqrt(from_x * from_x + from_y * from_y)
        bends[2, k] = max(0.5 * lengths, 0.1)


@compiled
def _rounded(x: Floats, y: Floats, k: int, turn: float, curve: float, spacing: float) -> float:
    """The driven curvature (1/m) at a point with the curvature `curve` and the `turn` (rad) from chord to chord.

    Vehicles round corners over the length over which this moves the path by ROUNDED.
    """
    chord = min(int(8.0 * ROUNDED / max(abs(turn) * spacing, 1e-6)), k, len(x) - 1 - k)
    while chord > CHORD:
        from_x, from_y, to_x, to_y = x[k] - x[k - chord], y[k] - y[k - chord], x[k + chord] - x[k], y[k + chord] - y[k]
        lengths = math.sqrt(to_x * to_x + to_y * to_y) + math.sqrt(from_x * from_x + from_y * from_y)
        angle = math.atan2(to_y * from_x - to_x * from_y, to_x * from_x + to_y * from_y)
        # In a longer curve, more of it lies between the ends of longer chords.
        if abs(angle) * 0.5 * lengths <= 8.0 * ROUNDED:
            longer = angle / max(0.5 * lengths, 0.1)
            return longer if abs(longer) < abs(curve) else curve
        chord = 3 * chord // 4
    return curve


@compiled
def _fastest(curve: float, sharpest: Floats) -> float:
    """The highest speed (m/s) at which a curve (1/m) is possible; `sharpest` falls with speed, as in Capability.

    If no speed suffices, the highest of the speeds at which the models turn best: lower speeds do not help.
    """
    curve = min(curve, BEST_TURNING * SPARE * sharpest[0])
    low, high = 0, len(sharpest)
    while high - low > 1:
        middle = (low + high) // 2
        if SPARE * sharpest[middle] >= curve:
            low = middle
        else:
            high = middle
    return float(SPEEDS[low])
