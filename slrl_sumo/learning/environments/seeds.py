"""Seeds of environments: seeds given to a reset, and drawn seeds."""

import operator
from typing import Any

import numpy as np

from slrl_sumo.errors import InputError

SEEDS = 2**31
"""Upper bound (exclusive) of drawn seeds: SUMO accepts no larger seeds."""


def drawn_seed(*numbers: int) -> int:
    """A seed drawn by some numbers."""
    return int(np.random.SeedSequence(numbers).generate_state(1)[0] >> 1)


def given_seed(seed: Any) -> int | None:
    """The seed given to a reset, a whole number of any type (including numpy's) from 0 on; None without a seed.

    Raises InputError for other values.
    """
    if seed is None:
        return None
    try:
        number = -1 if isinstance(seed, bool) else operator.index(seed)
    except TypeError:
        number = -1
    if number < 0:
        raise InputError("give a whole number from 0 on, or None", argument="seed", value=seed)
    return number


def given_seeds(seeds: Any, num_envs: int) -> int | None:
    """The seed of a simulation with `num_envs` sub-environments, from one seed or a sequence of seeds.

    One seed: see given_seed. A sequence with one seed per sub-environment, as in gymnasium.vector, draws a seed; None
    if all its seeds are None. Raises InputError.
    """
    listed = seeds.ndim > 0 if isinstance(seeds, np.ndarray) else isinstance(seeds, list | tuple | range)
    if not listed:
        return given_seed(seeds)
    each = [given_seed(seed) for seed in seeds]
    numbers = [seed for seed in each if seed is not None]
    if len(each) != num_envs or len(numbers) not in (0, num_envs):
        raise InputError(
            f"give a whole number from 0 on, {num_envs} of them, or None: the sub-environments are one simulation",
            argument="seed",
            value=seeds,
        )
    return drawn_seed(*numbers) if numbers else None


def next_seed(given: int | None, last: int | None) -> int:
    """The seed of a reset: the `given` seed, else the `last` seed plus one, else a random seed."""
    if given is not None:
        return given
    return int(np.random.default_rng().integers(SEEDS)) if last is None else last + 1
