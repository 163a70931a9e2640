"""Excluded road users of a scenario or script: neither taken over nor held for learned road users."""

from collections.abc import Collection

from slrl_sumo.errors import InputError

Excluded = Collection[str] | str
"""Ids, or as text 'ego,bus_3'."""


def unseen_notices(ids: Collection[str]) -> list[str]:
    """The notice that no road user had one of these excluded ids; empty without ids."""
    return [f"exclude: no road user had one of the ids {', '.join(sorted(ids))}"] if ids else []


def parse_excluded(given: Excluded) -> tuple[str, ...]:
    """The unique ids, sorted. Raises InputError for ids that are empty or not texts."""
    ids = [road_user.strip() for road_user in given.split(",")] if isinstance(given, str) and given else given
    if not isinstance(ids, Collection) or not all(isinstance(i, str) and i for i in ids):
        raise InputError("give ids of road users, as ['ego'] or 'ego,bus_3'", argument="exclude", value=given)
    return tuple(sorted(set(ids)))
