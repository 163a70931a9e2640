"""A learned vehicle on its path."""

import math
from dataclasses import dataclass

from slrl_sumo.routing.lane_path import JunctionEntry, LanePath, junction_of
from slrl_sumo.scene.types import DECISION_INTERVAL, STANDING_SPEED
from slrl_sumo.sumo.road_users import VehicleParameters

ROLLING = 2.0
"""Speed (m/s) above which a vehicle that has just passed a stop line does not stop any more."""
STOPS_OVER = 0.5
"""Distance (m) past a line up to which a slower vehicle counts as waiting before the line."""
HALTS_BEFORE = 4.0
"""Distance (m) before a line within which the first vehicle of a queue stands."""


@dataclass(slots=True)
class VehicleHistory:
    """What a vehicle has done since it became a learned vehicle; kept when its path changes."""

    begun: float = -math.inf
    """Time (s) at which the vehicle became a learned vehicle."""
    observed: float = -math.inf
    """Time (s) of the last observation."""
    elapsed: float = 0.0
    """Time (s) between the last two observations, at most a decision interval; 0 if both are of the same time."""
    standing_time: float = 0.0
    """Time (s) for which the vehicle has stood."""
    idle_time: float = 0.0
    """Time (s) for which the vehicle has stood although no signal is red."""
    changed: float = -math.inf
    """Time (s) at which the vehicle began its last lane change."""
    halted: str = ""
    """Internal lane after the last line before which the vehicle has stood."""
    stops_for_yellow: str = ""
    """Internal lane after the line at which it stops for a yellow signal; '' without one. Vehicles that brake later
    than planned would else go on at yellow, into red."""
    held_time: float = 0.0
    """Time (s) for which the vehicle has stood since the first moment at which no signal was red; later reds count."""
    blocks: str = ""
    """Internal lane after the line that the vehicle passes although it may have to stand in the junction; '': none."""
    entry: str = ""
    """Internal lane after the last line that the vehicle has passed in its junction; '' outside junctions."""
    entered: float = math.inf
    """Time (s) of entry: when it passed the first line, or a later line if it halted before it; inf outside."""

    def observe(self, now: float, speed: float) -> None:
        """Update the standing time at the time `now` (s); `speed`: m/s."""
        self.elapsed, self.observed = min(now - self.observed, DECISION_INTERVAL), now
        self.standing_time = self.standing_time + self.elapsed if speed < STANDING_SPEED else 0.0

    def observe_signal(self, *, red: bool) -> None:
        """Update the times at a stand without a red signal, and since; call after `observe`."""
        self.idle_time = self.idle_time + self.elapsed if self.standing_time and not red else 0.0
        held = self.standing_time and (self.held_time or not red)
        self.held_time = self.held_time + self.elapsed if held else 0.0


@dataclass(frozen=True, slots=True)
class JunctionBehind:
    """The junction that the front of a vehicle has left, and its rear perhaps not."""

    lanes: tuple[str, ...]
    """Internal lanes on which the vehicle passed it."""
    begins: tuple[float, ...]
    """Position (m along the present path) at which each of them begins."""
    exit: float
    """Position (m along the present path) at which the junction ends."""


@dataclass(slots=True)
class VehicleTrack:
    """One vehicle on its path."""

    path: LanePath
    s: float
    """Position (m along the path) of the front."""
    lateral_offset: float
    """m to the left of the path."""
    speed: float
    """m/s at the last update."""
    x: float
    """Centre at the last update, m."""
    y: float
    edges: tuple[str, ...]
    """Edges of the route after the edge on which the path begins."""
    parameters: VehicleParameters
    history: VehicleHistory
    arrival: float | None = None
    """Position (m along the last lane) at which the route ends, negative from the lane's end; None: at the end."""
    route_id: str = ""
    """SUMO's id of the route of which `edges` are a part; '' for spawned vehicles."""
    behind: JunctionBehind | None = None
    """The junction before the path, None once the rear has left it."""
    lateral_position: float = 0.0
    """Lateral position within its lane that the vehicle holds, m to the left of the middle."""
    version: int = 0
    """Version of the lane graph with which the path was found."""
    seen_path: LanePath | None = None
    """Path along which the permissions of the edges ahead were last read."""
    seen_in: int = 0
    """Round of readings (see `LaneGraph.round`) in which they were read."""
    seen_until: float = -math.inf
    """Position (m along that path) of the first edge that was out of sight; inf if the path ends before."""

    def entries_ahead(self) -> list[tuple[JunctionEntry, float]]:
        """The entries on the path that the vehicle has not passed, each with its distance (m) from the front."""
        s = self.s
        return [(entry, ahead) for entry in self.path.entries if (ahead := entry.stop_line - s) > -STOPS_OVER]

    def observe_lines(self) -> None:
        """Record the line before which the vehicle stands."""
        if self.history.standing_time > 0.0:
            s = self.s
            for entry in self.path.entries:
                if -STOPS_OVER < entry.stop_line - s < HALTS_BEFORE:
                    self.history.halted = entry.via
                    return

    def observe_junction(self, length: float) -> None:
        """Record the junction of a vehicle of this `length` (m) at the last observation."""
        history, front, rear = self.history, self.s, self.s - length
        over, entry = front if self.speed > ROLLING else front - STOPS_OVER, ""
        for one in self.path.entries:
            if one.stop_line < over and rear < one.exit:
                entry = one.via
        if entry == history.entry:
            return
        # The entry time stays: vehicles that entered later wait. A halt before a line inside counts as a new entry.
        goes_on = entry != "" and entry != history.halted and junction_of(entry) == junction_of(history.entry)
        history.entered = history.entered if goes_on else history.observed if entry else math.inf
        history.entry, history.blocks = entry, ""
