"""Shapes of the policy of a selector, the parts of the observation that it reads, and their scales."""

from dataclasses import dataclass
from functools import cache

from slrl_sumo.models.motion_models import MODES
from slrl_sumo.perception.features import FEATURES, STATES
from slrl_sumo.perception.presets import PRESETS
from slrl_sumo.perception.route_features import PATH_FEATURES, ROUTE_FEATURES

ROLLOUT_SCALES = {"collision": 2.0, "off_surface": 1.0, "speed": 0.2, "turn": 1.0}
"""Fields of the mode rollouts that a policy reads, and the factors that scale them to order 1."""
ROUTE_FIT_SCALES = {
    "heading_error": 4.0,
    "lateral_offset": 0.5,
    "speed_error": 2.0,
    "stop_ratio": 1.0,
    "follow_ratio": 1.0,
}
"""The same for the fit of each mode to the route, in the preset `extended`."""
MOTION_SCALES = (0.1, 0.3, 1.0, 1.0, 1.0)
"""The same for the columns of the vector before the heading."""
COUNT_SCALE = 0.5
"""The same for the logarithms of the counts of road users."""
HISTORY_SCALES = {"yaw_rate": 2.0, "speed_": 0.1, "near_": 1.0}
"""The same for the columns of the state `history` after the columns of the paper, by the prefixes of their names."""
MPS_SCALE = 0.2
"""The same for relative velocities."""


@dataclass(frozen=True)
class PolicyConfig:
    """Shapes of a policy, and the parts of the observation that it reads."""

    preset: str = "paper"
    """One of perception.presets.PRESETS."""
    modes: int = MODES
    channels: tuple[int, ...] = (16, 32, 32)
    """Channels of the convolutions, each with stride 2: each leaves a quarter of the pixels."""
    hidden: int = 128
    head: int = 64
    lookahead: bool = True
    """Whether the policy also reads the mode rollouts, if its preset has them."""
    image: bool = True
    """Whether the policy reads the image."""
    prior_logits: bool = True
    """Whether the prior's log probabilities are added to the policy's logits. They slow road users with a route: on an
    empty road, the prior expects a car to keep its speed, not to accelerate."""

    @property
    def looks_ahead(self) -> bool:
        """Whether the policy reads the mode rollouts."""
        return self.lookahead and PRESETS[self.preset].looks_ahead

    @property
    def rollout_features(self) -> tuple[str, ...]:
        """Names of the fields of the mode rollouts that the policy reads, in the order of its inputs."""
        return (*ROLLOUT_SCALES, *(ROUTE_FIT_SCALES if self.preset == "extended" else ()))

    @property
    def vector_columns(self) -> tuple[str, ...]:
        """Names of the columns of Observation.vector for the policy, including the heading, which is not read."""
        return STATES[PRESETS[self.preset].state]

    @property
    def route_columns(self) -> int:
        """Number of columns of Observation.route that the policy reads."""
        preset = PRESETS[self.preset]
        return len(ROUTE_FEATURES) * preset.knows_route + len(PATH_FEATURES) * preset.path

    @property
    def inputs(self) -> int:
        """Inputs of the trunk without those of the image."""
        return len(self.vector_columns) - 1 + self.route_columns

    @property
    def scorer_inputs(self) -> int:
        """Inputs of the scorers: the rollouts and products of theirs."""
        return len(self.rollout_features) + (4 if self.preset == "extended" else 2)

    @property
    def scorer_hidden(self) -> int:
        """Outputs of the first layer of the scorers."""
        return 64 if self.preset == "extended" else 32


@cache
def history_scales(columns: tuple[str, ...]) -> tuple[float, ...]:
    """Factors that bring the `columns` of a vector after those of the paper to order 1."""
    return tuple(
        MPS_SCALE
        if name.endswith("_mps")
        else next(scale for begin, scale in HISTORY_SCALES.items() if name.startswith(begin))
        for name in columns[len(FEATURES) :]
    )
