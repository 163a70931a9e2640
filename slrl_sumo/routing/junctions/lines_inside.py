"""Lines inside junctions before which vehicles wait."""

from collections.abc import Callable

from slrl_sumo.routing.lane_path import STOP_LINE, JunctionEntry
from slrl_sumo.routing.vehicle_track import VehicleTrack


def stops_inside(track: VehicleTrack, entry: JunctionEntry) -> tuple[float, float]:
    """Distances (m) from the front of a vehicle to the next waiting position after an entry, and to the exit.

    Without a waiting position, both are the distance to the exit.
    """
    return min(entry.waits - STOP_LINE, entry.exit) - track.s, entry.exit - track.s


def next_line(track: VehicleTrack, is_red: Callable[[JunctionEntry], bool]) -> tuple[JunctionEntry | None, float]:
    """The next waiting position in the vehicle's junction, and the distance (m) from its front to that position.

    Without a waiting position: None, and the distance to the exit. Vehicles that stop STOP_LINE before the red signal
    of the next junction may do so in this one, where streets of 0.2 m join the two.
    """
    entries = track.path.entries
    here = next(k for k, entry in enumerate(entries) if entry.via == track.history.entry)
    for entry in entries[here + 1 :]:
        stop, end = entry.stop_line - STOP_LINE, entries[here].exit
        if entry.stop_line < end or (stop < end and is_red(entry)):
            return entry, stop - track.s
    return None, entries[here].exit - track.s
