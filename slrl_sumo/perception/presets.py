"""Presets: the inputs of selectors."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Preset:
    """The inputs that a selector of this preset may read."""

    knows_route: bool
    """Whether the selector reads `Observation.route`, and images and rollouts with the route."""
    looks_ahead: bool = True
    """Whether the selector may read the mode rollouts."""
    state: str = "paper"
    """The vector that the selector reads, one of `features.STATES`."""
    path: bool = False
    """Whether `Observation.route` also has the points of the path ahead (`route_features.PATH_FEATURES`)."""


PRESETS = {
    "paper": Preset(knows_route=False),
    "image": Preset(knows_route=True, looks_ahead=False, state="history", path=True),
    "extended": Preset(knows_route=True),
}
"""Presets by name. `paper`: image and 12 numbers. `image`: image, the motion of the last 2 s, the nearest road users,
and the route as numbers and as a path, without rollouts. `extended`: the route as numbers, and the mode rollouts along
the route."""


def vector_for(models: str, preset: str) -> str:
    """The vector (one of `features.STATES`) that contains the inputs of models of the preset `models` and a
    selector."""
    return "history" if "history" in (models, PRESETS[preset].state) else "paper"
