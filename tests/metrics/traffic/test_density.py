import numpy as np
from builders import make_world

from slrl_sumo.metrics.traffic.density import Density
from slrl_sumo.scene.types import RoadUserType


def watch(vehicles: list[int], standing: list[float]) -> str | None:
    """Numbers of vehicles and the share that stands, every second."""
    density = Density(make_world(ids=()))
    for time, (count, share) in enumerate(zip(vehicles, standing, strict=True), 1):
        speed = np.where(np.arange(count) < share * count, 0.0, 8.0)
        density.add(make_world(np.zeros(count), speed=speed, time=float(time)))
    return density.jam()


def test_a_number_that_grows_while_more_vehicles_stand_is_a_jam() -> None:
    growing = [min(t, 400) for t in range(600)]
    assert watch(growing, [0.2] * 600) is None  # fills up and drives
    growing = list(range(600))
    notice = watch(growing, [t / 1000 for t in range(600)])
    assert notice is not None
    assert notice.startswith(
        "the traffic jams: 599 vehicles are under way and their number grows (from 299 around 300 s"
    )
    assert watch(growing, [0.2] * 600) is None


def test_short_runs_small_numbers_and_pedestrians_are_no_jam() -> None:
    assert watch(list(range(100)), [t / 200 for t in range(100)]) is None
    assert watch([t // 60 for t in range(600)], [t / 1000 for t in range(600)]) is None
    crowd = Density(make_world(ids=()))
    for time in range(600):
        crowd.add(make_world(np.zeros(time), type=RoadUserType.PEDESTRIAN, time=float(time)))
    assert crowd.jam() is None
