"""Only slrl_sumo.sumo calls SUMO's API, and libsumo and traci have what the protocol promises."""

import ast
import inspect
from pathlib import Path
from typing import get_type_hints

import libsumo
import pytest
import traci

import slrl_sumo
from slrl_sumo.sumo import api

ROOT = Path(slrl_sumo.__file__).parent
DOMAINS = {
    name: get_type_hints(member.fget)["return"]
    for name, member in vars(api.SumoApi).items()
    if isinstance(member, property)
}


def calls_of_the_api(source: str) -> list[str]:
    """Attributes of SUMO's domains that are read through a variable or attribute named `api`."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Attribute) or node.attr not in {*DOMAINS, "simulationStep"}:
            continue
        owner = node.value
        name = owner.attr if isinstance(owner, ast.Attribute) else owner.id if isinstance(owner, ast.Name) else ""
        if name.lstrip("_") in ("api", "libsumo", "traci"):
            found.append(f"line {node.lineno}: {ast.unparse(node)}")
    return found


def test_the_check_finds_calls() -> None:
    assert calls_of_the_api("self._api.vehicle.getSpeed(v)") == ["line 1: self._api.vehicle"]
    assert calls_of_the_api("person = session.api.person")
    assert calls_of_the_api("libsumo.simulationStep()")
    assert not calls_of_the_api("speed = vehicle_speed(self._api, v); stage.person.speed")


def test_only_the_folder_sumo_calls_the_api() -> None:
    outside = {
        str(path.relative_to(ROOT)): calls
        for path in sorted(ROOT.rglob("*.py"))
        if path.relative_to(ROOT).parts[0] != "sumo" and (calls := calls_of_the_api(path.read_text(encoding="utf-8")))
    }
    assert not outside


@pytest.mark.parametrize("domain", DOMAINS)
@pytest.mark.parametrize("library", [libsumo, traci])
def test_the_libraries_have_all_methods(library: object, domain: str) -> None:
    methods = [name for name in dir(DOMAINS[domain]) if not name.startswith("_")]
    assert methods
    missing = [name for name in methods if not callable(getattr(getattr(library, domain), name, None))]
    assert not missing, f"{library}: {domain}"


def test_methods_without_a_caller_are_not_in_the_protocol() -> None:
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "sumo").rglob("*.py") if path.name != "api.py"]
    called = {n.attr for source in sources for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Attribute)}
    promised = {
        name for protocol in DOMAINS.values() for name, _ in inspect.getmembers(protocol, callable) if name[0] != "_"
    }
    assert promised - called == set()
