"""Weights of a trained policy for unknown or expected routes, calibrated on recordings.

A policy of the preset `extended` learns in simulations, in which each road user has a route. Without a route, as in
recordings, its scorers rate mode rollouts as if all modes fitted the route equally, and make standing cars start.
Recordings show, by type, how much heads and scorers raise the likelihood of the recorded modes; with known lanes, also
on expected routes along these lanes (slrl_sumo.routing.expected_routes).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from slrl_sumo.agent.decide import Agent, consider
from slrl_sumo.agent.selection import GivenModes
from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.mask import everywhere_road
from slrl_sumo.learning.rl.selector_card import WITHOUT_ROUTE, shares_without_route
from slrl_sumo.learning.supervised.goals import HORIZONS, modes_of, trained_ranges
from slrl_sumo.learning.supervised.windows import FUTURE, windows
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.threads import one_thread
from slrl_sumo.perception.past_motion import recorded_past
from slrl_sumo.perception.scene import Scene
from slrl_sumo.routing.expected_routes import ExpectedRoutes, routes_ahead
from slrl_sumo.scene.types import RoadUserType

STRIDE = 2
"""Stride of the used frames of the recordings: 0.8 s."""
SHARE_PENALTY = 10.0
"""Penalty (nats) of the squared shares: for a type with few windows, the shares stay near 0, the prior."""
ROUNDS = 200
CHANCE = 10.0
"""Least gain (nats) of the log likelihood by the shares, otherwise they are 0: two numbers gain this much by chance,
because successive windows of a road user are nearly equal."""
WORTH = 0.01
"""Least gain (nats per window), in addition: 0.005 in SUMO's traffic raised the mean error of cars in other recordings
by 3 %."""


def calibrated(
    bundle: ModelBundle, recordings: Sequence[Trajectories], routes: Sequence[ExpectedRoutes] = ()
) -> ModelBundle:
    """The bundle with a policy that is weighted for unknown routes, and for expected `routes`, from recordings.

    The shares, from 0 to 1 by type for heads and scorers, maximise the likelihood of the recorded modes under
    prior + share x correction. The prior was trained on these recordings, so that the shares are too small rather than
    too large. `routes`: expected routes on the lanes of each recording; without these, the policy has no weight on
    expected routes. Raises InputError if the bundle has no policy of the preset `extended`.
    """
    if bundle.policy is None or not bundle.policy.config.route_columns:
        raise InputError(f"bundle {bundle.name}: it has no trained selector that reads routes")
    policy = Policy(bundle.policy.config)
    policy.load_state_dict(bundle.policy.state_dict())
    names = ", ".join(dict.fromkeys(recording.source for recording in recordings))
    training = {**(bundle.policy_training or {}), "without_route_from": names}
    training.pop("expected_route", None)
    with one_thread():
        training["without_route"] = _shares_by_type([_parts(bundle, policy, one) for one in recordings])
        if routes:
            each = zip(recordings, routes, strict=True)
            training["expected_route"] = _shares_by_type([_parts(bundle, policy, *one) for one in each])
    policy.without_route.copy_(torch.tensor(training["without_route"]))
    card = bundle.card.split(WITHOUT_ROUTE)[0] + shares_without_route(training)
    policy.requires_grad_(False).eval()
    return replace(bundle, policy=policy, policy_training=training, card=card)


def _shares_by_type(parts: Sequence[tuple[Tensor, ...]]) -> list[list[float]]:
    """The shares of heads and scorers of each type, from the parts of all recordings."""
    kind, mode, known, heads, scorers = (torch.cat(some) for some in zip(*parts, strict=True))
    found = torch.zeros(len(RoadUserType), 2)
    for t in RoadUserType:
        mine = kind == t
        if mine.any():
            found[t] = shares(known[mine], torch.stack([heads[mine], scorers[mine]]), mode[mine])
    rounded: list[list[float]] = np.round(found.numpy().astype(np.float64), 3).tolist()
    return rounded


def shares(known: Tensor, corrections: Tensor, mode: Tensor) -> Tensor:
    """Shares (2,) of the `corrections` (2, n, modes) that maximise the likelihood of the modes (n,).

    `known`: log probabilities of the prior, (n, modes). The shares are 0 if they hardly raise the likelihood.
    """
    share = torch.full((2,), 0.1, requires_grad=True)
    optimizer = torch.optim.Adam([share], lr=0.02)
    for _ in range(ROUNDS):
        logits = known + (share[:, None, None] * corrections).sum(0)
        loss = cross_entropy(logits, mode, reduction="sum") + SHARE_PENALTY * share.square().sum()
        optimizer.zero_grad()
        torch.autograd.backward(loss)
        optimizer.step()
        with torch.no_grad():
            share.clamp_(0.0, 1.0)
    with torch.no_grad():
        logits = known + (share[:, None, None] * corrections).sum(0)
        alone, corrected = (float(cross_entropy(values, mode, reduction="sum")) for values in (known, logits))
    worth = alone - corrected > max(CHANCE, WORTH * len(mode))
    return share.detach() if worth else torch.zeros(2)


def _parts(
    bundle: ModelBundle, policy: Policy, recording: Trajectories, routes: ExpectedRoutes | None = None
) -> tuple[Tensor, ...]:
    """Type, recorded mode, log probabilities of the prior, and logits of heads and scorers of all windows.

    With `routes`, only of windows on an expected route.
    """
    modes_by = str(bundle.training.get("modes_by", "kmeans"))
    every = windows([recording], STRIDE, bundle.config.preset, max(HORIZONS.get(modes_by, FUTURE), FUTURE))
    every = every.take(bundle.types[every.type])
    mode = modes_of(every, modes_by, bundle.mode_centres, trained_ranges(bundle.training))
    ground, agent = everywhere_road(recording.x, recording.y), Agent(bundle, GivenModes(policy.config.preset))
    found: list[tuple[Tensor, ...]] = []
    for frame in np.unique(every.frame).tolist():
        here = np.flatnonzero(every.frame == frame)
        rows = recording.rows_at(frame)
        place = np.searchsorted(recording.track[rows], every.track[here])
        scene = Scene(recording.world(frame), place, ground, past=recorded_past(recording, rows))
        if routes is not None:
            expected = routes.of(recording, rows)
            on = np.array([expected[k] is not None for k in place.tolist()], np.bool_)
            if not on.any():
                continue
            here = here[on]
            scene = replace(scene, rows=place[on], route=routes_ahead(expected, scene.world))
        situation = consider(scene, agent, last_look=True)
        observation, rollouts = situation.observation, situation.rollouts
        assert observation.image is not None
        assert rollouts is not None
        vector, kind = torch.from_numpy(observation.vector), torch.from_numpy(observation.type).long()
        ahead = torch.from_numpy(rollouts.columns(policy.config.rollout_features))
        route = torch.zeros(len(here), policy.config.route_columns)
        if observation.route is not None:
            route = torch.from_numpy(observation.route)
        with torch.inference_mode():
            corrections = policy.parts(vector, torch.from_numpy(observation.image), kind, ahead, route)
            known = torch.log_softmax(bundle.prior.logits(vector, kind), -1)
        found.append((kind, torch.from_numpy(mode[here]), known, *corrections))
    if not found:
        nothing = torch.zeros(0, dtype=torch.long)
        return nothing, nothing, *torch.zeros(3, 0, policy.config.modes)
    return tuple(torch.cat(some).clone() for some in zip(*found, strict=True))
