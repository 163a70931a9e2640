"""The recipe of the bundle that is not shipped."""

import numpy as np
from builders import make_recording

from tools.make_campus_bundle import since


def test_a_recording_from_a_frame_on_keeps_its_columns_together() -> None:
    ways = (np.arange(5.0), 0.0, 0.0), (np.arange(20.0), 1.0, 0.0)
    cut = since(make_recording(*ways, type=(0, 2), ids=("a", "b")), 13)
    assert (cut.ids, cut.type.tolist(), cut.frame.tolist()) == (("b",), [2], list(range(13, 20)))
    assert len(cut.mode) == 7
    assert len(cut.learned) == 1
