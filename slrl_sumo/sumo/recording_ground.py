"""The ground under a recording: a SUMO network's, a mask drawn by hand (as in the paper), or road everywhere."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Area, Surface, SurfaceShapes
from slrl_sumo.sumo.net_file import read_net_file

COLOURS = {(255, 255, 255): Surface.ROAD, (255, 255, 0): Surface.SIDEWALK, (0, 0, 0): Surface.NONE}
"""RGB of a mask's surfaces, those of ego images; each channel counts as 255 from 128 on."""

AROUND = 60.0
"""m of road around a recording where everything is road: more than an ego image shows."""


def everywhere_road(recording: Trajectories) -> RoadMap:
    """A map of nothing but road, from AROUND before the recording's outermost positions to AROUND behind them."""
    (x0, x1), (y0, y1) = ((v.min() - AROUND, v.max() + AROUND) for v in (recording.x, recording.y))
    return RoadMap(SurfaceShapes((Area(Surface.ROAD, np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])),)))


def ground_of_net(net: Path) -> RoadMap:
    """The surfaces of a SUMO network, in its own coordinates. Raises InputError where SUMO cannot read it."""
    return RoadMap(read_net_file(net).surfaces())


def ground_of_mask(mask: Path, metres_per_pixel: float) -> RoadMap:
    """The surfaces of a picture: white road, yellow sidewalk, black nothing (COLOURS).

    Its upper left corner lies at (0, 0) m and y points up, so that all of it has y below 0: where the importers put
    recordings whose positions are pixels of such a picture (HC, SDD), and levelXdata its backgrounds.
    Raises InputError where the file is no picture, or has other colours.
    """
    if not 1e-4 < metres_per_pixel < 100:
        raise InputError(f"--metres-per-pixel {metres_per_pixel:g}: give the side of a pixel in metres, e.g. 0.05")
    data = np.fromfile(mask, np.uint8) if mask.is_file() else np.zeros(0, np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    if picture is None:
        raise InputError(f"--mask {mask}: cannot be read as a picture; give a PNG")
    rgb = np.where(picture[:, :, ::-1] >= 128, 255, 0)
    known = np.zeros(rgb.shape[:2], np.bool_)
    regions: list[tuple[float, Area]] = []
    for colour, surface in COLOURS.items():
        mine = (rgb == colour).all(-1)
        known |= mine
        regions += _regions(mine, surface, metres_per_pixel)
    if not known.all():
        row, col = np.argwhere(~known)[0].tolist()
        raise InputError(
            f"--mask {mask}: pixel (column {col}, row {row}) is {tuple(picture[row, col, ::-1].tolist())}; "
            "paint white for road, yellow for sidewalk and black for anything else"
        )
    if not any(area.surface == Surface.ROAD for _, area in regions):
        raise InputError(f"--mask {mask}: there is no road in it; paint it white")
    # What lies in a hole of something is smaller than it: painted later, it stays visible, nothing included.
    regions.sort(key=lambda region: -region[0])
    return RoadMap(SurfaceShapes(tuple(area for _, area in regions)))


def _regions(mine: NDArray[np.bool_], surface: Surface, metres_per_pixel: float) -> list[tuple[float, Area]]:
    """Size and outline, without holes, of each connected region of a surface."""
    # Every pixel becomes 3 x 3, so that outlines, which go through the centres of pixels, are right to a sixth of one.
    fine = np.repeat(np.repeat(mine.astype(np.uint8), 3, 0), 3, 1)
    outlines, tree = cv2.findContours(fine, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    found = []
    for outline, (_, _, _, parent) in zip(outlines, tree[0] if tree is not None else (), strict=True):
        if parent < 0:  # the others are borders of holes
            corners = (outline[:, 0].astype(np.float64) + 0.5) * (metres_per_pixel / 3) * np.array([1.0, -1.0])
            found.append((float(cv2.contourArea(outline)), Area(surface, corners)))
    return found


def given_ground(
    recording: Trajectories, net: Path | None, mask: Path | None, metres_per_pixel: float | None
) -> tuple[RoadMap | None, str]:
    """The ground that a user has given for a recording, and what to call it; None where none was given.

    Raises InputError where the options do not go together, or hardly a position of the recording lies on any surface:
    other coordinates, probably.
    """
    if net is not None and mask is not None:
        raise InputError("--net and --mask were both given; give one of them")
    if (mask is None) != (metres_per_pixel is None):
        raise InputError("--mask and --metres-per-pixel belong together; give both")
    if net is not None:
        roadmap, surface = ground_of_net(net), f"SUMO network {net}"
    elif mask is not None and metres_per_pixel is not None:
        roadmap, surface = ground_of_mask(mask, metres_per_pixel), f"mask {mask}, {metres_per_pixel:g} m per pixel"
    else:
        return None, ""
    share = float((roadmap.surface_at(recording.x, recording.y) != Surface.NONE).mean()) if len(recording) else 1.0
    if share < 0.05:
        x0, y0, x1, y1 = roadmap.bounds
        raise InputError(
            f"{surface}: {share:.0%} of the recorded positions lie on its surfaces; these reach from "
            f"({x0:.0f}, {y0:.0f}) to ({x1:.0f}, {y1:.0f}) m, the recording from "
            f"({recording.x.min():.0f}, {recording.y.min():.0f}) to ({recording.x.max():.0f}, {recording.y.max():.0f}) "
            "m; both must have the same coordinates"
        )
    return roadmap, surface
