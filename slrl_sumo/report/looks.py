"""Colours of figures on light and on dark pages."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from slrl_sumo.ground.picture import SURFACE_GREYS, TYPE_COLOURS
from slrl_sumo.ground.surfaces import Surface


@dataclass(frozen=True)
class Look:
    """One set of colours; all else is the same in all looks, so figures have the same layout."""

    suffix: str
    """Of the names of files."""
    ink: str
    """Colour of lines and marks without a type."""
    own: str
    """Colour of background road users."""
    types: tuple[str, str, str]
    """By RoadUserType."""
    greys: Mapping[Surface, tuple[int, int, int]]
    """Of the ground."""
    style: dict[Any, str] = field(default_factory=dict)
    """Settings of matplotlib."""


LIGHT = Look("", ink="black", own="#666666", types=TYPE_COLOURS, greys=SURFACE_GREYS)
_PAGE, _TEXT = "#16181b", "#dddddd"
"""Ground and text of dark pages, as in `page.STYLE`."""
DARK = Look(
    "-dark",
    ink="#eeeeee",
    own="#a5a5a5",
    types=("#F28C38", "#56B4E9", "#2CC295"),  # Okabe and Ito's, lighter: 4.5 times the luminance of the roads and more
    greys={
        Surface.NONE: (22, 24, 27),
        Surface.ROAD: (66, 68, 72),
        Surface.SIDEWALK: (50, 47, 38),
        Surface.CROSSING: (86, 88, 92),
        Surface.CYCLEWAY: (60, 52, 52),
    },
    style={
        **dict.fromkeys(("figure.facecolor", "axes.facecolor", "legend.facecolor"), _PAGE),
        **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color"), _TEXT),
        **dict.fromkeys(("axes.edgecolor", "legend.edgecolor"), "#777777"),
    },
)
LOOKS = (LIGHT, DARK)
