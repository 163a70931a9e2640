"""Density and flow by Edie's definitions."""

import pytest

from slrl_sumo.studies.flow.fundamental_diagram import edge_states
from slrl_sumo.studies.flow.pictures import draw_fundamental_diagram, draw_under_way
from slrl_sumo.studies.flow.run import Run
from slrl_sumo.studies.flow.trace import TraceBuilder, on_lanes
from tests.builders import make_world
from tests.studies.flow.test_trace import lane


def test_flow_is_density_times_speed_of_an_edge_and_minute() -> None:
    builder = TraceBuilder()
    # Two cars on 200 m for one minute of 150 steps, with 7.5 m/s or 27 km/h on average.
    for step in range(150):
        builder.add(make_world(x=[50.0, 100.0], speed=[10.0, 5.0], length=5.0, time=0.4 * step))
    trace = builder.build()
    lanes = [lane("road", (0.0, 0.0), (200.0, 0.0)), lane("short", (210.0, 0.0), (230.0, 0.0))]
    states = edge_states(trace, on_lanes(trace, lanes))
    assert states == [pytest.approx([10.0, 10.0 * 27.0])]
    empty = TraceBuilder().build()
    assert edge_states(empty, on_lanes(empty, lanes)) == []
    runs = {
        Run("queue", arm, 1): {"edge_states": states, "under_way_by_minute": [3, 4]} for arm in ("sumo", "lane")
    } | {Run("signal", "sumo", 1): {"edge_states": [], "under_way_by_minute": []}}
    for figure in (draw_fundamental_diagram(runs), draw_under_way(runs)):
        shown = [axes for axes in figure.axes if axes.get_visible()]
        assert [axes.get_title(loc="left") for axes in shown] == ["queue", "signal"]
        assert [len(axes.lines) for axes in shown] == [2, 1]
        assert [text.get_text() for text in figure.legends[0].get_texts()] == ["sumo", "lane"]
