"""Which of the scenario's own road users become learned ones."""

import hashlib
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.scene.geometry import Floats


def drawn(ids: Sequence[str], types: NDArray[np.int8], shares: Floats, seed: int) -> NDArray[np.bool_]:
    """Which of n road users are to be taken over, (n,).

    `types`: RoadUserType, (n,); `shares`: by type, (3,). The draw depends on the seed and the id alone, so that the
    same road users are learned in every run, whatever happens in it, and a larger share adds to a smaller one.
    """
    return np.array([_position(i, seed) for i in ids], np.float64) < shares[types]


@lru_cache(maxsize=100_000)
def _position(road_user: str, seed: int) -> float:
    """A number in [0, 1) that is the id's own. Python's hash() would differ from process to process."""
    digest = hashlib.blake2b(f"{seed}:{road_user}".encode(), digest_size=8).digest()
    # 53 bits are what a float holds: all 64 could round up to 1.
    return (int.from_bytes(digest) >> 11) / 2.0**53
