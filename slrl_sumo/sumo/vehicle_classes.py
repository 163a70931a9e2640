"""SUMO's vehicle classes: their default sizes, and the vehicles that are similar to the recorded vehicles."""

from collections.abc import Mapping
from typing import NamedTuple

CAR_CLASSES = frozenset(
    {
        *("passenger", "private", "taxi", "hov", "evehicle", "delivery"),
        *("authority", "army", "vip", "custom1", "custom2"),
    }
)
"""Classes that SUMO drives like passenger cars. Buses, coaches, lorries, trams, motorcycles, mopeds and scooters
accelerate, brake and change lanes differently, and emergency vehicles pass red signals
(https://sumo.dlr.de/docs/Vehicle_Type_Parameter_Defaults.html)."""
LEARNED_CLASSES = CAR_CLASSES | {"bicycle"}
MAX_LENGTH, MAX_WIDTH = 5.7, 2.1
"""Greatest length and width (m) of learned cars: a tenth more than the longest (5.2 m) and the widest (1.9 m) car of
netgen, from which the shipped models were recorded. If its centre follows a turn of radius 6 m, a car of this size
needs 0.2 m more room outside than the longest recorded car, a delivery van of 6.5 m 0.4 m more, and a bus of 12 m 2 m
more."""
SIZE = "size"


class Shape(NamedTuple):
    """Class, length (m) and width (m) of a vehicle, which decide whether learned models suit it."""

    vehicle_class: str
    length: float
    width: float


CLASS_SIZES: Mapping[str, tuple[float, float]] = {
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
"""Length and width (m), defaults of SUMO 1.28; classes that are missing here have the size of cars."""
DESIRED_SPEEDS: Mapping[str, float] = {"bicycle": 20.0 / 3.6}
"""Greatest desired speeds (m/s, desiredMaxSpeed), defaults of SUMO 1.28 that are below the top speeds of classes."""
PASSENGER = 5.0, 1.8


def usual_shape(vehicle_class: str) -> Shape:
    """SUMO's defaults for a class."""
    return Shape(vehicle_class, *CLASS_SIZES.get(vehicle_class, PASSENGER))


def without_models(shape: Shape) -> str:
    """Reason why models of cars and bicycles do not suit a vehicle: its class or SIZE; '' if they do."""
    if shape.vehicle_class not in LEARNED_CLASSES:
        return f"class {shape.vehicle_class}"
    if shape.vehicle_class in CAR_CLASSES and (shape.length > MAX_LENGTH or shape.width > MAX_WIDTH):
        return SIZE
    return ""
