"""Which of the scenario's own road users become learned ones."""

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES


def parse_shares(text: str) -> Floats:
    """Share of each type to take over, (3,), in [0, 1], from 'car=0.3,bicycle=1,pedestrian=1'.

    Types left out get 0. Raises InputError.
    """
    shares = np.zeros(len(TYPE_NAMES))
    named = set()
    for item in text.split(","):
        name, _, value = (part.strip() for part in item.partition("="))
        if name not in TYPE_NAMES:
            raise InputError(f"--takeover {text}: '{name}' is no road user type; use {', '.join(TYPE_NAMES)}")
        if name in named:
            raise InputError(f"--takeover {text}: {name} is there twice; give each type one share")
        named.add(name)
        try:
            share = float(value)
        except ValueError:
            share = np.nan
        if not 0.0 <= share <= 1.0:
            raise InputError(
                f"--takeover {text}: the share of {name} must be a number from 0 to 1; write for example {name}=0.3"
            )
        shares[TYPE_NAMES.index(name)] = share
    if not shares.any():
        raise InputError(f"--takeover {text}: all shares are zero; give at least one type a share above 0")
    return shares


def drawn(ids: Sequence[str], types: NDArray[np.int8], shares: Floats, seed: int) -> NDArray[np.bool_]:
    """Which of n road users are to be taken over, (n,).

    `types`: RoadUserType, (n,); `shares`: by type, (3,). The draw depends on the seed and the id alone, so that the
    same road users are learned in every run, whatever happens in it, and a larger share adds to a smaller one.
    """
    return np.array([_position(i, seed) for i in ids], np.float64) < shares[types]


def _position(road_user: str, seed: int) -> float:
    """A number in [0, 1) that is the id's own. Python's hash() would differ from process to process."""
    digest = hashlib.blake2b(f"{seed}:{road_user}".encode(), digest_size=8).digest()
    # 53 bits are what a float holds: all 64 could round up to 1.
    return (int.from_bytes(digest) >> 11) / 2.0**53
