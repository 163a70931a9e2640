"""A learned vehicle on its path."""

import math
from dataclasses import dataclass

from slrl_sumo.routing.lane_path import LanePath, junction_of
from slrl_sumo.scene.types import DECISION_INTERVAL, STANDING_SPEED
from slrl_sumo.sumo.road_users import VehicleParameters

ROLLING = 2.0
"""m/s above which a vehicle that has just passed a stop line does not stop any more."""
STOPS_OVER = 0.5
"""m by which a slower vehicle may be over a line and still count as waiting before it."""
HALTS_BEFORE = 4.0
"""m before a line at which the first vehicle of a queue stands."""


@dataclass(slots=True)
class VehicleHistory:
    """What a vehicle has done since it became a learned one; it outlasts the path."""

    begun: float = -math.inf
    """Time (s) at which it began to be learned."""
    observed: float = -math.inf
    """Time (s) of the last observation."""
    elapsed: float = 0.0
    """s between the last two observations, at most a decision interval; 0 where a moment was observed twice."""
    standing_time: float = 0.0
    """s."""
    idle_time: float = 0.0
    """s that it has stood although no signal is red."""
    changed: float = -math.inf
    """Time (s) at which it began its last lane change."""
    halted: str = ""
    """The internal lane after the last line before which it has stood."""
    entry: str = ""
    """The internal lane after the last line that it has passed in the junction in which it is; '' outside."""
    entered: float = math.inf
    """Time (s) at which it passed that line, or the first one if it did not halt before that one; inf outside."""

    def observe(self, now: float, speed: float) -> None:
        """Count the time at a stand, up to `now` (s); `speed`: m/s."""
        self.elapsed, self.observed = min(now - self.observed, DECISION_INTERVAL), now
        self.standing_time = self.standing_time + self.elapsed if speed < STANDING_SPEED else 0.0

    def observe_signal(self, *, red: bool) -> None:
        """Count the time at a stand for which no signal is the reason, as of the last `observe`."""
        self.idle_time = self.idle_time + self.elapsed if self.standing_time and not red else 0.0


@dataclass(slots=True)
class VehicleTrack:
    """One vehicle on its path."""

    path: LanePath
    s: float
    """m along the path, of the front."""
    lateral_offset: float
    """m to the left of the path."""
    speed: float
    """m/s at the last update."""
    x: float
    """Centre at the last update, m."""
    y: float
    edges: tuple[str, ...]
    """The route after the edge that the path begins on."""
    parameters: VehicleParameters
    history: VehicleHistory
    arrival: float | None = None
    """m along the lane at which the route ends, below 0 from its end; None: at its end."""
    route_id: str = ""
    """SUMO's id of the route of which `edges` are a part; '' of spawned vehicles."""
    version: int = 0
    """That of the lane graph when the path was found."""

    def observe_lines(self) -> None:
        """Note the line before which the vehicle stands."""
        if self.history.standing_time > 0.0:
            near = (e.via for e in self.path.entries if -STOPS_OVER < e.stop_line - self.s < HALTS_BEFORE)
            self.history.halted = next(near, self.history.halted)

    def observe_junction(self, length: float) -> None:
        """Note the junction in which the vehicle is as of the last observation; its `length` in m."""
        history = self.history
        over = 0.0 if self.speed > ROLLING else STOPS_OVER
        passed = [e for e in self.path.entries if e.stop_line < self.s - over and self.s - length < e.exit]
        entry = passed[-1].via if passed else ""
        if entry == history.entry:
            return
        # Others that have entered since then wait for it, unless it has halted before the line inside.
        goes_on = entry != "" and entry != history.halted and junction_of(entry) == junction_of(history.entry)
        history.entered = history.entered if goes_on else history.observed if entry else math.inf
        history.entry = entry
