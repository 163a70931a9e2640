"""A learned vehicle on its path."""

import math
from dataclasses import dataclass

from slrl_sumo.routing.lane_path import LanePath, junction_of

ROLLING = 2.0
"""m/s above which a vehicle that has just passed a stop line does not stop any more."""
STOPS_OVER = 0.5
"""m by which a slower vehicle may be over a line and still count as waiting before it."""
HALTS_BEFORE = 4.0
"""m before a line at which the first vehicle of a queue stands."""


@dataclass(slots=True)
class VehicleTrack:
    """One vehicle on its path."""

    path: LanePath
    s: float
    """m along the path, of the front."""
    lateral_offset: float
    """m to the left of the path."""
    lateral_speed: float
    """m/s at which the offset grows."""
    speed: float
    edges: tuple[str, ...]
    """The route after the edge that the path begins on."""
    vehicle_class: str
    accel: float
    decel: float
    emergency: float
    max_speed: float
    speed_factor: float
    tau: float
    x: float
    """Centre at the last update, m."""
    y: float
    route_id: str = ""
    """SUMO's id of the route of which `edges` are a part; '' of spawned vehicles."""
    arrival: float | None = None
    """m along the lane at which the route ends, below 0 from its end; None: at its end."""
    version: int = 0
    """That of the lane graph when the path was found."""
    begun: float = -math.inf
    """Time (s) at which it began to be learned."""
    standing_time: float = 0.0
    """s."""
    idle_time: float = 0.0
    """s that it has stood although no signal is red."""
    free_since: float = math.inf
    """Time (s) since which it has stood before a line although nothing reserved is in its way; inf: not so."""
    obstructed: bool = False
    """A road user on its path slows it down."""
    ignores_standing_until: float = -math.inf
    """Time (s) until which standing vehicles beside its lane do not stop it."""
    halted: str = ""
    """The internal lane after the last line before which it has stood."""
    changed: float = -math.inf
    """Time (s) at which it began its last lane change."""
    entry: str = ""
    """The internal lane after the last line that it has passed in the junction in which it is; '' outside."""
    entered: float = math.inf
    """Time (s) at which it passed that line, or the first one if it did not halt before that one; inf outside."""

    def renew_entry(self, length: float, now: float) -> None:
        """Note the junction in which it is at the time `now` (s); its `length` in m."""
        over = 0.0 if self.speed > ROLLING else STOPS_OVER
        passed = [e for e in self.path.entries if e.stop_line < self.s - over and self.s - length < e.exit]
        entry = passed[-1].via if passed else ""
        if entry == self.entry:
            return
        # Others that have entered since then wait for it, unless it has halted before the line inside.
        goes_on = entry != "" and entry != self.halted and junction_of(entry) == junction_of(self.entry)
        self.entered = self.entered if goes_on else now if entry else math.inf
        self.entry = entry
