"""Lines inside junctions before which vehicles wait."""

from slrl_sumo.routing.lane_path import STOP_LINE, JunctionEntry
from slrl_sumo.routing.vehicle_track import VehicleTrack


def stops_inside(track: VehicleTrack, entry: JunctionEntry) -> tuple[float, float]:
    """Distances (m) from the front of a vehicle to the next waiting position after an entry, and to the exit.

    Without a waiting position, both are the distance to the exit.
    """
    return min(entry.waits - STOP_LINE, entry.exit) - track.s, entry.exit - track.s


def next_line(track: VehicleTrack) -> tuple[JunctionEntry | None, float]:
    """The next waiting position in the vehicle's junction, and the distance (m) from its front to that position.

    Without a waiting position: None, and the distance to the exit.
    """
    entries = track.path.entries
    here = next(k for k, entry in enumerate(entries) if entry.via == track.history.entry)
    for entry in entries[here + 1 :]:
        if entry.stop_line < entries[here].exit:
            return entry, entry.stop_line - STOP_LINE - track.s
    return None, entries[here].exit - track.s
