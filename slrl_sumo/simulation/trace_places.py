"""Places of road users in a trace: learned persons on the edge, crossing or walking area under them, and heights."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.fcd.columns import Heights, Places
from slrl_sumo.scene.geometry import Floats, front_from_centre
from slrl_sumo.scene.state import WorldState
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.elevation import Elevation, has_elevation
from slrl_sumo.sumo.network import Network
from slrl_sumo.sumo.network.foot_lanes import FootLanes


class TracePlaces:
    """Corrects the places of learned persons for a trace; call `complete` in each SUMO step.

    SUMO's places of learned persons are wrong: their walk contains one ordinary edge at a time, so that SUMO never has
    them on crossings and walking areas, and in 6 to 22 % of the rows names an edge that is more than 1 m away.
    """

    def __init__(self, api: SumoApi, network: Network) -> None:
        self._foot_lanes = FootLanes(network.lanes)
        self._areas = frozenset(self._foot_lanes.lanes[k].edge for k in np.flatnonzero(self._foot_lanes.area))
        self._elevation = Elevation(api, network) if has_elevation(api, network) else None
        self._walked: dict[str, tuple[int, float, float, float]] = {}
        """For each person on a walking area: the area, x and y (m), and the distance (m) walked on the area."""

    def complete(self, places: Places, world: WorldState) -> Places:
        """`places` of all road users of `world`, with corrected edges and positions of learned persons, and heights.

        Heights are given if the network has them. As in SUMO's output for its persons, positions count from the begin
        of an edge or crossing in both walking directions (measured: equal within rounding); on a walking area, they are
        the distance (m) walked on the area.
        """
        rows = np.flatnonzero(places.person & world.learned)
        x, y = front_from_centre(world.x[rows], world.y[rows], world.heading[rows], world.length[rows])
        lanes, along = self._foot_lanes.at(x, y)
        self._walk_on([world.ids[row] for row in rows], lanes, x, y, along)
        edges, positions = list(places.lane), places.lane_position.copy()
        for row, lane in zip(rows.tolist(), lanes.tolist(), strict=True):
            edges[row] = self._foot_lanes.lanes[lane].edge if lane >= 0 else ""
        positions[rows] = along
        places = replace(places, lane=tuple(edges), lane_position=positions)
        if self._elevation is None:
            return places
        return replace(places, heights=self._heights(self._elevation, places, world, rows, lanes, along))

    def _walk_on(self, ids: list[str], lanes: NDArray[np.intp], x: Floats, y: Floats, along: Floats) -> None:
        """Set `along` of the persons on walking areas; `lanes` (-1: none), `x`, `y` (m) of n persons, (n,)."""
        on_lane = np.flatnonzero(lanes >= 0)
        walked = {}
        for k in on_lane[self._foot_lanes.area[lanes[on_lane]]].tolist():
            area, here_x, here_y = int(lanes[k]), x.item(k), y.item(k)
            last, before_x, before_y, distance = self._walked.get(ids[k], (-1, 0.0, 0.0, 0.0))
            along[k] = distance + float(np.hypot(here_x - before_x, here_y - before_y)) if last == area else 0.0
            walked[ids[k]] = area, here_x, here_y, along.item(k)
        self._walked = walked

    def _heights(
        self,
        elevation: Elevation,
        places: Places,
        world: WorldState,
        rows: NDArray[np.intp],
        lanes: NDArray[np.intp],
        along: Floats,
    ) -> Heights:
        """Heights of all road users; for the learned persons `rows` from the `lanes` under them, `along` m."""
        z, slope = elevation.of_road_users(world.ids, places.person)
        for row, number, place in zip(rows.tolist(), lanes.tolist(), along.tolist(), strict=True):
            if number < 0:
                z[row] = elevation.last(world.ids[row])
            elif self._foot_lanes.area[number]:
                z[row] = elevation.in_area(self._foot_lanes.lanes[number], world.x.item(row), world.y.item(row))
            else:
                z[row], slope[row] = elevation.on_lane(self._foot_lanes.lanes[number], place)
        # A walking area has no direction. SUMO uses the slope of the outline, which may be as steep as -86 degrees.
        slope[[edge in self._areas for edge in places.lane]] = 0.0
        elevation.keep(world.ids, places.person, z)
        return Heights(z, slope)
