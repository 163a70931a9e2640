"""Figures as files, each drawn once."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from slrl_sumo.ground.surfaces import SurfaceShapes

DPI = 110

FAR = 9000.0
"""y in m from which on the ticks of maps can need an offset, as "+5.8e6" above the axis: from 10,000 m on, as maps are
higher than 10 m."""


class Layout(NamedTuple):
    """Places of the parts of a figure, in shares of its width and height."""

    axes: tuple[Bbox, ...]
    texts: tuple[tuple[float, float], ...]
    """x, y of texts outside axes, as the title of the figure."""


def title_style(surfaces: SurfaceShapes) -> dict[Any, float]:
    """Settings of matplotlib that put titles of axes right above them, where there is nothing to avoid.

    Otherwise matplotlib measures all labels of the y axis twice for each title, in case that there is an offset: 17 %
    of the time of a report.
    """
    far = any(np.abs(shape.points[:, 1]).max() > FAR for shape in surfaces.shapes)
    return {} if far else {"axes.titley": 1.0}


def write_picture(figure: Figure, file: Path, layout: Layout | None = None) -> Layout:
    """Write a figure with constrained layout as PNG of DPI pixels per inch; returns its layout.

    `layout`: of the same figure in other colours, as this function returned it; None: it is computed.
    """
    # Figure.savefig would draw the figure twice, the first time for the layout alone. Twice drawn figures took 20 % of
    # the time of a report, and layouts of dark figures 13 %.
    figure.set_dpi(DPI)
    if layout is not None:
        for axes, place in zip(figure.axes, layout.axes, strict=True):
            axes.set_position(place)
        for text, (x, y) in zip(figure.texts, layout.texts, strict=True):
            text.set_position((x, y))
        figure.set_layout_engine("none")
    FigureCanvasAgg(figure).print_png(file)  # type: ignore[no-untyped-call]
    return Layout(
        tuple(axes.get_position(original=True) for axes in figure.axes),
        tuple(text.get_position() for text in figure.texts),
    )
