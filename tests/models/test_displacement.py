import numpy as np
import torch
from builders import make_world
from torch.nn import functional

from slrl_sumo.models.bundle import ModelBundle, tensors
from slrl_sumo.models.displacement import SPEED, displacement, new_speed
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.advance import advance
from slrl_sumo.scene.geometry import to_ego
from slrl_sumo.scene.types import DECISION_INTERVAL


def test_batched_motion_is_that_of_one_network_per_road_user(bundle: ModelBundle, seen: Observation) -> None:
    models, networks = bundle.displacement, bundle.displacement.networks
    vector, kind = tensors(seen)
    mode = torch.arange(len(kind)) * 7 % 20
    acceleration, yaw_rate = models.motion(vector, kind, mode)
    for i in range(len(kind)):
        t, m = int(kind[i]), int(mode[i])
        x = torch.clamp((vector[i] - networks.mean[t]) * networks.scale[t], -5, 5)
        for layer in range(3):
            x = functional.linear(x, networks.weight[layer][t, m].T, networks.bias[layer][t, m, 0])
            x = torch.tanh(x)
        low, high = models.acceleration_bounds[t]
        a = float(x[0] * high if x[0] > 0 else -x[0] * low)
        speed = min(max(float(vector[i, SPEED]) + a * DECISION_INTERVAL, 0.0), float(models.max_speed[t]))
        right, left = (float(b) for b in models.yaw_rate_bounds[t])
        limit = float(models.max_curvature[t]) * speed
        right, left = max(right, -limit), min(left, limit)
        w = float(x[1]) * (left if x[1] > 0 else -right)
        np.testing.assert_allclose([float(acceleration[i]), float(yaw_rate[i])], [a, w], rtol=1e-4, atol=1e-5)


def test_motion_of_all_modes_agrees_with_motion_of_each(bundle: ModelBundle, seen: Observation) -> None:
    vector, kind = tensors(seen)
    every = bundle.displacement.motion_all(vector, kind)
    assert every[0].shape == every[1].shape == (300, 20)
    for mode in range(20):
        one = bundle.displacement.motion(vector, kind, torch.full_like(kind, mode))
        for of_all, of_one in zip(every, one, strict=True):
            torch.testing.assert_close(of_all[:, mode], of_one, rtol=1e-4, atol=1e-5)
    assert float((every[0].std(1)).min()) > 0  # the modes differ, so the comparison above means something


def test_bounds_hold_for_any_input(bundle: ModelBundle, seen: Observation) -> None:
    models = bundle.displacement
    vector, kind = tensors(seen)
    wild = torch.randn(vector.shape, generator=torch.Generator().manual_seed(0)) * 1e3
    wild[:, SPEED] = wild[:, SPEED].abs()
    for x in (vector, wild, -wild):
        acceleration, yaw_rate = models.motion_all(x, kind)
        low, high = models.acceleration_bounds[kind].T[:, :, None]
        right, left = models.yaw_rate_bounds[kind].T[:, :, None]
        assert bool(((acceleration >= low) & (acceleration <= high)).all())
        assert bool(((yaw_rate >= right) & (yaw_rate <= left)).all())
        speed = new_speed(x[:, SPEED, None], acceleration, models.max_speed[kind][:, None])
        limit = models.max_curvature[kind][:, None] * speed
        assert bool((yaw_rate.abs() <= limit + 1e-6).all())
    reached = models.motion_all(wild, kind)[0]
    assert float(reached.max()) > 2.9  # the bounds are reached, not just never approached
    assert float(reached.min()) < -3.9


def test_standing_road_users_cannot_turn(bundle: ModelBundle, seen: Observation) -> None:
    vector, kind = tensors(seen)
    standing = vector.clone()
    standing[:, SPEED] = 0.0
    acceleration, yaw_rate = bundle.displacement.motion_all(standing, kind)
    stays = acceleration <= 0
    assert int(stays.sum()) > 100
    assert bool((yaw_rate[stays] == 0).all())
    assert float(yaw_rate[~stays].abs().min()) > 0


def test_displacement_is_the_motion_of_advance() -> None:
    random = np.random.default_rng(3)
    n = 500
    speed, acceleration = random.uniform(0, 10, n), random.uniform(-30, 30, n)  # both ends of the speed range are hit
    yaw_rate, heading, limit = random.uniform(-2, 2, n), random.uniform(-3, 3, n), random.uniform(4, 12, n)
    world = make_world(5.0, -3.0, heading, speed)
    moved = advance(world, acceleration, yaw_rate, limit, DECISION_INTERVAL)
    expected = np.stack(to_ego(moved.x - world.x, moved.y - world.y, heading), -1)
    v, a, w, most = (torch.from_numpy(z) for z in (speed, acceleration, yaw_rate, limit))
    np.testing.assert_allclose(displacement(v, a, w, most).numpy(), expected, atol=1e-12)
    np.testing.assert_allclose(new_speed(v, a, most).numpy(), moved.speed, atol=1e-12)
    assert (moved.speed == 0).any()
    assert (moved.speed == limit).any()


def test_displacement_can_be_differentiated() -> None:
    speed, most = torch.tensor([3.0], dtype=torch.float64), torch.tensor([9.0], dtype=torch.float64)
    acceleration = torch.tensor([0.5], dtype=torch.float64, requires_grad=True)
    yaw_rate = torch.tensor([0.3], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda a, w: displacement(speed, a, w, most), (acceleration, yaw_rate))


def test_no_road_users_are_no_trouble(bundle: ModelBundle) -> None:
    no_users = Observation(vector=np.zeros((0, 12), np.float32), image=None, type=np.zeros(0, np.int8))
    acceleration, yaw_rate = bundle.motion(no_users, np.zeros(0, np.int64))
    assert acceleration.shape == yaw_rate.shape == (0,)


def test_what_never_varied_in_training_has_no_say(bundle: ModelBundle, seen: Observation) -> None:
    vector, kind = tensors(seen)
    bundle.displacement.networks.scale[:, 7] = 0.0
    other = vector.clone()
    other[:, 7] += 1e3
    before, after = (bundle.displacement.motion_all(x, kind) for x in (vector, other))
    torch.testing.assert_close(before, after, rtol=0, atol=0)


def test_motion_is_the_same_where_nothing_is_learned(bundle: ModelBundle, seen: Observation) -> None:
    # Without gradients tanh is numpy's.
    vector, kind = tensors(seen)
    models, mode = bundle.displacement, torch.arange(len(kind)) % bundle.config.modes
    learning = *models.motion(vector, kind, mode), models.networks.forward_all(vector, kind)
    with torch.inference_mode():
        running = *models.motion(vector, kind, mode), models.networks.forward_all(vector, kind)
    for a, b in zip(learning, running, strict=True):
        torch.testing.assert_close(a, b.clone(), rtol=1e-4, atol=1e-5)


def test_no_road_users_have_no_motions(bundle: ModelBundle) -> None:
    acceleration, yaw_rate = bundle.displacement.motion_all(torch.zeros(0, 12), torch.zeros(0, dtype=torch.int64))
    assert acceleration.shape == yaw_rate.shape == (0, bundle.config.modes)
