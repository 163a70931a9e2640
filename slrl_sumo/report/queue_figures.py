"""A map of the queues of vehicles in a run."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from slrl_sumo.ground.picture import GroundPicture
from slrl_sumo.metrics.traffic.queues import Queue
from slrl_sumo.report.looks import Look

NAMED_QUEUES = 8
"""Number of queues in the table, with their numbers on the map."""


def draw_queues(queues: Sequence[Queue], ground: GroundPicture, look: Look) -> Figure:
    """Queues as discs with areas proportional to their waiting times; the first NAMED_QUEUES have their numbers."""
    figure = Figure(figsize=ground.fitting(9.0, (4.5, 3.5)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(ground.pixels, origin="lower", extent=ground.extent, interpolation="nearest")
    most = queues[0].waited_s
    sizes = [20.0 + 700.0 * queue.waited_s / most for queue in queues]
    places = [queue.x for queue in queues], [queue.y for queue in queues]
    axes.scatter(*places, s=sizes, color="#CC3311", alpha=0.55, edgecolor=look.ink, lw=0.5)
    for number, queue in enumerate(queues[:NAMED_QUEUES], start=1):
        axes.annotate(str(number), (queue.x, queue.y), ha="center", va="center", fontsize=9, fontweight="bold")
    axes.set_title(f"Where vehicles stood; the largest disc: {most:.0f} s of all vehicles", fontsize=10)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    return figure
