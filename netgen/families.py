"""Families of scenarios: one number, the seed, draws the spec and the demand."""

from pathlib import Path
from random import Random
from typing import Literal, get_args

from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.scenario import write_scenario
from slrl_sumo.netgen.specs import (
    Control,
    DemandSpec,
    IntersectionSpec,
    MotorwaySpec,
    NetSpec,
    RandomSpec,
    RoundaboutSpec,
    SharedSpaceSpec,
    most_spread,
)

Family = Literal["intersection", "roundabout", "shared-space", "random", "town", "motorway", "signals"]


def generate(family: str, seed: int, folder: Path, size: int | None = None) -> Path:
    """Draw a scenario of `family` from `seed` and write it to `folder`; returns the path of its .sumocfg.

    `size`: how often the family random adds a street (see `RandomSpec.iterations`); the others have one size.
    Raises NetgenError: an unknown family, a seed or size out of range, and whatever `write_scenario` raises.
    """
    spec, demand = draw_spec(family, seed, size)
    sized = f" --size {size}" if size is not None else ""
    command = f"slrl-sumo generate {family} --seed {seed}{sized} --out DIR"
    return write_scenario(spec, demand, folder, command)


def draw_spec(family: str, seed: int, size: int | None = None) -> tuple[NetSpec, DemandSpec]:
    """The net and the demand of `seed` in `family`; for `size` see `generate`.

    Streets, controls, angles, speed limits and traffic differ from seed to seed. Raises NetgenError as `generate` does.
    """
    if family not in get_args(Family):
        raise NetgenError(f"there is no family {family!r}: give one of {', '.join(get_args(Family))}")
    if size is not None and family != "random":
        raise NetgenError(f"the family {family} has one size: leave the size out, or give the family random")
    random = Random(f"{family}-{seed}")
    if family == "intersection":
        return _draw_intersection(random, seed)
    if family == "roundabout":
        return _draw_roundabout(random, seed)
    if family == "shared-space":
        return _draw_shared_space(random, seed)
    if family == "motorway":
        return _draw_motorway(random, seed)
    if family == "signals":
        return _draw_signals(random, seed)
    return _draw_random(random, seed, size) if family == "random" else _draw_town(random, seed)


def _draw_intersection(random: Random, seed: int) -> tuple[IntersectionSpec, DemandSpec]:
    control = random.choice(get_args(Control))
    # Right before left is for quiet streets: on fast, two-lane ones cars of all four arms block each other repeatedly.
    quiet = control == "right_before_left"
    sidewalks = random.random() < 0.85
    spec = IntersectionSpec(
        arms=random.choice((3, 4)),
        lanes=1 if quiet else random.choice((1, 1, 2)),
        control=control,
        sidewalks=sidewalks,
        crossings=sidewalks and random.random() < 0.85,
        cycle_lanes=random.random() < 0.6,
        arm_length=float(random.randint(70, 110)),
        angle_spread=round(random.uniform(0.0, 20.0), 1),
        speed_limit=8.33 if quiet else random.choice((8.33, 13.89)),
        seed=seed,
    )
    return spec, _draw_demand(random, seed, cars=(250, 650) if spec.lanes == 1 else (400, 900))


def _draw_roundabout(random: Random, seed: int) -> tuple[RoundaboutSpec, DemandSpec]:
    arms = random.choice((3, 4, 4, 5))
    radius = float(random.randint(14, 24))
    sidewalks = random.random() < 0.85
    spec = RoundaboutSpec(
        arms=arms,
        radius=radius,
        sidewalks=sidewalks,
        crossings=sidewalks and random.random() < 0.85,
        cycle_lanes=random.random() < 0.6,
        arm_length=float(random.randint(85, 115)),
        angle_spread=round(random.uniform(0.0, min(20.0, most_spread(arms, radius))), 1),
        speed_limit=random.choice((8.33, 13.89)),
        seed=seed,
    )
    return spec, _draw_demand(random, seed, cars=(250, 650))


def _draw_shared_space(random: Random, seed: int) -> tuple[SharedSpaceSpec, DemandSpec]:
    spec = SharedSpaceSpec(
        arms=random.choice((2, 3, 4)),
        width=float(random.randint(9, 16)),
        corner_radius=float(random.randint(4, 12)),
        arm_length=float(random.randint(60, 100)),
        angle_spread=round(random.uniform(0.0, 20.0), 1),
        speed_limit=random.choice((2.78, 4.17, 5.56)),
        seed=seed,
    )
    return spec, _draw_demand(random, seed, cars=(80, 250), pedestrians=(200, 500))


def _draw_motorway(random: Random, seed: int) -> tuple[MotorwaySpec, DemandSpec]:
    lanes = random.choice((2, 2, 3))
    spec = MotorwaySpec(
        lanes=lanes,
        stretch=float(random.randint(500, 700)),
        curve_radius=float(random.randint(500, 1500)),
        ramp_limit=random.choice((13.89, 16.67, 22.22)),
        speed_limit=random.choice((19.44, 22.22, 27.78, 33.33, 36.11)),
        seed=seed,
    )
    # Some seeds exceed the capacity of the narrow stretch, so that speeds between jam and limit occur.
    cars = float(random.randint(800 * (lanes - 1), 2300 * (lanes - 1)))
    return spec, DemandSpec(cars_per_hour=cars, bicycles_per_hour=0.0, pedestrians_per_hour=0.0, seed=seed)


def _draw_random(random: Random, seed: int, size: int | None) -> tuple[RandomSpec, DemandSpec]:
    iterations = random.randint(7, 16) if size is None else size
    spec = RandomSpec(
        iterations=iterations,
        street_length=float(random.randint(80, 130)),
        two_lane_share=round(random.uniform(0.0, 0.4), 2),
        signal_share=round(random.uniform(0.0, 0.6), 2),
        cycle_lanes=random.random() < 0.6,
        speed_limit=random.choice((8.33, 13.89)),
        seed=seed,
    )
    # More streets have more ends to enter by, so traffic grows with the net.
    return spec, _draw_demand(random, seed, cars=(200 + 20 * iterations, 350 + 25 * iterations))


def _draw_town(random: Random, seed: int) -> tuple[RandomSpec, DemandSpec]:
    iterations = random.randint(14, 32)
    spec = RandomSpec(
        iterations=iterations,
        street_length=float(random.randint(100, 180)),
        two_lane_share=round(random.uniform(0.1, 0.6), 2),
        signal_share=round(random.uniform(0.2, 0.7), 2),
        cycle_lanes=random.random() < 0.5,
        speed_limit=random.choice((8.33, 11.11, 13.89, 13.89)),
        seed=seed,
    )
    # With 40 cars a street traffic is light; with 100 there are queues at most junctions (measured with plain SUMO).
    demand = DemandSpec(
        cars_per_hour=float(iterations * random.randint(40, 100)),
        bicycles_per_hour=float(iterations * random.randint(8, 18)),
        pedestrians_per_hour=float(iterations * random.randint(10, 24)),
        seed=seed,
    )
    return spec, demand


def _draw_signals(random: Random, seed: int) -> tuple[IntersectionSpec, DemandSpec]:
    """Arms so short that persons spend 10 to 30 % of their walks before a red light, in crowds (plain SUMO)."""
    spec = IntersectionSpec(
        arms=random.choice((3, 4, 4)),
        lanes=random.choice((1, 1, 2)),
        control="traffic_light",
        cycle_lanes=random.random() < 0.5,
        arm_length=float(random.randint(40, 60)),
        angle_spread=round(random.uniform(0.0, 20.0), 1),
        speed_limit=random.choice((8.33, 13.89)),
        seed=seed,
    )
    return spec, _draw_demand(random, seed, cars=(100, 500), pedestrians=(600, 3000))


def _draw_demand(
    random: Random, seed: int, cars: tuple[int, int], pedestrians: tuple[int, int] = (100, 350)
) -> DemandSpec:
    return DemandSpec(
        cars_per_hour=float(random.randint(*cars)),
        bicycles_per_hour=float(random.randint(80, 250)),
        pedestrians_per_hour=float(random.randint(*pedestrians)),
        seed=seed,
    )
