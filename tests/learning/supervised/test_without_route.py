"""What counts of a policy where no route is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from builders import make_bundle, make_recording

from slrl_sumo.errors import InputError
from slrl_sumo.ground.surfaces import Surface
from slrl_sumo.learning.supervised.without_route import calibrated, shares
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.routing.expected_routes import ExpectedRoutes
from slrl_sumo.sumo.network.lanes import Lane


def test_a_correction_counts_as_much_as_it_makes_recorded_modes_likelier() -> None:
    generator = torch.Generator().manual_seed(1)
    n = 4000
    useful, useless = (torch.randn(n, 20, generator=generator) for _ in range(2))
    known = torch.log_softmax(torch.randn(n, 20, generator=generator), -1)
    mode = torch.multinomial((known + 0.5 * useful).softmax(-1), 1, generator=generator)[:, 0]
    found = shares(known, torch.stack([useful, useless]), mode)
    assert found.tolist() == pytest.approx([0.5, 0.0], abs=0.06)
    # What is likelier by chance does not count.
    mode = torch.multinomial(known.exp(), 1, generator=generator)[:, 0]
    assert shares(known, torch.stack([useful, useless]), mode).tolist() == [0.0, 0.0]


def test_a_correction_that_hardly_makes_modes_likelier_does_not_count() -> None:
    generator = torch.Generator().manual_seed(1)
    known, useful = (torch.randn(40_000, 5, generator=generator) for _ in range(2))
    known = torch.log_softmax(known, -1)
    for weight, counts in ((0.1, False), (0.3, True)):  # 0.003 and 0.03 nats
        mode = torch.multinomial((known + weight * useful).softmax(-1), 1, generator=generator)[:, 0]
        assert (shares(known, torch.stack([useful, 0.0 * useful]), mode)[0] > 0.0) == counts


def test_a_calibrated_bundle_keeps_its_shares(tmp_path: Path) -> None:
    torch.manual_seed(3)
    policy = Policy(PolicyConfig(preset="extended", channels=(4, 4), hidden=16, head=8))
    with torch.no_grad():
        for parameter in policy.parameters():
            parameter += 0.3 * torch.randn(parameter.shape)
    trained = replace(make_bundle(), policy=policy, policy_training={"steps": 1}, training={"modes_by": "kmeans"})
    ways = [(0.5 * np.arange(30), 3.0 * k, 0.0) for k in range(3)]
    made = make_recording(*ways, type=[0, 1, 2], source="by hand")
    done = calibrated(trained, [made])
    assert done.policy is not None
    found = done.policy.without_route
    assert ((found >= 0.0) & (found <= 1.0)).all()
    assert (found != 1.0).any()
    assert done.policy_training is not None
    torch.testing.assert_close(torch.tensor(done.policy_training["without_route"]), found)
    assert done.policy_training["steps"] == 1
    assert "by hand" in done.card
    assert "expected_route" not in done.policy_training
    assert policy.without_route.tolist() == [[1.0, 1.0]] * 3  # the given one is as it was
    assert calibrated(done, [made]).card == done.card
    done.save(tmp_path / "again")
    again = load_bundle(tmp_path / "again").policy
    assert again is not None
    assert torch.equal(again.without_route, found)


def test_on_expected_routes_a_policy_has_shares_of_its_own(tmp_path: Path) -> None:
    torch.manual_seed(3)
    policy = Policy(PolicyConfig(preset="extended", hidden=16, head=8, image=False, prior_logits=False))
    with torch.no_grad():
        for parameter in policy.parameters():
            parameter += 0.3 * torch.randn(parameter.shape)
    trained = replace(make_bundle(), policy=policy, policy_training={"steps": 1}, training={"modes_by": "kmeans"})
    shape = np.array([[-10.0, 0.0], [400.0, 0.0]])
    lane = Lane("a_0", "a", shape, 3.2, 410.0, 13.9, frozenset({"passenger"}), False, Surface.ROAD)
    ways = [(2.0 * np.arange(150), 0.0, 0.0), (2.0 * np.arange(150), 9.0, 0.0), (0.5 * np.arange(150), 5.0, 0.0)]
    made = make_recording(*ways, type=[0, 0, 2], source="by hand")
    done = calibrated(trained, [made], [ExpectedRoutes([lane], {})])
    assert done.policy_training is not None
    found = done.policy_training["expected_route"]
    assert np.shape(found) == (3, 2)
    assert found[0] != done.policy_training["without_route"][0]
    assert found[1:] == [[0.0, 0.0]] * 2  # none of them has a route
    assert f"expected along the lanes: car {found[0][0]:.2f}" in done.card
    # Where nothing is expected of the road users, nothing counts.
    nothing = calibrated(trained, [made], [ExpectedRoutes([], {})]).policy_training
    assert nothing is not None
    assert nothing["expected_route"] == [[0.0, 0.0]] * 3


def test_only_policies_that_read_routes_are_calibrated() -> None:
    with pytest.raises(InputError, match="no trained selector that reads routes"):
        calibrated(make_bundle(), [])
