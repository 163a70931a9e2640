"""The ground of recordings without a network: a mask painted by hand (as in the paper), or road everywhere."""

import warnings
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from slrl_sumo.errors import InputError
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.ground.surfaces import Area, Surface, SurfaceShapes
from slrl_sumo.input_files import check_content, open_input
from slrl_sumo.scene.geometry import Floats

COLOURS = {(255, 255, 255): Surface.ROAD, (255, 255, 0): Surface.SIDEWALK, (0, 0, 0): Surface.NONE}
"""RGB of the surfaces in a mask, as in ego images; a channel counts as 255 from 128 on."""

PICTURES = ("PNG", "BMP", "TIFF", "WEBP", "JPEG")
BYTES_PER_PIXEL = 35
"""Memory that a mask takes while its regions are searched, measured with 2,880 by 2,880 pixels."""
MAX_REGIONS = 100_000
"""Regions of one colour; in a scanned or noisy picture each speck is one."""

ROAD_MARGIN = 60.0
"""Width (m) of road around the outermost positions: more than the extent of an ego image."""


def everywhere_road(x: Floats, y: Floats) -> RoadMap:
    """A map with road everywhere around positions (m), up to ROAD_MARGIN beyond the outermost ones."""
    (x0, x1), (y0, y1) = ((v.min() - ROAD_MARGIN, v.max() + ROAD_MARGIN) for v in (x, y))
    return RoadMap(SurfaceShapes((Area(Surface.ROAD, np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])),)))


def ground_of_mask(mask: Path, metres_per_pixel: float) -> RoadMap:
    """The surfaces of a picture: white road, yellow sidewalk, black none (COLOURS).

    Its upper left corner lies at (0, 0) m and y points up, so that the whole picture has y below 0. Importers place
    recordings with positions in pixels of such a picture (HC, SDD) in the same way, and levelXdata its backgrounds.
    Raises InputError where the file is no picture, or has other colours.
    """
    if not 1e-4 < metres_per_pixel < 100:
        raise InputError(f"--metres-per-pixel {metres_per_pixel:g}: give the side of a pixel in metres, e.g. 0.05")
    picture = _read_picture(mask)
    bright = picture >= 128
    known = np.zeros(picture.shape[:2], np.bool_)
    regions: list[tuple[float, Area]] = []
    for colour, surface in COLOURS.items():
        mine = (bright == (np.array(colour) >= 128)).all(-1)
        known |= mine
        if cv2.connectedComponents(mine.astype(np.uint8))[0] > MAX_REGIONS:
            raise InputError(f"--mask {mask}: it has more than {MAX_REGIONS} separate spots; paint areas of one colour")
        regions += _regions(mine, surface, metres_per_pixel)
    if not known.all():
        row, col = np.argwhere(~known)[0].tolist()
        raise InputError(
            f"--mask {mask}: pixel (column {col}, row {row}) is {tuple(picture[row, col].tolist())}; "
            "paint white for road, yellow for sidewalk and black for anything else"
        )
    if not any(area.surface == Surface.ROAD for _, area in regions):
        raise InputError(f"--mask {mask}: there is no road in it; paint it white")
    # A region in a hole is smaller than the region around it: painted later, it stays visible, also without a surface.
    regions.sort(key=lambda region: -region[0])
    return RoadMap(SurfaceShapes(tuple(area for _, area in regions)))


def _read_picture(mask: Path) -> NDArray[np.uint8]:
    """RGB of a picture, (rows, columns, 3). Raises InputError; its size is checked before it is unpacked."""
    try:
        with open_input(mask) as file, warnings.catch_warnings():
            # Pillow warns above 89 million pixels and refuses twice as many.
            warnings.simplefilter("ignore")
            with Image.open(file, formats=PICTURES) as picture:
                check_content(picture.width * picture.height * BYTES_PER_PIXEL)
                return np.asarray(picture.convert("RGB"))
    except OSError as error:
        reason = error.strerror or "it is damaged or no picture"
    except Exception as error:
        # Decoders raise many kinds of errors for damaged pictures.
        reason = " ".join(str(error).split())
    raise InputError(f"--mask {mask}: cannot be read as a picture ({reason}); give a PNG")


def _regions(mine: NDArray[np.bool_], surface: Surface, metres_per_pixel: float) -> list[tuple[float, Area]]:
    """Size and outline, without holes, of each connected region of a surface."""
    # With 3 x 3 pixels for each one, outlines (through centres of pixels) are right to a sixth of a pixel.
    fine = np.repeat(np.repeat(mine.astype(np.uint8), 3, 0), 3, 1)
    outlines, tree = cv2.findContours(fine, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    found = []
    for outline, (_, _, _, parent) in zip(outlines, tree[0] if tree is not None else (), strict=True):
        if parent < 0:  # the others are borders of holes
            corners = (outline[:, 0].astype(np.float64) + 0.5) * (metres_per_pixel / 3) * np.array([1.0, -1.0])
            found.append((float(cv2.contourArea(outline)), Area(surface, corners)))
    return found
