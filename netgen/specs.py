"""Specifications of generated scenarios: small frozen dataclasses, checked on construction."""

from dataclasses import dataclass
from math import degrees, floor, isfinite
from typing import Literal, get_args

from slrl_sumo.netgen.errors import NetgenError

Control = Literal["priority", "right_before_left", "traffic_light"]
"""Right of way at the junction: SUMO's node types of the same names."""
_LEAST_GAP = 17.0
"""m of the island's edge from the middle of one arm to that of the next."""


def _within(spec: object, name: str, low: float, high: float) -> None:
    value = getattr(spec, name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value) or not low <= value <= high:
        kind = type(spec).__name__
        raise NetgenError(f"{kind}.{name} is {value!r}: give a number from {low:g} to {high:g}")


def _whole(spec: object, name: str, low: int, high: int) -> None:
    value = getattr(spec, name)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        kind = type(spec).__name__
        raise NetgenError(f"{kind}.{name} is {value!r}: give a whole number from {low} to {high}")


def _crossings_have_sidewalks(spec: "IntersectionSpec | RoundaboutSpec | RandomSpec") -> None:
    if spec.crossings and not spec.sidewalks:
        raise NetgenError(
            f"{type(spec).__name__} has crossings but no sidewalks: set sidewalks=True, or crossings=False as well"
        )


@dataclass(frozen=True)
class IntersectionSpec:
    """One intersection.

    Without sidewalks, pedestrians use the edge of the street; without crossings, they can only turn corners.
    """

    arms: int = 4
    """3 or 4 streets that meet."""
    lanes: int = 1
    """Car lanes per direction, 1 or 2."""
    control: Control = "priority"
    sidewalks: bool = True
    crossings: bool = True
    cycle_lanes: bool = True
    arm_length: float = 90.0
    """From the middle of the junction to the end of an arm, in m."""
    angle_spread: float = 0.0
    """Each arm is turned by up to this many degrees, drawn from `seed`."""
    speed_limit: float = 13.89
    """m/s."""
    seed: int = 0

    def __post_init__(self) -> None:
        _whole(self, "arms", 3, 4)
        _whole(self, "lanes", 1, 2)
        _within(self, "arm_length", 40.0, 500.0)
        _within(self, "angle_spread", 0.0, 25.0)
        _within(self, "speed_limit", 2.0, 20.0)
        _whole(self, "seed", 0, 2**31 - 1)
        if self.control not in get_args(Control):
            raise NetgenError(
                f"IntersectionSpec.control is {self.control!r}: give one of {', '.join(get_args(Control))}"
            )
        _crossings_have_sidewalks(self)


@dataclass(frozen=True)
class RoundaboutSpec:
    """One roundabout with one car lane: entering traffic gives way to the ring, pedestrians cross the arms.

    Without sidewalks, pedestrians use the edge of the street; without crossings, they can only turn corners.
    """

    arms: int = 4
    """3 to 5 streets that meet."""
    radius: float = 18.0
    """Of the island in the middle, in m: the ring surrounds it, car lane first."""
    sidewalks: bool = True
    crossings: bool = True
    """Over every arm, a car's length before the ring; pedestrians have priority."""
    cycle_lanes: bool = True
    arm_length: float = 100.0
    """From the middle of the island to the end of an arm, in m."""
    angle_spread: float = 0.0
    """Each arm is turned by up to this many degrees, drawn from `seed`."""
    speed_limit: float = 13.89
    """m/s, on the arms; slower on the ring, which is tight."""
    seed: int = 0

    def __post_init__(self) -> None:
        _whole(self, "arms", 3, 5)
        _within(self, "radius", 12.0, 40.0)
        _within(self, "arm_length", 80.0, 500.0)
        _within(self, "angle_spread", 0.0, 25.0)
        _within(self, "speed_limit", 2.0, 20.0)
        _whole(self, "seed", 0, 2**31 - 1)
        _crossings_have_sidewalks(self)
        widest = most_spread(self.arms, self.radius)
        if self.angle_spread > widest:
            mend = f"make it at most {widest:.1f}" if widest >= 0 else "give it fewer arms"
            raise NetgenError(
                f"RoundaboutSpec.angle_spread is {self.angle_spread:g}, but {self.arms} arms round a radius of "
                f"{self.radius:g} m must not come closer: {mend}, or the radius larger"
            )


def most_spread(arms: int, radius: float) -> float:
    """Degrees by which each arm of a roundabout may be turned so that a piece of ring remains between any two.

    Measured along the island's edge: an arm with sidewalks and cycle lanes takes 15 m of it. To a tenth of
    a degree; negative: no room.
    """
    return min(25.0, floor(5.0 * (360.0 / arms - degrees(_LEAST_GAP / radius))) / 10.0)


@dataclass(frozen=True)
class SharedSpaceSpec:
    """A square without kerbs: cars, bicycles and pedestrians on the same wide, slow surface, right before left."""

    arms: int = 4
    """2 (a street), 3 or 4 (a square) arms."""
    width: float = 14.0
    """Width of the whole surface of an arm, in m: half of it for each direction."""
    corner_radius: float = 6.0
    """Rounding of the corners of the square, in m: the larger, the wider the square."""
    arm_length: float = 80.0
    """From the middle to the end of an arm, in m."""
    angle_spread: float = 0.0
    """Each arm is turned by up to this many degrees, drawn from `seed`."""
    speed_limit: float = 5.56
    """m/s: 20 km/h."""
    seed: int = 0

    def __post_init__(self) -> None:
        _whole(self, "arms", 2, 4)
        _within(self, "width", 6.0, 30.0)
        _within(self, "corner_radius", 2.0, 15.0)
        _within(self, "arm_length", 50.0, 500.0)
        _within(self, "angle_spread", 0.0, 25.0)
        _within(self, "speed_limit", 1.0, 8.34)
        _whole(self, "seed", 0, 2**31 - 1)


@dataclass(frozen=True)
class RandomSpec:
    """A random street net: mixed lane numbers and controls, by netgenerate --rand."""

    iterations: int = 10
    """How often a street is added. 8 gives 2 or 3 junctions, 12 gives 5 to 8, 30 about 20."""
    street_length: float = 100.0
    """Streets are 0.8 to 1.3 times this long, in m."""
    two_lane_share: float = 0.25
    """Share of the streets with two car lanes per direction."""
    signal_share: float = 0.3
    """Share of the junctions of three or more streets that have a traffic light."""
    sidewalks: bool = True
    crossings: bool = True
    cycle_lanes: bool = True
    speed_limit: float = 13.89
    """m/s."""
    seed: int = 0

    def __post_init__(self) -> None:
        _whole(self, "iterations", 5, 500)
        _within(self, "street_length", 50.0, 500.0)
        _within(self, "two_lane_share", 0.0, 1.0)
        _within(self, "signal_share", 0.0, 1.0)
        _within(self, "speed_limit", 2.0, 20.0)
        _whole(self, "seed", 0, 2**31 - 1)
        _crossings_have_sidewalks(self)


@dataclass(frozen=True)
class MotorwaySpec:
    """One carriageway of a motorway, for cars: an on-ramp, an off-ramp, and a lane drop."""

    lanes: int = 2
    """Number of lanes before the lane drop, without lanes of the ramps; 2 to 4."""
    stretch: float = 600.0
    """Length (m) of each of four stretches: to the on-ramp, to the off-ramp, to the lane drop, and after it."""
    curve_radius: float = 1000.0
    """Radius (m) of curved stretches."""
    ramp_limit: float = 22.22
    """m/s."""
    speed_limit: float = 33.33
    """m/s."""
    seed: int = 0

    def __post_init__(self) -> None:
        _whole(self, "lanes", 2, 4)
        _within(self, "stretch", 300.0, 5000.0)
        _within(self, "curve_radius", 200.0, 10000.0)
        _within(self, "ramp_limit", 8.0, 40.0)
        _within(self, "speed_limit", 16.5, 55.0)
        _whole(self, "seed", 0, 2**31 - 1)


NetSpec = IntersectionSpec | RoundaboutSpec | SharedSpaceSpec | RandomSpec | MotorwaySpec


@dataclass(frozen=True)
class DemandSpec:
    """Numbers of road users that enter per hour, with Poisson arrivals, and the duration."""

    cars_per_hour: float = 500.0
    bicycles_per_hour: float = 150.0
    pedestrians_per_hour: float = 200.0
    duration: float = 600.0
    """s of simulated time; also the end of the scenario."""
    seed: int = 0
    """Draws the parameters and the routes of road users; also SUMO's seed in the .sumocfg."""

    def __post_init__(self) -> None:
        for name in ("cars_per_hour", "bicycles_per_hour", "pedestrians_per_hour"):
            _within(self, name, 0.0, 20000.0)
        _within(self, "duration", 10.0, 86400.0)
        _whole(self, "seed", 0, 2**31 - 1)
        if self.cars_per_hour + self.bicycles_per_hour + self.pedestrians_per_hour == 0:
            raise NetgenError("DemandSpec has no road users: give at least one type more than 0 per hour")
