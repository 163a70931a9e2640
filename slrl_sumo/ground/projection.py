"""Metres of a recording from geographic coordinates."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.scene.geometry import Floats

RADIUS = 6_378_137.0
"""m, semi-major axis of WGS 84; also the radius of the sphere of the spherical Mercator projection."""
FLATTENING = 1 / 298.257223563
"""Of WGS 84."""
SCALE = 0.9996
"""Of UTM on the central meridian of a zone."""
MAX_LATITUDE = 84.0
"""Degrees; of UTM."""


@dataclass(frozen=True)
class Origin:
    """Where (0, 0) m of a recording lies, and the projection that its metres are of."""

    projection: Literal["utm", "mercator"]
    north: float
    """Latitude in degrees, or with `metric` UTM's northing in m."""
    east: float
    """Longitude in degrees, or with `metric` UTM's easting in m."""
    metric: bool = False


def parse_origin(text: str) -> Origin:
    """`utm:LAT,LON`, `mercator:LAT,LON` (degrees) or `utm:EASTING,NORTHING` (m). Raises InputError."""
    projection, _, place = text.partition(":")
    try:
        first, second = (float(word) for word in place.split(","))
    except ValueError:
        first = second = math.nan
    if projection == "utm" and 1e5 <= first <= 9e5 and 0 <= second <= 1e7:
        return Origin("utm", second, first, metric=True)
    if projection in ("utm", "mercator") and abs(first) <= MAX_LATITUDE and abs(second) <= 180:
        return Origin("utm" if projection == "utm" else "mercator", first, second)
    raise InputError(
        f"--origin {text}: give the place of (0, 0) m in degrees as utm:LAT,LON or mercator:LAT,LON, or in m as "
        "utm:EASTING,NORTHING, e.g. mercator:49.0053,8.4374"
    )


def project(latitude: Floats, longitude: Floats, origin: Origin) -> tuple[Floats, Floats]:
    """x and y (m, east and north of the origin) of places in degrees, (n,) each, at least one.

    `mercator`: of a sphere, true to scale at the latitude of the origin, as TAF-BW. `utm`: as Lanelet2's UtmProjector
    and levelXdata; the zone is that of the origin or, where this is metric, of the middle of the places.
    """
    if origin.projection == "mercator":
        scale = RADIUS * math.cos(math.radians(origin.north))
        y = np.arctanh(np.sin(np.radians(latitude))) - math.atanh(math.sin(math.radians(origin.north)))
        return scale * np.radians(longitude - origin.east), scale * y
    meridian = 6 * math.floor((float(np.median(longitude)) if origin.metric else origin.east) / 6) + 3
    x, y = _transverse_mercator(latitude, longitude - meridian)
    if origin.metric:
        from_south = 1e7 if np.median(latitude) < 0 else 0.0
        return x + 5e5 - origin.east, y + from_south - origin.north
    x0, y0 = _transverse_mercator(np.array([origin.north]), np.array([origin.east - meridian]))
    return x - x0, y - y0


def _transverse_mercator(latitude: Floats, longitude: Floats) -> tuple[Floats, Floats]:
    """m east of the central meridian and north of the equator, with UTM's scale; `longitude` from that meridian.

    Krüger's series to the third order in the third flattening (Karney 2011, Transverse Mercator with an accuracy of a
    few nanometers, Journal of Geodesy 85): right to 0.1 mm within a zone.
    """
    n = FLATTENING / (2 - FLATTENING)
    eccentricity = 2 * math.sqrt(n) / (1 + n)
    sine = np.sin(np.radians(latitude))
    t = np.sinh(np.arctanh(sine) - eccentricity * np.arctanh(eccentricity * sine))
    along, across = np.cos(np.radians(longitude)), np.sin(np.radians(longitude))
    xi, eta = np.arctan2(t, along), np.arctanh(across / np.hypot(1, t))
    terms = (n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16, 13 * n**2 / 48 - 3 * n**3 / 5, 61 * n**3 / 240)
    x, y = eta.copy(), xi.copy()
    for j, term in enumerate(terms, start=1):
        x += term * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
        y += term * np.sin(2 * j * xi) * np.cosh(2 * j * eta)
    radius = SCALE * RADIUS / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    return radius * x, radius * y
