"""Numbers of vehicles in the network over time, and detection of a jam."""

from array import array

import numpy as np

from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import STANDING_SPEED, RoadUserType

SHORTEST_RUN = 120.0
"""s; of shorter runs nothing is said: a network that fills up looks the same."""
GROWTH = 1.2
"""Ratio of the number of vehicles in the last tenth of the run to the number around its middle above which it grows."""
MORE_STANDING = 0.05
"""Least growth of the share of standing vehicles in a jam."""
LEAST_GROWTH = 20
"""Least growth of the number of vehicles in a jam; smaller numbers grow by chance."""


class Density:
    """Numbers of all vehicles in the network after each decision. `start`: world before the first decision."""

    def __init__(self, start: WorldState) -> None:
        self._times, self._vehicles, self._standing = array("d"), array("i"), array("i")
        self.add(start)

    def add(self, world: WorldState) -> None:
        """`world`: all road users at the end of a decision."""
        vehicle = world.type != RoadUserType.PEDESTRIAN
        self._times.append(world.time)
        self._vehicles.append(int(vehicle.sum()))
        self._standing.append(int((world.speed[vehicle] < STANDING_SPEED).sum()))

    def jam(self) -> str | None:
        """A message on a jam: the number of vehicles and the share of standing vehicles have grown since mid-run.

        None without a jam, and for runs shorter than SHORTEST_RUN.
        """
        times, vehicles, standing = (
            np.array(values, np.float64) for values in (self._times, self._vehicles, self._standing)
        )
        n = len(times)
        if times[-1] - times[0] < SHORTEST_RUN:
            return None
        middle, end = slice(round(0.45 * n), round(0.55 * n)), slice(round(0.9 * n), n)
        before, now = float(vehicles[middle].mean()), float(vehicles[end].mean())
        share_before, share_now = (
            float(standing[part].sum()) / max(float(vehicles[part].sum()), 1.0) for part in (middle, end)
        )
        if now < GROWTH * before or now - before < LEAST_GROWTH or share_now < share_before + MORE_STANDING:
            return None
        return (
            f"the traffic jams: {vehicles[-1]:.0f} vehicles are under way and their number grows (from {before:.0f} "
            f"around {times[middle].mean():.0f} s to {now:.0f} around {times[end].mean():.0f} s; {share_now:.0%} of "
            "them stand); `slrl-sumo compare` shows what SUMO alone does with the same demand"
        )
