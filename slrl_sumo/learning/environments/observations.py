"""Observations of the environments: the observation of a road user, its space, and users' own observations."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from slrl_sumo.agent.decide import Situation
from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.arena import ArenaSettings
from slrl_sumo.learning.own_functions import called
from slrl_sumo.models.displacement import MODES
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS
from slrl_sumo.perception.features import STATES

Arrays = dict[str, NDArray[Any]]
Seen = Arrays | NDArray[Any]
"""An observation of one road user, or of n road users as arrays of n rows."""
ObserveFunction = Callable[[Situation], Seen]
"""A user's observation function: from the situation of n road users to arrays of n rows."""

ONLY = "observation"
"""Name of the array of an observation that is not a dict."""
COUNTED = 10_000
"""Upper bound of the numbers of road users within 20 m."""
VECTOR_BOUNDS = (
    ("speed", 0.0, 100.0),
    ("acceleration", -250.0, 250.0),
    ("heading", -np.pi, np.pi),
    ("yaw_rate", -2.5 * np.pi, 2.5 * np.pi),
    ("vru_", 0.0, COUNTED),
    ("other_", 0.0, COUNTED),
    ("near_", -200.0, 200.0),
)
"""Prefixes of the names of columns of the vector, with lowest and highest values; 0 and 1 for all other columns. The
bounds allow a change of 100 m/s, and a turn by half a circle, within one decision."""
MOST_ROLLOUT, MOST_ROUTE = 100.0, 10.0
"""Bounds of the fields of mode rollouts (speeds in m/s are the largest) and of route features (tens of metres)."""


def vector_space(state: str) -> spaces.Box:
    """Space of the vector of one road user in a preset of `features.STATES`."""
    bounds = [
        next(((low, high) for begin, low, high in VECTOR_BOUNDS if name.startswith(begin)), (0.0, 1.0))
        for name in STATES[state]
    ]
    low, high = np.array(bounds, np.float32).T
    return spaces.Box(low, high)


def observation_space(settings: ArenaSettings) -> spaces.Dict:
    """Space of the observation of one road user: fields of `Observation`, and the mode rollouts of the preset."""
    config = PolicyConfig(preset=settings.preset)
    seen: dict[str, spaces.Space[Any]] = {
        "vector": vector_space(settings.state),
        "action_mask": spaces.MultiBinary(MODES),
    }
    if config.looks_ahead:
        rollouts = (MODES, len(config.rollout_features))
        seen["rollouts"] = spaces.Box(-MOST_ROLLOUT, MOST_ROLLOUT, rollouts, np.float32)
    if settings.image:
        seen["image"] = spaces.Box(0, 255, (EGO_ROWS, EGO_COLS, 3), np.uint8)
    if config.route_columns:
        seen["route"] = spaces.Box(-MOST_ROUTE, MOST_ROUTE, (config.route_columns,), np.float32)
    if settings.trips:
        seen["active"] = spaces.Box(0, 1, (), np.int8)
    return spaces.Dict(seen)


@dataclass(frozen=True, eq=False)
class OwnObservation:
    """A user's observation: the function, and the space of one road user (a Box, or a Dict of Boxes)."""

    function: ObserveFunction
    space: spaces.Space[Any]


class Observer:
    """Converts a situation to arrays of n rows: the observation of selectors, or the user's observation."""

    def __init__(self, settings: ArenaSettings, own: OwnObservation | None) -> None:
        self._own, self._image = own, settings.image
        self._config = PolicyConfig(preset=settings.preset)
        self.space: spaces.Space[Any] = observation_space(settings) if own is None else own.space
        """Space of the observation of one road user."""
        self.tells_active = settings.trips and own is None
        """Whether the observation has `active`."""

    def __call__(self, situation: Situation) -> Arrays:
        """The observation of n road users by name; a single array has the name ONLY.

        Raises InputError if the result of the user's function does not match its space.
        """
        if self._own is not None:
            return self._checked(called("observe", self._own.function, situation), len(situation.observation))
        observation, rollouts = situation.observation, situation.rollouts
        seen: Arrays = {"vector": observation.vector}
        if self._config.looks_ahead:
            assert rollouts is not None
            seen["rollouts"] = rollouts.columns(self._config.rollout_features)
        if self._image:
            assert observation.image is not None
            seen["image"] = observation.image
        if observation.route is not None:
            seen["route"] = observation.route
        return seen | {"action_mask": action_mask(situation)}

    def shown(self, arrays: Arrays) -> Seen:
        """The arrays in the form of the space."""
        return arrays if isinstance(self.space, spaces.Dict) else arrays[ONLY]

    def _checked(self, seen: Seen, n: int) -> Arrays:
        given = seen if isinstance(seen, dict) else {ONLY: seen}
        try:
            arrays = {name: np.asarray(values) for name, values in given.items()}
        except ValueError as error:
            raise InputError(f"it returned no array ({error}); return one", argument="observe") from None
        parts = dict(self.space.spaces) if isinstance(self.space, spaces.Dict) else {ONLY: self.space}
        if arrays.keys() != parts.keys():
            raise InputError(f"it returned {sorted(arrays)}; its space has {sorted(parts)}", argument="observe")
        for name, part in parts.items():
            if arrays[name].shape != (n, *(part.shape or ())):
                raise InputError(
                    f"'{name}' has the shape {arrays[name].shape}; return {(n, *(part.shape or ()))}: a row for each "
                    "road user, as in observation_space",
                    argument="observe",
                )
        try:
            return {name: values.astype(parts[name].dtype) for name, values in arrays.items()}
        except (TypeError, ValueError) as error:
            raise InputError(f"it returned no numbers ({error}); return arrays of them", argument="observe") from None


def action_mask(situation: Situation) -> NDArray[np.int8]:
    """1 for allowed modes of each road user, else 0, (n, modes)."""
    assert situation.rollouts is not None
    mask = situation.mask
    return np.ones(situation.rollouts.collision.shape, np.int8) if mask is None else mask.astype(np.int8)
