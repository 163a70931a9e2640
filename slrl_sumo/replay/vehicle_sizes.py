"""Lengths and widths of the vehicles of a trace, which FCD lacks."""

import re

from slrl_sumo.scene.types import DEFAULT_LENGTH, DEFAULT_WIDTH, SPAWNED_PREFIX, TYPE_NAMES, RoadUserType
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.trace_types import trace_types

Size = tuple[float, float]
"""Length and width, m."""

CLASS_SIZES: dict[str, Size] = {
    "pedestrian": (0.215, 0.478),
    "wheelchair": (1.2, 0.72),
    "bicycle": (1.6, 0.65),
    "scooter": (1.2, 0.5),
    "moped": (2.1, 0.78),
    "motorcycle": (2.2, 0.9),
    "emergency": (6.5, 2.16),
    "delivery": (6.5, 2.16),
    "bus": (12.0, 2.5),
    "coach": (14.0, 2.6),
    "truck": (7.1, 2.4),
    "trailer": (16.5, 2.55),
    "tram": (22.0, 2.4),
    "rail_urban": (109.5, 3.0),
    "rail": (135.0, 2.84),
    "rail_electric": (200.0, 2.95),
    "rail_fast": (200.0, 2.95),
    "ship": (17.0, 4.0),
}
"""Defaults of SUMO 1.28 by vehicle class; all other classes are as long as cars
(https://sumo.dlr.de/docs/Vehicle_Type_Parameter_Defaults.html)."""

_PASSENGER: Size = (5.0, 1.8)
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


def scenario_sizes(scenario: Scenario) -> tuple[dict[str, Size], dict[str, str]]:
    """Sizes by vehicle type id of the scenario's vTypes and of learned road users, and what road user types they are.

    The second dictionary names bicycles and pedestrians by their class, whatever they are called. Raises InputError
    where a route or additional file cannot be read.
    """
    sizes, kinds = {}, {}
    for vtype in trace_types(scenario):
        name, vclass = vtype.get("id", ""), vtype.get("vClass", "passenger")
        length, width = CLASS_SIZES.get(vclass, _PASSENGER)
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
