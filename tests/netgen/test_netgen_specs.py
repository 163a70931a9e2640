"""The specs refuse what cannot be built, in one line that names the field."""

import math

import pytest

from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.specs import (
    DemandSpec,
    IntersectionSpec,
    RandomSpec,
    RoundaboutSpec,
    SharedSpaceSpec,
    most_spread,
)


@pytest.mark.parametrize(
    ("kind", "fields", "named"),
    [
        (IntersectionSpec, {"arms": 5}, "IntersectionSpec.arms is 5"),
        (IntersectionSpec, {"arms": 3.0}, "a whole number from 3 to 4"),
        (IntersectionSpec, {"lanes": 0}, "IntersectionSpec.lanes"),
        (IntersectionSpec, {"lanes": True}, "IntersectionSpec.lanes is True"),
        (IntersectionSpec, {"control": "stop"}, "right_before_left"),
        (IntersectionSpec, {"arm_length": 10.0}, "from 40 to 500"),
        (IntersectionSpec, {"angle_spread": math.nan}, "IntersectionSpec.angle_spread is nan"),
        (IntersectionSpec, {"speed_limit": 50}, "IntersectionSpec.speed_limit"),
        (IntersectionSpec, {"sidewalks": False}, "crossings but no sidewalks"),
        (RoundaboutSpec, {"arms": 6}, "RoundaboutSpec.arms is 6"),
        (RoundaboutSpec, {"radius": 8.0}, "RoundaboutSpec.radius is 8.0: give a number from 12 to 40"),
        (RoundaboutSpec, {"arm_length": 60.0}, "RoundaboutSpec.arm_length"),
        (RoundaboutSpec, {"sidewalks": False}, "crossings but no sidewalks"),
        (RoundaboutSpec, {"arms": 4, "radius": 16.0, "angle_spread": 20.0}, "at most 14.5, or the radius larger"),
        (RoundaboutSpec, {"arms": 5, "radius": 12.0}, "fewer arms, or the radius larger"),
        (SharedSpaceSpec, {"arms": 1}, "SharedSpaceSpec.arms"),
        (SharedSpaceSpec, {"speed_limit": 13.89}, "SharedSpaceSpec.speed_limit"),
        (SharedSpaceSpec, {"width": 2.0}, "SharedSpaceSpec.width"),
        (RandomSpec, {"iterations": 0}, "RandomSpec.iterations"),
        (RandomSpec, {"seed": -1}, "RandomSpec.seed"),
        (RandomSpec, {"signal_share": 1.5}, "from 0 to 1"),
        (RandomSpec, {"sidewalks": False}, "crossings but no sidewalks"),
        (DemandSpec, {"cars_per_hour": -1.0}, "DemandSpec.cars_per_hour"),
        (DemandSpec, {"pedestrians_per_hour": "many"}, "DemandSpec.pedestrians_per_hour is 'many'"),
        (DemandSpec, {"duration": math.inf}, "DemandSpec.duration"),
        (DemandSpec, {"cars_per_hour": 0, "bicycles_per_hour": 0, "pedestrians_per_hour": 0}, "no road users"),
    ],
)
def test_wrong_values_are_refused_in_one_line(kind: type, fields: dict[str, object], named: str) -> None:
    with pytest.raises(NetgenError) as caught:
        kind(**fields)
    assert named in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("arms", "radius"), [(3, 12.0), (4, 16.0), (5, 14.0), (5, 24.0)])
def test_the_widest_turn_of_a_roundabouts_arms_is_accepted_and_no_more(arms: int, radius: float) -> None:
    widest = most_spread(arms, radius)
    assert RoundaboutSpec(arms=arms, radius=radius, angle_spread=widest).angle_spread == widest
    with pytest.raises(NetgenError, match="angle_spread"):
        RoundaboutSpec(arms=arms, radius=radius, angle_spread=widest + 0.1)
