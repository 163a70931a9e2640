"""Figures of speeds by density, by hand."""

import numpy as np
from builders import make_recording

from benchmarks.speeds_by_density import cells

AT_4, AT_REST = (np.arange(6) * 1.6, 0.0, 0.0), (np.full(6, 90.0), 0.0, 0.0)
"""Tracks of six frames of 0.4 s: at 4 m/s, and standing."""


def test_the_table_has_numbers_speeds_and_shares_of_each_type() -> None:
    recording = make_recording(AT_4, AT_REST, AT_4, type=[0, 0, 2], learned=np.array([True, False, True]))
    nothing = "0.0 | nan | nan %"
    assert cells([recording, recording], 0) == f"2.0 | 2.00 | 50 % | {nothing} | 1.0 | 4.00 | 0 %"
    assert cells([recording], 0, learned=True) == f"1.0 | 4.00 | 0 % | {nothing} | 1.0 | 4.00 | 0 %"


def test_frames_before_the_first_one_do_not_count() -> None:
    stops = (np.array([0.0, 1.6, 3.2, 3.2, 3.2, 3.2]), 0.0, 0.0)
    assert cells([make_recording(stops)], 3).startswith("1.0 | 0.00 | 100 %")
