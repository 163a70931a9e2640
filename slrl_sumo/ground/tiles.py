"""Painted squares of the ground: half a byte per pixel, as many squares as fit into a memory limit."""

import math
from collections.abc import Mapping
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.ground.surfaces import SurfaceShapes, paint
from slrl_sumo.scene.compiled import compiled
from slrl_sumo.scene.geometry import Floats, cos_sin

Ids = NDArray[np.uint8]
Longs = NDArray[np.int64]
Words = NDArray[np.uint32]

PACKED = 8
"""Pixels in a word of 32 bits, the first one in its lowest bits."""
MISSING = -1
"""Slot of a square that is not painted."""
FARTHEST = 2**31
"""Squares are numbered below this on either side of the origin; there is no ground farther away."""


class Store(NamedTuple):
    """The squares for compiled loops."""

    keys: Longs
    """Of all squares, sorted."""
    slots: Longs
    """Where each of them is painted, or MISSING."""
    used: Longs
    """When each slot was last used."""
    now: int
    squares: Words
    """The slots, (slots, pixels, words)."""
    resolution: float
    """px/m."""
    core: float
    """m; side of a square."""
    margin: float
    """m painted around it."""


class Views(NamedTuple):
    """n views from places `x`, `y` (m) in directions `cos`, `sin`, (n,) each.

    The first pixel lies `ahead` m ahead and `left` m to the left, the next ones every `step` m.
    """

    x: Floats
    y: Floats
    cos: Floats
    sin: Floats
    ahead: float
    left: float
    step: float


class Tiles:
    """The ground in squares of side `core` (m), each painted with `margin` m around it.

    Squares are painted on demand. The least recently used one is dropped where `memory_limit` bytes would be exceeded;
    one always fits.
    """

    def __init__(
        self,
        shapes: SurfaceShapes,
        index: Mapping[tuple[int, int], NDArray[np.intp]],
        *,
        resolution: float,
        core: float,
        margin: float,
        memory_limit: int,
    ) -> None:
        """`index`: shapes that show in the square (column, row), in paint order; `resolution` in px/m."""
        self._shapes = shapes
        self._resolution = resolution
        self._core, self._margin = core, margin
        self._pixels = round((core + 2 * margin) * resolution)
        self._words = -(-self._pixels // PACKED)
        members = {_key(column, row): shapes for (column, row), shapes in index.items()}
        self._keys = np.array(sorted(members), np.int64)
        self._members = [members[key] for key in self._keys.tolist()]
        self._slots = np.full(len(self._keys), MISSING, np.int64)
        one = self._pixels * self._words * PACKED // 2
        # Memory is only reserved until it is written: unpainted squares use none.
        self._squares = np.zeros((max(1, min(memory_limit // one, len(self._keys))), self._pixels, self._words), "u4")
        self._used = np.zeros(len(self._squares), np.int64)
        """When each slot was last used; 0 is never."""
        self._owner = np.full(len(self._squares), MISSING, np.int64)
        """Square in each slot."""
        self._now = 0
        self._lock = Lock()
        """Squares are painted, and dropped, while points are looked up."""

    @property
    def resident_bytes(self) -> int:
        """Memory of the painted squares."""
        return int(np.count_nonzero(self._owner != MISSING) * self._squares[0].nbytes)

    def at(self, x: Floats, y: Floats) -> Ids:
        """Ground under points (m), (n,); zero outside all squares. ValueError for different numbers of x and y."""
        _alike(x, y)
        found = np.zeros(len(x), np.uint8)
        pending = np.ones(len(x), np.bool_)
        x, y = np.ascontiguousarray(x, np.float64), np.ascontiguousarray(y, np.float64)
        with self._lock:
            self._now += 1
            while (square := _look_up(x, y, found, pending, self._state())) != MISSING:
                self._paint(square)
        return found

    def views(self, x: Floats, y: Floats, heading: Floats, begin: tuple[float, float], step: float, out: Ids) -> None:
        """Ground under the pixels of views from positions `x`, `y` (m) with `heading` (rad), written to `out` (n, rows,
        cols). The first pixel lies at `begin` (m ahead, m to the left), the next ones every `step` m, columns ahead and
        rows to the right. A view must lie within the margin around its position. ValueError for different lengths."""
        _alike(x, y, heading)
        places = np.ascontiguousarray(x, np.float64), np.ascontiguousarray(y, np.float64)
        views = Views(*places, *cos_sin(heading), *begin, step)
        pending = np.ones(len(x), np.bool_)
        self._now += 1
        while (square := _cut_out(views, out, pending, self._state())) != MISSING:
            self._paint(square)

    def _state(self) -> Store:
        measures = self._resolution, self._core, self._margin
        return Store(self._keys, self._slots, self._used, self._now, self._squares, *measures)

    def _paint(self, square: int) -> None:
        """Paint a square, in place of the least recently used one if there is no room."""
        slot = int(self._used.argmin())
        if self._owner[slot] != MISSING:
            self._slots[self._owner[slot]] = MISSING
        column, row = _column_row(int(self._keys[square]))
        canvas = np.zeros((self._pixels, self._words * PACKED), np.uint8)
        shapes = [self._shapes.shapes[k] for k in self._members[square].tolist()]
        x0, y0 = column * self._core - self._margin, row * self._core - self._margin
        # OpenCV clips at the borders of this view of the canvas.
        paint(canvas[:, : self._pixels], shapes, x0, y0, self._resolution)
        _pack(canvas, self._squares[slot])
        self._slots[square], self._owner[slot], self._used[slot] = slot, square, self._now


def _alike(*columns: Floats) -> None:
    """ValueError for different shapes: compiled functions would read beyond the end of a shorter array."""
    if len({np.shape(column) for column in columns}) > 1:
        raise ValueError(f"positions need arrays of one shape, not {', '.join(str(np.shape(c)) for c in columns)}")


def _key(column: int, row: int) -> int:
    """Column and row of a square as one number, ascending by row."""
    return row * FARTHEST * 2 + column


def _column_row(key: int) -> tuple[int, int]:
    row = (key + FARTHEST) // (FARTHEST * 2)
    return key - row * FARTHEST * 2, row


@compiled
def _pack(canvas: Ids, words: Words) -> None:
    for r in range(words.shape[0]):
        for w in range(words.shape[1]):
            word = np.uint32(0)
            for k in range(PACKED):
                word |= np.uint32(canvas[r, w * PACKED + k]) << np.uint32(4 * k)
            words[r, w] = word


@compiled
def _square(x: float, y: float, core: float, keys: Longs) -> int:
    """Index of the square around a point (m), or MISSING."""
    column, row = math.floor(x / core), math.floor(y / core)
    if not (abs(x / core) < FARTHEST - 1 and abs(y / core) < FARTHEST - 1):
        return MISSING
    key = row * FARTHEST * 2 + column
    low, high = 0, len(keys)
    while low < high:
        middle = (low + high) // 2
        if keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low if low < len(keys) and keys[low] == key else MISSING


@compiled
def _look_up(x: Floats, y: Floats, found: Ids, pending: NDArray[np.bool_], store: Store) -> int:
    """Find the ground under `pending` points in painted squares; returns a square that is not painted, or MISSING."""
    keys, slots, used, now, squares, resolution, core, margin = store
    missing = square = MISSING
    west, south = 0.0, 0.0
    for i in range(len(x)):
        if not pending[i]:
            continue
        # Neighbours in the array are mostly neighbours on the ground.
        if square == MISSING or not (west <= x[i] < west + core and south <= y[i] < south + core):
            square = _square(x[i], y[i], core, keys)
            if square == MISSING:
                pending[i] = False
                continue
            west, south = math.floor(x[i] / core) * core, math.floor(y[i] / core) * core
        slot = slots[square]
        if slot == MISSING:
            missing = square
            continue
        row = int((y[i] - (south - margin)) * resolution)
        col = int((x[i] - (west - margin)) * resolution)
        found[i] = squares[slot, row, col >> 3] >> np.uint32((col & 7) * 4) & np.uint32(15)
        used[slot] = now
        pending[i] = False
    return missing


@compiled
def _cut_out(views: Views, out: Ids, pending: NDArray[np.bool_], store: Store) -> int:
    """Cut the `pending` views out of painted squares; returns a square that is not painted, or MISSING.

    The nearest pixel counts, in single precision, equal to warpAffine of OpenCV 5 to the bit.
    """
    keys, slots, used, now, squares, resolution, core, margin = store
    x, y, cos, sin, ahead, left, step = views
    missing = MISSING
    rows, cols = out.shape[1], out.shape[2]
    words = squares.shape[2]
    scale = step * resolution
    at, shift = np.empty(cols, np.int32), np.empty(cols, np.uint32)
    for i in range(len(x)):
        if not pending[i]:
            continue
        square, c, s = _square(x[i], y[i], core, keys), cos[i], sin[i]
        # Views are empty without a square, and where the direction is not a number.
        if square == MISSING or not c * c + s * s < 2.0:
            out[i] = 0
            pending[i] = False
            continue
        slot = slots[square]
        if slot == MISSING:
            missing = square
            continue
        west, south = math.floor(x[i] / core) * core - margin, math.floor(y[i] / core) * core - margin
        col0 = np.float32((x[i] + c * ahead - s * left) * resolution - 0.5 - west * resolution)
        row0 = np.float32((y[i] + s * ahead + c * left) * resolution - 0.5 - south * resolution)
        along, across = np.float32(scale * c), np.float32(scale * s)
        flat = squares[slot].reshape(-1)
        for r in range(rows):
            col_begin = np.float64(across * np.float32(r) + col0)
            row_begin = np.float64(-along * np.float32(r) + row0)
            for k in range(cols):
                # Fused multiply-add: rounded once to single precision.
                col = np.int32(np.rint(np.float32(np.float64(along) * k + col_begin)))
                row = np.int32(np.rint(np.float32(np.float64(across) * k + row_begin)))
                at[k] = row * words + (col >> 3)
                shift[k] = (col & 7) * 4
            for k in range(cols):
                out[i, r, k] = flat[at[k]] >> shift[k] & np.uint32(15)
        used[slot] = now
        pending[i] = False
    return missing
