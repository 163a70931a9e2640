"""What curves the models of a bundle can take, and paths and speeds that ask no more of them."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.perception.features import FEATURES
from slrl_sumo.world.advance import halting
from slrl_sumo.world.geometry import Floats
from slrl_sumo.world.route import CHORD, HERE, SPACING, Complexes, RouteAhead, bend
from slrl_sumo.world.state import WorldState
from slrl_sumo.world.types import DECISION_INTERVAL, RoadUserType

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
WIDE = np.ones(7)
"""As many points round a sharp one are smoothed."""
SELDOM = 4
"""Passes after which it is looked who is round enough."""


@dataclass(frozen=True, eq=False)
class Agility:
    """What the modes of a bundle can do, per type."""

    sharpest: Floats
    """1/m: the sharpest curves that can be taken at each of SPEEDS, to the right and to the left, (3, 2, speeds);
    falling with speed."""
    stopping: Floats
    """m to a stand from each of STOPPING, (3, speeds), braking as hard as the modes can."""

    def speed_within(self, distance: Floats, kind: NDArray[np.int8]) -> Floats:
        """m/s from which the types `kind` (n,) come to a stand within `distance` (n, m) in m: (n, m)."""
        result = np.empty(distance.shape)
        for one in RoadUserType:
            rows = kind == one
            result[rows] = np.interp(distance[rows], self.stopping[one], STOPPING)
        return result

    def stop_from(self, speed: Floats, kind: NDArray[np.int8]) -> Floats:
        """m to a stand from speeds (n, m) in m/s, for the types `kind` (n,): (n, m)."""
        result = np.empty(speed.shape)
        for one in RoadUserType:
            rows = kind == one
            result[rows] = np.interp(speed[rows], STOPPING, self.stopping[one])
        return result


def agility(bundle: ModelBundle) -> Agility:
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
    return Agility(np.maximum.accumulate(usual[..., ::-1], axis=-1)[..., ::-1], stopping)


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


def fitted(route: RouteAhead, users: WorldState, able: Agility) -> RouteAhead:
    """`route` of the first road users of `users`, with paths as round and speeds in curves as low as they need.

    Pedestrians' paths stay as they are.
    """
    n = len(route)
    rows = np.flatnonzero(route.known & (users.type[:n] != RoadUserType.PEDESTRIAN))
    if not len(rows):
        return route
    kind, speed = users.type[rows], users.speed[rows]
    limit = SPARE * able.sharpest[kind, :, 0]
    path = _rounded(route.x[rows] + 1j * route.y[rows], limit)
    signed = bend(path)[:, HERE:]
    # The highest speed at which each curve is still possible.
    allowed = np.empty(signed.shape)
    for one in np.unique(kind):
        for side, sign in enumerate((-1.0, 1.0)):
            here = (kind == one)[:, None] & ((signed < 0.0) == (sign < 0.0))
            possible = SPARE * able.sharpest[one, side]
            fastest = np.searchsorted(-possible, -sign * signed[here], side="right") - 1
            # Where no speed will do, the highest one of those at which they turn best: slower ones do not help.
            nimble = np.searchsorted(-possible, -NIMBLE * possible[0], side="right") - 1
            allowed[here] = SPEEDS[np.maximum(fastest, nimble)]
    allowed[np.abs(signed) < STRAIGHT] = SPEEDS[-1]
    allowed = np.maximum(np.minimum(allowed, np.sqrt(COMFORT / np.maximum(np.abs(signed), 1e-6))), SLOWEST)
    distance = np.arange(signed.shape[1]) * SPACING - REACTION * speed[:, None]
    slowing = np.sqrt(allowed**2 + 2.0 * BRAKING[kind, None] * np.maximum(distance, 0.0)).min(axis=1)
    x, y, desired = route.x.copy(), route.y.copy(), route.desired.copy()
    x[rows], y[rows], desired[rows] = path.real, path.imag, np.minimum(desired[rows], slowing)
    return replace(route, x=x, y=y, desired=desired)


def _rounded(path: Complexes, limit: Floats) -> Complexes:
    """Paths drawn like an elastic band where they are sharper than `limit`, until they are not.

    `path`: x + iy in m, (n, points); `limit`: 1/m, to the right and to the left, (n, 2).
    """
    path, inner = path.copy(), slice(CHORD, -CHORD)
    # Paths are laid end to end: what is computed across their ends is sharper than nothing there, and moves nothing.
    low, high, share = np.full(path.shape, -np.inf), np.full(path.shape, np.inf), np.zeros(path.shape)
    low[:, inner], high[:, inner], share[:, 1:-1] = -limit[:, :1], limit[:, 1:], 0.25
    rows, some = np.arange(len(path)), path.copy()
    for count in range(PASSES):
        curve = bend(some.ravel())
        sharp = (curve > high.ravel()) | (curve < low.ravel())
        # Round the points beside sharp ones as well: the turn spreads to both sides.
        sharp = np.convolve(sharp, WIDE, "same") > 0.0
        if count % SELDOM == 0:
            still = sharp.reshape(some.shape).any(axis=1)
            path[rows], rows = some, rows[still]
            if not len(rows):
                return path
            some, low, high, share = some[still], low[still], high[still], share[still]
            sharp = sharp.reshape(-1, path.shape[1])[still].ravel()
        line = some.reshape(-1)
        step = line[1:] - line[:-1]
        line[1:-1] += (sharp * share.ravel())[1:-1] * (step[1:] - step[:-1])
    path[rows] = some
    return path
