"""Behaviour of vehicles in SUMO's hands shortly after they were handed back: hard braking, jumps, teleports."""

from collections import Counter
from typing import Any

import numpy as np

from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import RoadUserType

HARD_BRAKING = 5.0
"""m/s² within one SUMO step."""
AFTER = 5.0
"""s after the hand-back that are counted apart."""
SLACK = np.array([3.5, 3.5, 1.0])
"""m by RoadUserType that a road user may move beyond its speed in one step: SUMO's vehicles change lanes in one."""


class HandBack:
    """Follows the road users in SUMO's hands; call `update` after every SUMO step."""

    def __init__(self, api: Any, step_length: float) -> None:
        self._api, self._step = api, step_length
        self._count: Counter[str] = Counter()
        self._last: dict[str, tuple[float, float, float, bool]] = {}
        """x, y (m), speed (m/s) and whether learned, of all road users after the last step."""
        self._returned: dict[str, float] = {}
        """Time of the last hand-back, s."""

    def update(self, world: WorldState, learned: frozenset[str], now: float) -> None:
        """`world`: all road users after the step; `learned`: road users learned during the step; `now`: time, s."""
        count, before, self._last = self._count, self._last, {}
        count["teleports"] += len(self._api.simulation.getStartingTeleportIDList())
        columns = (world.x, world.y, world.speed, world.type)
        for road_user, x, y, speed, kind in zip(world.ids, *(c.tolist() for c in columns), strict=True):
            self._last[road_user] = x, y, speed, road_user in learned
            if road_user not in before or road_user in learned:
                continue
            last_x, last_y, last_speed, was_learned = before[road_user]
            if was_learned:
                self._returned[road_user] = now
                reach = max(speed, last_speed) * self._step + SLACK[kind]
                count["jumps"] += bool(np.hypot(x - last_x, y - last_y) > reach)
            if kind == RoadUserType.PEDESTRIAN:
                continue
            when = "after" if now - self._returned.get(road_user, -np.inf) <= AFTER else "otherwise"
            count[f"steps_{when}"] += 1
            count[f"brakes_{when}"] += (last_speed - speed) / self._step > HARD_BRAKING

    def record(self) -> dict[str, float | None]:
        """Hard braking of vehicles per 1,000 s within AFTER s of the hand-back and otherwise; counts of the rest."""
        return {
            **{
                f"hard_braking_{when}_per_1000_s": round(1e3 * self._count[f"brakes_{when}"] / seconds, 3)
                if (seconds := self._count[f"steps_{when}"] * self._step)
                else None
                for when in ("after", "otherwise")
            },
            "jumps": self._count["jumps"],
            "teleports": self._count["teleports"],
        }
