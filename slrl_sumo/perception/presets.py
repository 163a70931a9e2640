"""What selectors of each preset perceive."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Preset:
    """What a selector of this preset may read."""

    knows_route: bool
    """Whether it reads `Observation.route`, and images and rollouts with the route."""
    looks_ahead: bool = True
    """Whether it may read what each mode leads to (the mode rollouts)."""
    state: str = "paper"
    """The vector that it reads, one of `features.STATES`."""
    path: bool = False
    """Whether `Observation.route` also has the points of the path ahead (`route_features.PATH_FEATURES`)."""


PRESETS = {
    "paper": Preset(knows_route=False),
    "image": Preset(knows_route=True, looks_ahead=False, state="history", path=True),
    "extended": Preset(knows_route=True),
}
"""By name. `paper`: image and 12 numbers. `image`: what a network can learn to see: image, the motion of the last 2 s,
the nearest road users, and the route as numbers and as a path. `extended`: the route as numbers, and what each mode
leads to along it."""


def vector_for(models: str, preset: str) -> str:
    """The vector (one of `features.STATES`) that holds what models of the preset `models` and a selector read."""
    return "history" if "history" in (models, PRESETS[preset].state) else "paper"
