"""Constraint `path_smoothing`: paths as round, and speeds in curves as low, as the models of a bundle need."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.models.capability import SPEEDS, Capability
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import HERE, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

SPARE = 0.95
"""Share of the largest curvature that a path may ask for: the rest is for the way back to the path."""
COMFORT = 4.0
"""m/s²: largest lateral acceleration in a curve."""
STRAIGHT = 1e-3
"""1/m: a smaller curvature counts as straight."""
BEST_TURNING = 0.95
"""Share of the largest curvature from which a speed counts as one at which the models turn best."""
SLOWEST = 1.2
"""m/s below which no road user slows for a curve, however sharp."""
BRAKING = np.array([1.8, 1.0, 0.5])
"""m/s² with which curves are approached, per type."""
REACTION = 2 * DECISION_INTERVAL
"""s before braking takes effect."""
PASSES = 60
"""Largest number of smoothing passes over a path."""
NEIGHBOURS = 3
"""Points to either side of a sharp one that are smoothed as well."""
CHORD = 3
"""Points from one end to the other of the chords that measure curvature: lanes are drawn with corners."""

CORNER, ROUNDED = 0.15, 0.3
"""rad up to which a turn from chord to chord is a corner of the drawing, and m that vehicles cut it by: less than half
of the room beside a car in its lane. Chords grow with the speed, as the spacing of points does: without that, a corner
of 4.4 degrees on a motorway allowed 26 m/s at 25 m/s, but 13 m/s in a queue at 8 m/s."""
FOLLOWED = 0.5
"""m that smoothing may move a path: less than the room beside a car in a lane of 3.2 m, else it drives over the kerb in
right turns, where persons walk and wait. With 1.6 m, in a small junction with signals 15 instead of 41 of 52 cars got
through in 400 s; with 0.8 m, cars in a grid with crossings had 121 contacts with persons in two runs, with 0.5 m 40.
The corners of the shipped scenarios would be moved by up to 2.5 m, a bend of 130 degrees drawn without a radius by
7 m."""
OFF_LANE = 1.6
"""m from a drawn turn at which road users leave their lane altogether."""
TIGHT = 1.0
"""1/m: largest curvature of such turns, which networks draw sharper than vehicles are: SUMO's turnarounds lead into the
next lane, 3.2 m away."""
NEAR = 3
"""Points behind and ahead of a road user between which its steering needs the curvature of a tight turn."""


def smooth_paths(route: RouteAhead, users: WorldState, capability: Capability) -> tuple[RouteAhead, NDArray[np.bool_]]:
    """`route` of the first road users of `users` with smoothed paths and lower desired speeds before curves, and for
    which of them it changed, (n,). Paths of pedestrians stay as they are."""
    changed = np.zeros(len(route), np.bool_)
    driving = route.known & (users.type[: len(route)] != RoadUserType.PEDESTRIAN)
    if not driving.any():
        return route, changed
    x, y, desired, tight = route.x.copy(), route.y.copy(), route.desired_speed.copy(), np.zeros(len(route))
    largest = np.ascontiguousarray(capability.sharpest)
    rows, drawn = np.flatnonzero(driving), (route.x, route.y)
    _smooth(x, y, drawn, route.spacing, desired, tight, rows, users.type, users.speed, largest, changed)
    return replace(route, x=x, y=y, desired_speed=desired, tight_curvature=tight), changed


def too_sharp(route: RouteAhead, smoothed: RouteAhead) -> NDArray[np.bool_]:
    """Whose path ahead has a turn that the models cannot follow, (n,): it is farther than OFF_LANE from that of
    `smoothed`, the result of `smooth_paths`."""
    moved = np.hypot(route.x - smoothed.x, route.y - smoothed.y)[:, HERE:]
    return np.asarray(route.known & (moved.max(axis=1, initial=0.0) > OFF_LANE))


def path_moved(points: Floats, capability: Capability, kind: RoadUserType) -> float:
    """How far (m) smoothing would move a path, points (k, 2) in m, 1 m from each other, for a type of road user that
    turned no sharper than its models."""
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
    """Smooth the paths `rows` of x and y, (n, points), as they were `drawn`, lower `desired`, (n,), to what their
    curves allow, write the curvature of tight turns beside the road user to `tight`, (n,), and mark what `changed`,
    (n,)."""
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
                # Most are straight: an angle is smaller than its tangent, and that is known without libm.
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
    """Smooth one path where its curvature exceeds `right` and `left` (1/m), until it does not; whether it changed.

    `bends` (3, points) are those of `_bend` at last; `sharp` (points,) is room to work in.
    """
    points, moved = len(x), False
    # Curvature changes only near points that have moved.
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
            # Round the points beside sharp ones as well: the turn spreads to both sides.
            sharp[k - NEIGHBOURS : k + NEIGHBOURS + 1] = True
            first, last = min(first, k - NEIGHBOURS), k + NEIGHBOURS
        # The ends stay where they are.
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
    """Where chords of one path meet, at points from `begin` to before `end`: cosine and sine of the turn to the left,
    times both lengths, and the mean length (m), to rows 0 to 2 of `bends` (3, points)."""
    for k in range(begin, end):
        from_x, from_y = x[k] - x[k - CHORD], y[k] - y[k - CHORD]
        to_x, to_y = x[k + CHORD] - x[k], y[k + CHORD] - y[k]
        bends[0, k] = to_x * from_x + to_y * from_y
        bends[1, k] = to_y * from_x - to_x * from_y
        lengths = math.sqrt(to_x * to_x + to_y * to_y) + math.sqrt(from_x * from_x + from_y * from_y)
        bends[2, k] = max(0.5 * lengths, 0.1)


@compiled
def _rounded(x: Floats, y: Floats, k: int, turn: float, curve: float, spacing: float) -> float:
    """The curvature (1/m) that is driven at a point of a path with the curvature `curve` and the `turn` (rad) from
    chord to chord: a corner is rounded over the length over which that moves the path by ROUNDED."""
    if abs(turn) > CORNER:
        return curve
    chord = min(int(8.0 * ROUNDED / max(abs(turn) * spacing, 1e-6)), k, len(x) - 1 - k)
    if chord <= CHORD:
        return curve
    from_x, from_y, to_x, to_y = x[k] - x[k - chord], y[k] - y[k - chord], x[k + chord] - x[k], y[k + chord] - y[k]
    lengths = math.sqrt(to_x * to_x + to_y * to_y) + math.sqrt(from_x * from_x + from_y * from_y)
    longer = math.atan2(to_y * from_x - to_x * from_y, to_x * from_x + to_y * from_y) / max(0.5 * lengths, 0.1)
    return longer if abs(longer) < abs(curve) else curve


@compiled
def _fastest(curve: float, sharpest: Floats) -> float:
    """The highest speed (m/s) at which a curve (1/m) is still possible; `sharpest` falls with speed, as in Capability.

    Where no speed will do, the highest one of those at which they turn best: slower ones do not help.
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
