"""Where the trace has learned persons: on the edge, crossing or walking area under them."""

from dataclasses import replace

import numpy as np

from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.scene.geometry import front_from_centre
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.foot_lanes import FootLanes


class TracePlaces:
    """Corrects the places of learned persons for a trace; to be called in every SUMO step.

    SUMO's own are wrong for them: their walk is one ordinary edge at a time, so that SUMO never has them on crossings
    and walking areas, and in 6 to 22 % of the rows names an edge that is more than 1 m away.
    """

    def __init__(self, network: Network) -> None:
        self._foot_lanes = FootLanes(network.lanes)
        self._walked: dict[str, tuple[int, float, float, float]] = {}
        """Those on walking areas: the area, x and y (m), and m walked since they came onto it."""

    def of_learned(self, places: Places, learned: WorldState) -> Places:
        """`places` with edges and positions by where the `learned` road users are, which are their first n ones.

        As SUMO writes them for its persons, positions count from the begin of an edge or crossing, whichever way the
        person walks (measured: equal within rounding); on a walking area, they are m walked on it.
        """
        rows = np.flatnonzero(places.person[: len(learned)])
        if not len(rows):
            self._walked = {}
            return places
        x, y = front_from_centre(learned.x[rows], learned.y[rows], learned.heading[rows], learned.length[rows])
        lanes, along = self._foot_lanes.at(x, y)
        walked = {}
        on_lane = np.flatnonzero(lanes >= 0)
        for k in on_lane[self._foot_lanes.area[lanes[on_lane]]].tolist():
            name, area, here = learned.ids[rows[k]], int(lanes[k]), (x.item(k), y.item(k))
            last, before_x, before_y, distance = self._walked.get(name, (-1, 0.0, 0.0, 0.0))
            along[k] = distance + float(np.hypot(here[0] - before_x, here[1] - before_y)) if last == area else 0.0
            walked[name] = area, *here, along.item(k)
        self._walked = walked
        edges, positions = list(places.lane), places.lane_position.copy()
        for row, lane in zip(rows.tolist(), lanes.tolist(), strict=True):
            edges[row] = self._foot_lanes.lanes[lane].edge if lane >= 0 else ""
        positions[rows] = along
        return replace(places, lane=tuple(edges), lane_position=positions)
