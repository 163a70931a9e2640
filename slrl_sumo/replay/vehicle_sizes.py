"""Lengths and widths of the vehicles of a trace, which FCD lacks."""

import re

from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, SPAWNED_PREFIX, TYPE_NAMES, RoadUserType
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.trace_types import trace_types
from slrl_sumo.sumo.vehicle_classes import CLASS_SIZES, usual_shape

Size = tuple[float, float]
"""Length and width, m."""

_WORDS = (
    ("trailer", "trailer|semi|articulat"),
    ("truck", "truck|lorry|lkw|hgv"),
    ("coach", "coach"),
    ("bus", "bus"),
    ("tram", "tram"),
    ("rail_urban", "subway|metro|rail_urban"),
    ("rail", "rail|train"),
    ("motorcycle", "motor_?(cycle|bike)"),
    ("moped", "moped"),
    ("delivery", r"deliver|\bvan\b"),
    ("emergency", "emergency|ambulance|fire"),
)
"""Classes by words in the names of their types, the more special first."""


CLASS_NAMES = ("", "bus", "tram", "lorry", "motorcycle")
"""Kinds of vehicles beside the types that are learned, as the page names them."""
_GROUPS = {
    **dict.fromkeys(("bus", "coach"), "bus"),
    **dict.fromkeys(("tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway"), "tram"),
    **dict.fromkeys(("truck", "trailer", "delivery"), "lorry"),
    **dict.fromkeys(("motorcycle", "moped"), "motorcycle"),
}


def scenario_classes(scenario: Scenario) -> dict[str, str]:
    """SUMO's class by vehicle type id. Raises InputError where a route or additional file cannot be read."""
    return {vtype.get("id", ""): vtype.get("vClass", "passenger") for vtype in trace_types(scenario)}


def class_of(vtype: str, kind: int, known: dict[str, str]) -> str:
    """The name in CLASS_NAMES of a vehicle type: by its `known` class, else guessed by its name."""
    if kind != RoadUserType.CAR:
        return ""
    if vtype in known:
        return _GROUPS.get(known[vtype], "")
    return next((_GROUPS.get(vclass, "") for vclass, words in _WORDS if re.search(words, vtype.lower())), "")


def scenario_sizes(scenario: Scenario) -> tuple[dict[str, Size], dict[str, str]]:
    """Sizes by vehicle type id of the scenario's vTypes and of learned road users, and what road user types they are.

    The second dictionary names bicycles and pedestrians by their class, whatever they are called. Raises InputError
    where a route or additional file cannot be read.
    """
    sizes, kinds = {}, {}
    for vtype in trace_types(scenario):
        name, vclass = vtype.get("id", ""), vtype.get("vClass", "passenger")
        _, length, width = usual_shape(vclass)
        try:
            sizes[name] = (float(vtype.get("length", length)), float(vtype.get("width", width)))
        except ValueError:  # SUMO itself says what is wrong with it
            continue
        if name.startswith(SPAWNED_PREFIX):
            continue
        if vclass in ("bicycle", "pedestrian"):
            kinds[name] = vclass
    return sizes, kinds


def size_of(vtype: str, kind: int, known: dict[str, Size]) -> Size:
    """Length and width of a vehicle type: the `known` one; else, for cars, guessed by name; else the default of `kind`,
    its RoadUserType.
    """
    if vtype in known:
        return known[vtype]
    if kind == RoadUserType.CAR and vtype != f"{SPAWNED_PREFIX}{TYPE_NAMES[kind]}":
        for vclass, words in _WORDS:
            if re.search(words, vtype.lower()):
                return CLASS_SIZES[vclass]
    return float(DEFAULT_LENGTH[kind]), float(DEFAULT_WIDTH[kind])
