"""One seed, one scenario."""

from pathlib import Path
from typing import get_args

import pytest

from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.families import Family, draw_spec, generate
from slrl_sumo.netgen.specs import IntersectionSpec, RandomSpec, RoundaboutSpec

FAMILIES = get_args(Family)


@pytest.mark.parametrize("family", FAMILIES)
def test_seeds_draw_varied_specs_and_the_same_seed_the_same(family: str) -> None:
    assert draw_spec(family, 7) == draw_spec(family, 7)
    drawn = [draw_spec(family, seed) for seed in range(40)]
    assert len(set(drawn)) == 40
    assert len({demand.cars_per_hour for _, demand in drawn}) > 20


def test_intersections_vary_in_arms_lanes_control_and_surfaces() -> None:
    specs = [spec for spec, _ in (draw_spec("intersection", seed) for seed in range(60))]
    assert all(isinstance(spec, IntersectionSpec) for spec in specs)
    for name, values in (("arms", 2), ("lanes", 2), ("control", 3), ("sidewalks", 2), ("crossings", 2)):
        assert len({getattr(spec, name) for spec in specs}) == values


def test_signals_are_intersections_with_signals_crossings_and_crowds() -> None:
    drawn = [draw_spec("signals", seed) for seed in range(60)]
    specs = [spec for spec, _ in drawn]
    assert all(isinstance(spec, IntersectionSpec) and spec.crossings for spec in specs)
    assert {spec.control for spec in specs} == {"traffic_light"}
    assert min(demand.pedestrians_per_hour for _, demand in drawn) >= 600.0


def test_every_seed_draws_a_roundabout_that_can_be_built() -> None:
    # The arms' turns must leave room on the ring, which hangs on the other numbers drawn: a spec refuses too much.
    specs = [spec for spec, _ in (draw_spec("roundabout", seed) for seed in range(400))]
    assert all(isinstance(spec, RoundaboutSpec) for spec in specs)
    assert {spec.arms for spec in specs} == {3, 4, 5}
    assert {spec.radius for spec in specs} == {float(r) for r in range(14, 25)}
    assert max(spec.angle_spread for spec in specs if spec.arms == 3) > 15.0
    for name in ("sidewalks", "crossings", "cycle_lanes"):
        assert {getattr(spec, name) for spec in specs} == {True, False}


@pytest.mark.parametrize("family", FAMILIES)
def test_generate_writes_the_drawn_scenario_and_says_how(family: str, tmp_path: Path) -> None:
    first, again, other = (generate(family, seed, tmp_path / str(k) / "made") for k, seed in enumerate((11, 11, 12)))
    files = [{f.name: f.read_bytes() for f in config.parent.iterdir()} for config in (first, again, other)]
    assert first.name == "made.sumocfg"
    assert files[0] == files[1]
    assert files[0]["made.net.xml"] != files[2]["made.net.xml"]
    assert f"slrl-sumo generate {family} --seed 11 --out DIR".encode() in files[0]["README.md"]


def test_size_sets_the_iterations_of_random_nets_only(tmp_path: Path) -> None:
    spec, _ = draw_spec("random", 1, size=20)
    assert isinstance(spec, RandomSpec)
    assert spec.iterations == 20
    with pytest.raises(NetgenError, match="intersection has one size"):
        generate("intersection", 1, tmp_path / "made", size=20)
    assert not (tmp_path / "made").exists()


def test_wrong_families_and_seeds_are_named(tmp_path: Path) -> None:
    with pytest.raises(
        NetgenError, match="no family 'village': give one of intersection, roundabout, shared-space, random, town"
    ):
        generate("village", 1, tmp_path / "made")
    with pytest.raises(NetgenError, match="seed is -1"):
        generate("random", -1, tmp_path / "made")
