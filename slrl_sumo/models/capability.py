"""What curves the models of a bundle can take, and paths and speeds that ask no more of them."""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.scene.advance import halting
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.route import HERE, SPACING, RouteAhead
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import DECISION_INTERVAL, RoadUserType

SPEEDS = np.arange(1.0, 30.5, 0.5)
"""m/s at which it is looked what the models can do."""
STOPPING = np.arange(0.0, 40.5, 0.25)
"""m/s from which it is looked how far they need to a stand."""
PATIENCE = 60
"""Decisions within which they are to come to a stand."""
COMPANY = (0, 1, 3)
"""Others within 20 m that are imagined then: models turn differently in company."""
SPARE = 0.95
"""Share of the sharpest curve that is asked for: something must be left to come back to the path with."""
COMFORT = 3.0
"""m/s² across that nobody asks for more of."""
STRAIGHT = 1e-3
"""1/m: below, it is no curve."""
NIMBLE = 0.95
"""Share of the sharpest curve that counts as turning best."""
SLOWEST = 1.2
"""m/s below which nobody slows for a curve, however sharp."""
BRAKING = np.array([1.8, 1.0, 0.5])
"""m/s² with which curves are approached, per type."""
REACTION = 2 * DECISION_INTERVAL
"""s before braking shows."""
PASSES = 60
"""Times at most that a path is smoothed."""
BESIDE = 3
"""As many points to either side of a sharp one are smoothed as well."""
CHORD = 3
"""Points from one end to the other of the chords by which curves are measured: lanes are drawn with corners."""


@dataclass(frozen=True, eq=False)
class Capability:
    """What the modes of a bundle can do, per type."""

    sharpest: Floats
    """1/m: the sharpest curves that can be taken at each of SPEEDS, to the right and to the left, (3, 2, speeds);
    falling with speed."""
    stopping: Floats
    """m to a stand from each of STOPPING, (3, speeds), braking as hard as the modes can."""


def capability_of(bundle: ModelBundle) -> Capability:
    """What all modes of a bundle together can do at each speed, in usual company."""
    sharpest = np.zeros((len(COMPANY), len(RoadUserType), 2, len(SPEEDS)))
    stopping = np.zeros((len(RoadUserType), len(STOPPING)))
    for kind in RoadUserType:
        for company, others in enumerate(COMPANY):
            acceleration, yaw_rate = _motions(bundle, kind, SPEEDS, np.zeros(len(SPEEDS)), others)
            after = np.maximum(SPEEDS[:, None] + acceleration * DECISION_INTERVAL, 0.5)
            # Modes that mean to brake hard are no way through a curve.
            curve = np.where(acceleration > -1.5, yaw_rate / after, 0.0)
            sharpest[company, kind] = -curve.min(axis=1), curve.max(axis=1)
        stopping[kind] = _stopping(bundle, kind)
    # Who can take a curve at some speed can do so at any lower one: it speeds up first.
    usual = np.median(sharpest, axis=0)
    falling = np.maximum.accumulate(usual[..., ::-1], axis=-1)[..., ::-1]
    return Capability(np.ascontiguousarray(falling), stopping)


def _stopping(bundle: ModelBundle, kind: RoadUserType) -> Floats:
    """m from each of STOPPING to a stand, or as far as it comes within PATIENCE decisions, in usual company."""
    speed, past = STOPPING.copy(), np.zeros(len(STOPPING))
    distance = np.zeros(len(STOPPING))
    for _ in range(PATIENCE):
        hardest = np.median([_motions(bundle, kind, speed, past, others)[0].min(axis=1) for others in COMPANY], axis=0)
        hardest = halting(speed, hardest, DECISION_INTERVAL)
        after = np.maximum(speed + hardest * DECISION_INTERVAL, 0.0)
        past, speed = (after - speed) / DECISION_INTERVAL, after
        distance += speed * DECISION_INTERVAL
        if not speed.any():
            break
    # Rising, so that it can be read the other way round.
    return np.maximum.accumulate(distance) + 1e-3 * STOPPING


def _motions(
    bundle: ModelBundle, kind: RoadUserType, speed: Floats, acceleration: Floats, others: int
) -> tuple[Floats, Floats]:
    """Accelerations (m/s²) and yaw rates (rad/s) of all modes, (speeds, modes), for road users of one type."""
    vector = torch.zeros(len(speed), len(FEATURES))
    vector[:, 0], vector[:, 1] = torch.from_numpy(speed), torch.from_numpy(acceleration)
    vector[:, FEATURES.index(kind.name.lower())] = 1.0
    vector[:, [FEATURES.index("vru_20"), FEATURES.index("other_20")]] = others
    with torch.inference_mode():
        motions = bundle.displacement.motion_all(vector, torch.full((len(speed),), int(kind)))
    return motions[0].double().numpy(), motions[1].double().numpy()


def fitted(route: RouteAhead, users: WorldState, able: Capability) -> RouteAhead:
    """`route` of the first road users of `users`, with paths as round and speeds in curves as low as they need.

    Pedestrians' paths stay as they are.
    """
    drives = route.known & (users.type[: len(route)] != RoadUserType.PEDESTRIAN)
    if not drives.any():
        return route
    x, y, desired = route.x.copy(), route.y.copy(), route.desired.copy()
    sharpest = np.ascontiguousarray(able.sharpest)
    # What other modules say must not be a constant of the compiled function.
    _fit(x, y, desired, np.flatnonzero(drives), users.type, users.speed, sharpest, HERE, SPACING, REACTION)
    return replace(route, x=x, y=y, desired=desired)


@compiled
def _fit(
    x: Floats,
    y: Floats,
    desired: Floats,
    rows: NDArray[np.intp],
    kinds: NDArray[np.int8],
    speed: Floats,
    sharpest: Floats,
    here: int,
    spacing: float,
    reaction: float,
) -> None:
    """Round the paths `rows` of x and y, (n, points), and lower `desired`, (n,), to what their curves allow."""
    points = x.shape[1]
    bends, sharp = np.empty((3, points)), np.empty(points, np.bool_)
    for row in rows:
        kind = kinds[row]
        right, left = sharpest[kind, 0], sharpest[kind, 1]
        _round(x[row], y[row], SPARE * right[0], SPARE * left[0], bends, sharp)
        slowest = math.inf
        for k in range(here, points):
            allowed, straight = SPEEDS[-1], True
            if k < points - CHORD:
                # Most are straight: an angle is smaller than its tangent, and that is known without libm.
                straight = bends[0, k] > 0.0 and abs(bends[1, k]) < 0.99 * STRAIGHT * bends[2, k] * bends[0, k]
            if not straight:
                signed = math.atan2(bends[1, k], bends[0, k]) / bends[2, k]
                if abs(signed) >= STRAIGHT:
                    allowed = min(
                        _fastest(abs(signed), right if signed < 0.0 else left), math.sqrt(COMFORT / abs(signed))
                    )
            distance = max((k - here) * spacing - reaction * speed[row], 0.0)
            slowest = min(slowest, max(allowed, SLOWEST) ** 2 + 2.0 * BRAKING[kind] * distance)
        desired[row] = min(desired[row], math.sqrt(slowest))


@compiled
def _round(x: Floats, y: Floats, right: float, left: float, bends: Floats, sharp: NDArray[np.bool_]) -> None:
    """Draw one path like an elastic band where it is sharper than `right` and `left` (1/m), until it is not.

    `bends` (3, points) are those of `_bend` at last; `sharp` (points,) is room to work in.
    """
    points = len(x)
    # Only about what has moved anything changes.
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
            sharp[k - BESIDE : k + BESIDE + 1] = True
            first, last = min(first, k - BESIDE), k + BESIDE
        # The ends stay where they are.
        before_x, before_y = x[max(first, 1) - 1], y[max(first, 1) - 1]
        if first == points:
            return
        for k in range(max(first, 1), min(last, points - 2) + 1):
            here_x, here_y = x[k], y[k]
            if sharp[k]:
                x[k] += 0.25 * ((x[k + 1] - here_x) - (here_x - before_x))
                y[k] += 0.25 * ((y[k + 1] - here_y) - (here_y - before_y))
            before_x, before_y = here_x, here_y
        begin, end = max(first - CHORD, CHORD), min(last + 1, points - 2 * CHORD) + CHORD
    _bend(x, y, bends, begin, end)


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
def _fastest(curve: float, sharpest: Floats) -> float:
    """The highest speed (m/s) at which a curve (1/m) is still possible; `sharpest` falls with speed, as in Capability.

    Where no speed will do, the highest one of those at which they turn best: slower ones do not help.
    """
    curve = min(curve, NIMBLE * SPARE * sharpest[0])
    low, high = 0, len(sharpest)
    while high - low > 1:
        middle = (low + high) // 2
        if SPARE * sharpest[middle] >= curve:
            low = middle
        else:
            high = middle
    return float(SPEEDS[low])
