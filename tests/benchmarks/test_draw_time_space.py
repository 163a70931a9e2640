"""Time-space diagrams of arterials."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from benchmarks.draw_time_space import arterial, draw, played_by
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.studies.flow.run import SUMO


def test_an_arterial_goes_straight_on_and_its_lines_are_those_of_its_cars() -> None:
    played, on = played_by("left-turns", SUMO, 1, load_bundle("intersection"))
    chain = arterial(played, on)
    # From west to east or back: cars from north and south do not exist.
    assert [lane.edge for lane in chain] in (["in_w", "out_e"], ["in_e", "out_w"])
    axes = Figure().subplots()
    draw(axes, played, on, chain)
    (lines,) = (one for one in axes.collections if isinstance(one, LineCollection))
    pieces = np.array(lines.get_segments())
    assert len(pieces) > 1000
    time, place = pieces[:, :, 0], pieces[:, :, 1]
    assert (np.diff(time) > 0.0).all()
    # Forwards, at most as fast as cars drive.
    assert (np.diff(place) >= -0.5).all()
    assert (np.diff(place) / np.diff(time)).max() < 40.0
    assert place.min() < 20.0
    assert place.max() > chain[0].length + 100.0
