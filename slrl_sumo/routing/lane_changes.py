"""Lane changes with cooperation: gaps in the next lane, and speeds that make room for a change.

The one that wants to change fits its speed to the vehicle in the next lane behind which it will go, and the vehicle
behind that gap lets it in. A vehicle that is not wholly behind goes first, so that two never wait for each other.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.kernels import apart
from slrl_sumo.scene.levels import FLAT, Levels
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

BESIDE, BEYOND = 0.6, 1.2
"""m from its own middle, and beyond the middle of the next lane, between which vehicles are in that lane."""
MARGIN, HURRIED_MARGIN = 2.5, 1.0
"""m that a gap needs before and behind; where the lane ends soon."""
CLOSING, HURRIED_CLOSING = 1.5, 0.6
"""s of the difference in speed that it needs as well, until the faster one brakes."""
BRAKES = 4.0
"""m/s² with which the faster one then takes on the speed of the other."""
HURRY = 50.0
"""m to the end of a lane from which a vehicle is hurried."""
SOON = 10.0, 100.0
"""s and m before the end of its lane from which others make room, whichever is longer."""
HEADWAY = 1.1
"""s to the vehicle ahead in the next lane that is aimed at, as behind a leader (lookahead.route_fit)."""
STANDING_GAP = 1.5
"""m, at a stand."""
RELAXATION = 3.0
"""s in which a missing distance is made up."""
EASY = 1.5
"""m/s²: no one brakes harder for a change."""
ACTS_IN = 0.8
"""s until the allowed speed is compared with that of a mode (lookahead.route_fit)."""
GAIN, PAUSE = 2.0, 6.0
"""m/s that vehicles want to gain by overtaking on the next lane, and s from one change to the next."""
KEEPS_RIGHT = 15.0
"""m/s of its desired speed from which a vehicle goes back towards the kerb, in left-hand traffic to the left; slower
ones, as on city streets, choose their lane freely."""
FORESEEN = 4.0
"""s for which a vehicle ahead is expected to speed up as it does: behind one that starts at a signal none overtakes."""
STEADY = 0.5
"""m/s²: a vehicle ahead that brakes harder has a reason farther on, which holds for the next lane, too."""
FAR = 30.0, 300.0
"""s and m before the end of its lane, whichever is longer, from which a vehicle seeks the lane that its route needs;
before that it overtakes on any lane."""
CHANGES_WITHIN = 4.0, 50.0
"""s, and at most m, before the end of its lane from which no vehicle begins to overtake."""
QUEUED, SHORTER = 2.0, 12.0
"""m/s below which a vehicle ahead is in a queue, and m by which the queue in the next lane ends later, two cars less;
the change needs that distance, too."""
SETTLES = 4.0
"""s for which a vehicle that has just been inserted stays on its lane: at a motorway junction (A10KW) nearly all
collisions at lane changes were with vehicles that SUMO then inserted on the other lane."""
FAR_SIGHT, HALF_LANE = 100.0, 1.7
"""m ahead that an overtaking vehicle considers, and m to either side of the middle of a lane."""
SIGHT = 60.0
"""m ahead and behind."""


class LaneChange(NamedTuple):
    """A lane change that is under way, or for which a vehicle waits for a gap."""

    row: int
    """In the world."""
    lateral_offset: float
    """m to the left of the middle of the next lane."""
    direction: float
    """rad: of the next lane; the vehicle itself may still be turning, as at the end of a ramp."""
    left: float
    """m to the end of its lane; 0 while it is changing."""


class _Around(NamedTuple):
    """All vehicles of a world as one of them sees them, (m,) each."""

    in_lane: NDArray[np.bool_]
    """Whether it is in the lane that the vehicle wants to change to."""
    ahead: Floats
    """m from its middle to theirs."""
    clear: Floats
    """m between the boxes along the lane; negative beside each other."""


def is_soon(left: float, speed: float) -> bool:
    """Whether the end of a lane, in `left` m, is so near for a vehicle at `speed` (m/s) that others make room."""
    return left <= max(SOON[0] * speed, SOON[1])


def is_far(left: float, speed: float) -> bool:
    """Whether the end of a lane, in `left` m, is so far at `speed` (m/s) that any lane serves the route."""
    return left > max(FAR[0] * speed, FAR[1])


def has_gap(world: WorldState, change: LaneChange, entering: Sequence[int] = (), levels: Levels = FLAT) -> bool:
    """Whether there is room in the next lane; `entering`: rows of vehicles that are changing to it as well."""
    around, speed = _around(world, change, levels), world.speed[change.row]
    around.in_lane[list(entering)] = True
    faster = np.maximum(np.where(around.ahead > 0, speed - world.speed, world.speed - speed), 0.0)
    hurried = change.left < HURRY
    margin, closing = (HURRIED_MARGIN, HURRIED_CLOSING) if hurried else (MARGIN, CLOSING)
    needed = margin + closing * faster + faster**2 / (2.0 * BRAKES)
    return bool(np.all(around.clear[around.in_lane] > needed[around.in_lane]))


def faster_there(
    world: WorldState, change: LaneChange, desired: float, levels: Levels = FLAT, *, back: bool = False
) -> bool:
    """Whether a vehicle that wants to go at `desired` (m/s) gets on better in the next lane: where it is held up and
    the next lane is faster; a fast one also `back` towards the kerb, where it is not held up there."""
    there = min(_foreseen(*_ahead(world, change, -change.lateral_offset, levels)), desired)
    if back and desired >= KEEPS_RIGHT:
        return there > desired - 0.5 * GAIN
    speed, acceleration = _ahead(world, change, 0.0, levels)
    here = desired if acceleration < -STEADY else min(_foreseen(speed, acceleration), desired)
    return there > here + GAIN


def shorter_queue(world: WorldState, change: LaneChange, left: float, levels: Levels = FLAT) -> bool:
    """Whether a vehicle comes to a queue before the end of its lane, in `left` m, and to none so soon in the next
    lane."""
    here, there = (_queue(world, change, aside, levels) for aside in (0.0, -change.lateral_offset))
    return here > SHORTER and min(there, left) > here + SHORTER


def _ahead(world: WorldState, change: LaneChange, aside: float, levels: Levels) -> tuple[float, float]:
    """m/s and m/s² of the next vehicle within FAR_SIGHT ahead on the line `aside` m to the left; inf and 0 where there
    is none."""
    rows, along = _in_lane_ahead(world, change, aside, levels)
    if not len(rows):
        return math.inf, 0.0
    row = rows[along.argmin()]
    return world.speed.item(row), world.acceleration.item(row)


def _foreseen(speed: float, acceleration: float) -> float:
    """m/s after FORESEEN, if a vehicle goes on speeding up."""
    return speed + FORESEEN * max(acceleration, 0.0)


def _queue(world: WorldState, change: LaneChange, aside: float, levels: Levels) -> float:
    """m to the next vehicle in a queue within FAR_SIGHT ahead on the line `aside` m to the left; inf: there is none."""
    rows, along = _in_lane_ahead(world, change, aside, levels)
    return float(np.min(along[world.speed[rows] < QUEUED], initial=math.inf))


def _in_lane_ahead(
    world: WorldState, change: LaneChange, aside: float, levels: Levels
) -> tuple[NDArray[np.intp], Floats]:
    """Rows of the road users within FAR_SIGHT ahead on the line `aside` m to the left, and m to them, (k,) each."""
    c, s = math.cos(change.direction), math.sin(change.direction)
    dx, dy = world.x - world.x[change.row], world.y - world.y[change.row]
    along, across = c * dx + s * dy, c * dy - s * dx
    rows = np.flatnonzero((along > 0.0) & (along < FAR_SIGHT) & (np.abs(across - aside) < HALF_LANE))
    rows = _on_the_level(levels, world, change, rows)
    return rows, along[rows]


def cooperative_speeds(world: WorldState, n: int, lane_changes: Sequence[LaneChange], levels: Levels = FLAT) -> Floats:
    """m/s that make room for the lane changes that are wished for, (n,), of the first `n` road users of `world`, which
    are those that may let others in; inf where nothing is to be done."""
    allowed = np.full(n, math.inf)
    rows = {change.row for change in lane_changes}
    for change in lane_changes:
        i, speed = change.row, world.speed.item(change.row)
        if not is_soon(change.left, speed):
            continue
        around = _around(world, change, levels)
        near = np.flatnonzero(around.in_lane & (np.abs(around.ahead) < SIGHT))
        behind = [j for j in near.tolist() if around.ahead[j] < 0.0 and around.clear[j] >= 0.0]
        # Of two that are beside each other and want each other's lane, the one in front goes first.
        before = [j for j in near.tolist() if not (around.ahead[j] < 0.0 and (around.clear[j] >= 0.0 or j in rows))]
        if before:
            j = min(before, key=lambda k: around.ahead[k])
            allowed[i] = min(allowed[i], _following(speed, world.speed.item(j), around.clear.item(j)))
        if behind:
            j = max(behind, key=lambda k: around.ahead[k])
            if j < n:
                allowed[j] = min(allowed[j], _following(world.speed.item(j), speed, around.clear.item(j)))
    return allowed


def _on_the_level(levels: Levels, world: WorldState, change: LaneChange, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Those of `rows` in the way of a vehicle that are not above or below it."""
    if not len(levels.x):
        return rows
    x, y, cos, sin = world.x[rows], world.y[rows], np.cos(world.heading[rows]), np.sin(world.heading[rows])
    c, s = math.cos(change.direction), math.sin(change.direction)
    theirs = zip(x.tolist(), y.tolist(), cos.tolist(), sin.tolist(), strict=True)
    return rows[np.array([not apart(levels, *place[:2], c, s, *place) for place in theirs], np.bool_)]


def _around(world: WorldState, change: LaneChange, levels: Levels) -> _Around:
    row, lateral_offset = change.row, change.lateral_offset
    c, s = math.cos(change.direction), math.sin(change.direction)
    dx, dy = world.x - world.x[row], world.y - world.y[row]
    along, across = c * dx + s * dy, c * dy - s * dx
    same_way = (np.cos(world.heading - change.direction) > 0.5) & (world.type != RoadUserType.PEDESTRIAN)
    # From just beside the vehicle to the far edge of the wanted lane.
    low, high = sorted(
        (-math.copysign(BESIDE, lateral_offset), -lateral_offset - math.copysign(BEYOND, lateral_offset))
    )
    in_lane = (across > low) & (across < high) & same_way & (np.arange(len(world)) != row)
    rows = np.flatnonzero(in_lane)
    in_lane[rows] = np.isin(rows, _on_the_level(levels, world, change, rows))
    return _Around(in_lane, along, np.abs(along) - 0.5 * (world.length + world.length[row]))


def _following(speed: float, leading: float, gap: float) -> float:
    """m/s for a vehicle at `speed` to come to its headway behind one at the speed `leading` across `gap` (m)."""
    wanted = leading + (gap - STANDING_GAP - HEADWAY * speed) / RELAXATION
    return max(wanted, speed - EASY * ACTS_IN, 0.0)
