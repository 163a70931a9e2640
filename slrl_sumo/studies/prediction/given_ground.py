"""The ground that a user gives for a recording: a SUMO network, a Lanelet2 map or a mask."""

from pathlib import Path
from typing import NamedTuple

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.lanelet_map import SUFFIXES, ground_of_lanelets
from slrl_sumo.ground.mask import ground_of_mask
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.routing.expected_routes import ExpectedRoutes
from slrl_sumo.sumo.net_file import read_net_lanes


class GivenGround(NamedTuple):
    """The ground of a recording, given by the user."""

    roadmap: RoadMap | None
    """The road map; None if the user gave no ground."""
    surface: str
    """Its name."""
    routes: ExpectedRoutes | None = None
    """Expected routes on its lanes; None without lanes."""


def given_ground(
    recording: Trajectories, net: Path | None, origin: str | None, mask: Path | None, metres_per_pixel: float | None
) -> GivenGround:
    """The ground that a user gives for a recording.

    `net` is a SUMO network, or a Lanelet2 map with the recording's `origin` (`ground_of_lanelets`). Raises InputError
    where the options do not go together, or less than 5 % of the positions lie on any surface: then the coordinates
    differ, probably.
    """
    if net is not None and mask is not None:
        raise InputError("--net and --mask were both given; give one of them")
    if (mask is None) != (metres_per_pixel is None):
        raise InputError("--mask and --metres-per-pixel belong together; give both")
    routes = None
    lanelets = net is not None and net.suffix in SUFFIXES
    if origin is not None and not lanelets:
        raise InputError(f"--origin {origin}: belongs to a Lanelet2 map (--net FILE.osm); leave it out")
    if net is not None and lanelets:
        roadmap, surface = ground_of_lanelets(net, origin), f"Lanelet2 map {net}" + (f" ({origin})" if origin else "")
    elif net is not None:
        network, following = read_net_lanes(net)
        roadmap, surface = RoadMap(network.surfaces()), f"SUMO network {net}"
        routes = ExpectedRoutes(network.lanes, following)
    elif mask is not None and metres_per_pixel is not None:
        roadmap, surface = ground_of_mask(mask, metres_per_pixel), f"mask {mask}, {metres_per_pixel:g} m per pixel"
    else:
        return GivenGround(None, "")
    check_ground(recording, roadmap, surface)
    return GivenGround(roadmap, surface, routes)


def check_ground(recording: Trajectories, roadmap: RoadMap, surface: str) -> None:
    """Raise InputError if less than 5 % of the positions lie on any surface of the ground called `surface`."""
    share = float((roadmap.surface_at(recording.x, recording.y) != Surface.NONE).mean()) if len(recording) else 1.0
    if share < 0.05:
        x0, y0, x1, y1 = roadmap.bounds
        raise InputError(
            f"{surface}: {share:.0%} of the recorded positions lie on its surfaces; these reach from "
            f"({x0:.0f}, {y0:.0f}) to ({x1:.0f}, {y1:.0f}) m, the recording from "
            f"({recording.x.min():.0f}, {recording.y.min():.0f}) to ({recording.x.max():.0f}, {recording.y.max():.0f}) "
            "m; both must have the same coordinates"
        )
