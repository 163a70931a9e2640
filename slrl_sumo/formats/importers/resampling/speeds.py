"""Detection of positions in another unit than metres, from implausible speeds of road users."""

import numpy as np

from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES

USUAL_SPEEDS = ((0.1, 45.0), (0.5, 9.0), (0.4, 3.7))
"""Least and most m/s per type. Recordings of HC, SDD and TAF-BW have 0.25 to 8.5, 3.6 to 6.1 and 1.1 to 3.4, the ends
of 18 parked cars with noise and of "pedestrians" of SDD that ride. HC in metres where its pixels are due has 0.19, 0.20
and 0.07; pedestrians in feet have 4.0, bicycles 14. Cars in feet on streets cannot be told from those of motorways."""

FEWEST_USERS, FEWEST_ROWS = 3, 5
"""Road users of a type that are judged, and rows of each."""


def speed_notes(trajectories: Trajectories) -> tuple[str, ...]:
    """A note for each type with a speed below or above all known recordings."""
    t = trajectories
    notes = []
    for kind, (least, most) in enumerate(USUAL_SPEEDS):
        tracks = np.flatnonzero((t.type == kind) & (np.diff(t.starts) >= FEWEST_ROWS)).tolist()
        speeds = [t.speed[t.starts[track] + 1 : t.starts[track + 1]] for track in tracks]
        middles = [middle for speed in speeds if (middle := _middle(speed)) > 0.0]
        if len(middles) < FEWEST_USERS:
            continue
        slow, fast = _middle(np.concatenate(speeds)), float(np.median(middles))
        if slow < least or fast > most:
            notes.append(
                f"{TYPE_NAMES[kind]}s that move do so at {slow if slow < least else fast:.2g} m/s (median), usual are "
                f"{least:g} to {most:g}; check that positions are in metres and times or frame rate are right"
            )
    return tuple(notes)


def _middle(speed: Floats) -> float:
    """The speed at which half of the way is covered, so that standing does not count; 0 without motion."""
    ordered = np.sort(speed)
    way = np.cumsum(ordered)
    return float(ordered[np.searchsorted(way, 0.5 * way[-1])]) if len(way) else 0.0
