"""The reference of the Python API describes each public name as it is used."""

import importlib
from functools import cached_property

import pytest

from tools.make_reference import PUBLIC, api_page

PAGE = api_page()
NAMES = [(module, name) for module, names in PUBLIC.items() for name in names]


@pytest.mark.parametrize(("module", "name"), NAMES)
def test_members_are_shown_as_calls_where_they_are_called(module: str, name: str) -> None:
    value = getattr(importlib.import_module(module), name)
    for member, kind in vars(value).items() if isinstance(value, type) else ():
        if f"#### `{name}.{member}`\n" in PAGE:
            described = PAGE.split(f"#### `{name}.{member}`\n\n")[1]
            assert described.startswith("Property, `") == isinstance(kind, property | cached_property)


def test_what_attach_returns_is_described() -> None:
    assert {("slrl_sumo.simulation.attach", "Attached"), ("slrl_sumo.scene.state", "WorldState")} < set(NAMES)
    for member in ("step", "world", "ids", "refused"):
        assert f"#### `Attached.{member}`\n" in PAGE
    assert "| `x` | `Floats` | x of the centre of the box, m; " in PAGE
    assert "#### `Trajectories.speed`\n\nProperty, `Floats`.\n" in PAGE
