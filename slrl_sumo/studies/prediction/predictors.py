"""How the road users of rollouts move: constant velocity, the best mode in hindsight, prior and policy of a bundle."""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from slrl_sumo.agent.selectors import HOLD, Modes, central, drawn
from slrl_sumo.errors import InputError
from slrl_sumo.ground.road_map import RoadMap
from slrl_sumo.lookahead.lookahead import with_ahead
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.models.policy import policy_logits
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS, ego_images
from slrl_sumo.perception.features import features
from slrl_sumo.perception.observation import Observation
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.studies.prediction.rollout import Moment, Motion, Move


def constant_velocity(moment: Moment) -> Motion:
    """Everybody keeps speed and heading."""
    still = np.zeros(len(moment.rows))
    return still, still, np.full(len(moment.rows), np.inf)


def oracle(bundle: ModelBundle) -> Move:
    """At each step the mode whose displacement comes nearest to the true position: the floor that the modes allow."""

    def move(moment: Moment) -> Motion:
        vector, kind = _seen(moment)
        with torch.inference_mode():
            acceleration, yaw_rate = (z.double().numpy() for z in bundle.displacement.motion_all(vector, kind))
        top = bundle.max_speed[kind.numpy()]
        world, rows = moment.world, moment.rows
        # As `advance` moves them.
        speed = np.clip(world.speed[rows, None] + acceleration * DECISION_INTERVAL, 0.0, top[:, None])
        middle = world.heading[rows, None] + 0.5 * yaw_rate * DECISION_INTERVAL
        x = world.x[rows, None] + speed * DECISION_INTERVAL * np.cos(middle)
        y = world.y[rows, None] + speed * DECISION_INTERVAL * np.sin(middle)
        best = np.hypot(x - moment.next_x[:, None], y - moment.next_y[:, None]).argmin(1)[:, None]
        return np.take_along_axis(acceleration, best, 1)[:, 0], np.take_along_axis(yaw_rate, best, 1)[:, 0], top

    return move


def prior_central(bundle: ModelBundle) -> Move:
    """The prior's one prediction: at each step its most central mode (see slrl_sumo.agent.selectors.central)."""

    def move(moment: Moment) -> Motion:
        vector, kind = _seen(moment)
        with torch.inference_mode():
            probability = torch.softmax(bundle.prior.logits(vector, kind).double(), -1)
            return _motion(bundle, vector, kind, central(bundle, probability, kind))

    return move


def prior_sampled(bundle: ModelBundle, draws: Floats) -> Move:
    """Modes drawn from the prior and held as in a run (see PriorSelector).

    `draws` (U, steps, 2) from [0, 1), by member of the cast and step: which mode, and whether to keep the old one.
    """
    held: Modes = np.zeros(len(draws), np.int64)
    chose = np.zeros(len(draws), np.bool_)

    def move(moment: Moment) -> Motion:
        vector, kind = _seen(moment)
        draw, again = draws[moment.users, moment.step].T
        with torch.inference_mode():
            probability = torch.softmax(bundle.prior.logits(vector, kind).double(), -1).numpy()
            keeps = chose[moment.users] & (again >= 1 / HOLD)
            modes = np.where(keeps, held[moment.users], drawn(probability, draw))
            held[moment.users], chose[moment.users] = modes, True
            return _motion(bundle, vector, kind, modes)

    return move


def policy_chosen(bundle: ModelBundle, roadmap: RoadMap, draws: Floats | None) -> Move:
    """Modes of the trained policy, which looks at the ground, as in a run (see PolicySelector).

    `draws` (U, steps) from [0, 1) by member of the cast and step; without, the most probable mode is taken.
    Raises InputError where the bundle has no policy.
    """
    if bundle.policy is None:
        raise InputError(f"bundle {bundle.name} has no trained selector; leave greedy and sampled out of --selectors")
    policy = bundle.policy

    def move(moment: Moment) -> Motion:
        vector, kind = _seen(moment)
        images = torch.from_numpy(_images(moment, roadmap))
        with torch.inference_mode():
            ahead = torch.from_numpy(_ahead(moment, roadmap, bundle)) if policy.config.lookahead else None
            logits = policy_logits(policy, bundle.prior, vector, images, kind, ahead)[0].double().numpy()
            modes = logits.argmax(-1) if draws is None else drawn(np.exp(logits), draws[moment.users, moment.step])
            return _motion(bundle, vector, kind, modes)

    return move


def _images(moment: Moment, roadmap: RoadMap) -> NDArray[np.uint8]:
    """The ego images of those to be moved, with those of their own scene only."""
    images = np.zeros((len(moment.rows), EGO_ROWS, EGO_COLS, 3), np.uint8)
    scene = moment.scene[moment.rows]
    for one in np.unique(scene).tolist():
        members, mine = np.flatnonzero(moment.scene == one), np.flatnonzero(scene == one)
        rows = np.searchsorted(members, moment.rows[mine])
        images[mine] = ego_images(moment.world.take(members), rows, roadmap)
    return images


def _ahead(moment: Moment, roadmap: RoadMap, bundle: ModelBundle) -> NDArray[np.float32]:
    """What each mode would lead to, for those to be moved, among those of their own scene."""
    ahead = np.zeros((len(moment.rows), bundle.config.modes, 4), np.float32)
    scene = moment.scene[moment.rows]
    vector = features(moment.world, moment.rows, moment.scene)
    for one in np.unique(scene).tolist():
        members, mine = np.flatnonzero(moment.scene == one), np.flatnonzero(scene == one)
        rows = np.searchsorted(members, moment.rows[mine])
        seen = Observation(vector[mine], None, moment.world.type[moment.rows[mine]])
        ahead[mine] = with_ahead(bundle, seen, moment.world.take(members), rows, roadmap).ahead
    return ahead


def _seen(moment: Moment) -> tuple[Tensor, Tensor]:
    """Feature vectors (m, 12) and types (m,) of those to be moved."""
    vector = features(moment.world, moment.rows, moment.scene)
    return torch.from_numpy(vector), torch.from_numpy(moment.world.type[moment.rows].astype(np.int64))


def _motion(bundle: ModelBundle, vector: Tensor, kind: Tensor, modes: Modes) -> Motion:
    acceleration, yaw_rate = bundle.displacement.motion(vector, kind, torch.from_numpy(modes))
    return acceleration.double().numpy(), yaw_rate.double().numpy(), bundle.max_speed[kind.numpy()]
