"""Pairs of nearby road users in a table of positions over time."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.scene.geometry import Floats

ROWS_AT_ONCE = 5000
"""Number of rows searched at once, which bounds the memory."""

Rows = NDArray[np.intp]


def row_pairs(*, x: Floats, y: Floats, frame: Integers, reach: Floats, lag: int = 0) -> Iterator[tuple[Rows, Rows]]:
    """Pairs of rows (i, j) with frame[j] = frame[i] + `lag` that are closer than reach[i] + reach[j], chunk by chunk.

    `x`, `y`, `reach`: m, (R,). `frame`: (R,), in any order. `lag`: 0 or more. With lag 0, each pair occurs once, and no
    row is paired with itself; with a lag, rows of the same road user are paired, too.
    """
    order = np.argsort(frame, kind="stable")
    frames = frame[order]
    cuts = [0]
    for begin in np.flatnonzero(np.diff(frames, prepend=frames[:1])).tolist():
        if begin - cuts[-1] >= ROWS_AT_ONCE:  # parts of whole frames
            cuts.append(begin)
    for first, following in pairwise([*cuts, len(order)]):
        if first == following:
            continue
        here = order[first:following]
        lower, upper = np.searchsorted(frames, (frames[first] + lag, frames[following - 1] + lag + 1))
        there = order[lower:upper]
        if not len(there):
            continue
        radius = float(reach[here].max() + reach[there].max())
        # In the third dimension frames are farther apart than the search radius.
        apart = 2.0 * radius + 1.0
        base = int(frame[here[0]])
        points = np.column_stack([x[here], y[here], (frame[here] - base) * apart])
        tree = cKDTree(points)
        if lag == 0:
            found = tree.query_pairs(radius, output_type="ndarray")
            i, j = here[found[:, 0]], here[found[:, 1]]
        else:
            others = cKDTree(np.column_stack([x[there], y[there], (frame[there] - lag - base) * apart]))
            near = tree.sparse_distance_matrix(others, radius, output_type="ndarray")
            i, j = here[near["i"]], there[near["j"]]
        close = np.hypot(x[i] - x[j], y[i] - y[j]) < reach[i] + reach[j]
        yield i[close], j[close]
