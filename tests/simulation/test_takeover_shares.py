"""The draw of road users that become learned."""

import subprocess
import sys

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.simulation.shares import parse_shares
from slrl_sumo.simulation.takeover import drawn

IDS = tuple(f"flow.{i}" for i in range(2000))
CARS = np.zeros(len(IDS), np.int8)


def test_shares_are_read_by_type_and_those_left_out_are_zero() -> None:
    assert parse_shares("pedestrian=1, car=0.3").tolist() == [0.3, 0.0, 1.0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("car", "share of car must be a number from 0 to 1"),
        ("car=1.2", "share of car must be a number from 0 to 1"),
        ("car=-0.1", "share of car must be a number from 0 to 1"),
        ("car=nan", "share of car must be a number from 0 to 1"),
        ("lorry=1", "'lorry' is no road user type; use car, bicycle, pedestrian"),
        ("car=0,bicycle=0", "all shares are zero"),
        ("car=0.1,car=0.2", "car is there twice"),
        ("", "no road user type"),
    ],
)
def test_wrong_shares_are_refused_with_the_reason(text: str, says: str) -> None:
    with pytest.raises(InputError, match=f"^takeover='{text}': ") as refusal:
        parse_shares(text)
    assert refusal.value.as_options().startswith(f"--takeover {text}".rstrip() + ": ")
    assert says in str(refusal.value)


def test_draw_does_not_depend_on_order_or_company() -> None:
    shares = np.array([0.3, 0.0, 1.0])
    whole = dict(zip(IDS, drawn(IDS, CARS, shares, seed=5).tolist(), strict=True))
    order = np.random.default_rng(0).permutation(len(IDS))[:100]
    some = tuple(IDS[i] for i in order)
    assert drawn(some, CARS[order], shares, seed=5).tolist() == [whole[i] for i in some]


def test_draw_takes_about_the_share_and_other_seeds_take_others() -> None:
    shares = np.array([0.3, 0.0, 1.0])
    first, second = drawn(IDS, CARS, shares, seed=1), drawn(IDS, CARS, shares, seed=2)
    # Four standard deviations of 2000 draws.
    assert abs(first.mean() - 0.3) < 0.041
    # Independent draws agree in 0.3² + 0.7² of all cases.
    assert abs((first == second).mean() - 0.58) < 0.045


def test_a_larger_share_keeps_those_of_a_smaller_one() -> None:
    small = drawn(IDS, CARS, np.array([0.2, 0.0, 0.0]), seed=3)
    large = drawn(IDS, CARS, np.array([0.6, 0.0, 0.0]), seed=3)
    assert (large & small).sum() == small.sum() < large.sum()


def test_shares_go_by_type_and_the_ends_are_exact() -> None:
    types = np.arange(len(IDS), dtype=np.int8) % 3
    chosen = drawn(IDS, types, np.array([0.0, 0.5, 1.0]), seed=1)
    assert not chosen[types == 0].any()
    assert 0.4 < chosen[types == 1].mean() < 0.6
    assert chosen[types == 2].all()


def test_draw_is_the_same_in_another_process() -> None:
    code = (
        "import numpy as np; from slrl_sumo.simulation.takeover import drawn;"
        "print(drawn([f'flow.{i}' for i in range(40)], np.zeros(40, np.int8), np.array([.5, 0, 0]), 7).tolist())"
    )
    elsewhere = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    here = drawn(IDS[:40], CARS[:40], np.array([0.5, 0.0, 0.0]), seed=7)
    assert elsewhere.strip() == str(here.tolist())


def test_from_no_road_users_none_is_drawn() -> None:
    assert drawn((), np.zeros(0, np.int8), np.ones(3), seed=1).tolist() == []
