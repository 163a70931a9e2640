"""The pictures of what road users see are those of their selector's preset."""

import numpy as np
import pytest

from slrl_sumo.perception.ego_image import EXTENDED_PALETTE, PATH
from slrl_sumo.simulation.events import Views
from slrl_sumo.simulation.run import run
from slrl_sumo.simulation.settings import RunSettings


@pytest.mark.parametrize(("selector", "sees_paths"), [("greedy", True), ("prior", False)])
def test_the_path_is_in_the_picture_where_the_selector_sees_it(selector: str, sees_paths: bool) -> None:
    settings = RunSettings("intersection", agents=6, selector=selector, steps=3)
    views = [event for event in run(settings, frozenset({1})) if isinstance(event, Views)]
    (view,) = views
    assert view.images.shape == (3, 20, 40, 3)
    # Ahead of the car on its path, beyond its own box.
    magenta = (view.images[0] == EXTENDED_PALETTE[PATH, 0]).all(axis=-1)
    assert bool(np.any(magenta[:, 12:])) == sees_paths
    assert view.time == pytest.approx(0.8)
