"""Shares of the road user types, from arguments and options."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from slrl_sumo.errors import InputError
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import TYPE_NAMES

if TYPE_CHECKING:
    from slrl_sumo.models.bundle import ModelBundle  # torch takes its time

Shares = Mapping[str, float] | str
"""Shares by type name: {"car": 0.3, "bicycle": 1}, or as text 'car=0.3,bicycle=1'."""


def parse_shares(given: Shares) -> Floats:
    """Share of each type to take over, (3,), in [0, 1]. Types left out get 0. Raises InputError."""
    return _parsed(given, "takeover", 1.0)


def served_shares(given: Shares, bundle: "ModelBundle") -> Floats:
    """Like `parse_shares`; also raises InputError if the bundle has no models for a type with a share above 0."""
    shares = parse_shares(given)
    if unserved := bundle.missing(shares > 0):
        raise InputError(
            f"bundle '{bundle.name}' has no models for {unserved}: leave it out, or use another bundle",
            argument="takeover",
            value=given,
        )
    return shares


def parse_mix(given: Shares) -> Floats:
    """Shares of the types among spawned road users, (3,), normalised. Types left out get 0. Raises InputError."""
    shares = _parsed(given, "mix", float(np.finfo(np.float64).max))
    shares /= shares.max()  # before the sum, so that huge shares do not overflow
    return np.asarray(shares / shares.sum())


def shares_text(given: Shares) -> str:
    """The shares as text for the command line: 'car=0.3,bicycle=1'."""
    return given if isinstance(given, str) else ",".join(f"{name}={share}" for name, share in given.items())


def _parsed(given: Shares, argument: str, most: float) -> Floats:
    """Shares by type, (3,), each from 0 to `most`, at least one of them above 0."""

    def wrong(reason: str) -> InputError:
        return InputError(reason, argument=argument, value=given)

    pairs: Iterable[tuple[str, str | float]]
    if isinstance(given, str):
        items = [item.partition("=") for item in given.split(",")]
        pairs = [(name.strip(), share.strip()) for name, _, share in items]
    elif isinstance(given, Mapping):
        pairs = given.items()
    else:
        raise wrong("give shares by type, as {'car': 0.3} or 'car=0.3'")
    shares = np.full(len(TYPE_NAMES), np.nan)
    for name, value in pairs:
        if name not in TYPE_NAMES:
            raise wrong(f"'{name}' is no road user type; use {', '.join(TYPE_NAMES)}")
        kind = TYPE_NAMES.index(name)
        if not np.isnan(shares[kind]):
            raise wrong(f"{name} is there twice; give each type one share")
        with suppress(ValueError, TypeError):
            shares[kind] = float(value)
        if not 0.0 <= shares[kind] <= most:
            limit = "" if most > 1.0 else " to 1"
            raise wrong(f"the share of {name} must be a number from 0{limit}; write for example {name}=0.3")
    shares[np.isnan(shares)] = 0.0
    if not shares.any():
        raise wrong("all shares are zero; give at least one type a share above 0")
    return shares
