"""A map of the places where vehicles queued in a run."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from slrl_sumo.ground.picture import draw_ground
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.metrics.queues import Queue

NAMED = 8
"""Queues in the table, with their numbers on the map."""


def draw_queues(queues: Sequence[Queue], surfaces: SurfaceShapes) -> Figure:
    """Queues as discs whose areas are their waiting times; the first NAMED with their numbers in the table."""
    ground, extent = draw_ground(surfaces)
    width, height = extent[1] - extent[0], extent[3] - extent[2]
    scale = 9.0 / max(width, height)
    figure = Figure(figsize=(max(width * scale, 4.5) + 1, max(height * scale, 3.5) + 1), layout="constrained")
    axes = figure.subplots()
    axes.imshow(ground, origin="lower", extent=extent, interpolation="nearest")
    most = queues[0].waited_s
    sizes = [20.0 + 700.0 * queue.waited_s / most for queue in queues]
    places = [queue.x for queue in queues], [queue.y for queue in queues]
    axes.scatter(*places, s=sizes, color="#CC3311", alpha=0.55, edgecolor="black", lw=0.5)
    for number, queue in enumerate(queues[:NAMED], start=1):
        axes.annotate(str(number), (queue.x, queue.y), ha="center", va="center", fontsize=9, fontweight="bold")
    axes.set_title(f"Where vehicles stood; the largest disc: {most:.0f} s of all vehicles", fontsize=10)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    return figure
