"""Road users of a scenario or a script that are left alone: neither taken over nor held for learned ones."""

from collections.abc import Collection

from slrl_sumo.errors import InputError

Excluded = Collection[str] | str
"""Ids, or as text 'ego,bus_3'."""


def parse_excluded(given: Excluded) -> tuple[str, ...]:
    """The ids, each once, sorted. Raises InputError where there are others than texts, or empty ones."""
    ids = [road_user.strip() for road_user in given.split(",")] if isinstance(given, str) and given else given
    if not isinstance(ids, Collection) or not all(isinstance(i, str) and i for i in ids):
        raise InputError("give ids of road users, as ['ego'] or 'ego,bus_3'", argument="exclude", value=given)
    return tuple(sorted(set(ids)))
