"""What a run is told, and what it tells: plain values that can cross a process border. No simulator, no torch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.scene.state import WorldState

DEFAULT_BUNDLE = "intersection"


@dataclass(frozen=True)
class RunSettings:
    """What to run; the words are those of `slrl-sumo run`."""

    scenario: str
    agents: int | None = None
    """Learned road users to spawn; None spawns nobody."""
    mix: str | None = None
    takeover: str | None = None
    """Shares of the scenario's own road users that become learned, as 'car=0.3,pedestrian=1'."""
    region: str | None = None
    """Where they are learned; None is everywhere."""
    bundle: str = DEFAULT_BUNDLE
    selector: str | None = None
    """None is the bundle's usual one: greedy where it has a trained selector, else prior."""
    guard: bool = False
    """Modes that lead into a conflict are not chosen (see agent.guard)."""
    steps: int | None = None
    """Decisions; None runs until `until`, else until the scenario's own end."""
    until: float | None = None
    """Simulation time in s."""
    seed: int = 1
    step_length: float | None = None
    yielding: bool = True
    """Background vehicles brake for learned road users."""
    sumo_outputs: bool = False
    sumo_options: str = ""
    """Options for SUMO itself, as on its command line."""


@dataclass(frozen=True)
class Step:
    """All road users after one SUMO step, the learned ones first: what goes into the trace."""

    time: float
    """s; the time that SUMO's own FCD output gives to this step."""
    world: WorldState
    places: Places


@dataclass(frozen=True)
class Started:
    """What is known when everybody stands at the start."""

    scenario: str
    bundle: str
    selector: str
    begin: float
    """s."""
    step_length: float
    """SUMO's step, s."""
    decisions: int
    """How many will be taken."""
    notices: tuple[str, ...]
    """What was changed in the scenario, or decided for the user; one line each."""
    surfaces: SurfaceShapes
    """The ground; from another process only where it was asked for."""
    step: Step
    """Everybody at the start."""
    mode_centres: NDArray[np.float64] | None = None
    """Where each mode leads to in 4.8 s, in the ego frame, m, (3, modes, 2); None where the driver knows no modes."""
    compiling: str = ""
    """What to say where the inner loops are yet to be compiled, during the first decisions."""


@dataclass(frozen=True)
class Views:
    """What some learned road users see: images (k, 20, 40, 3) of the road users `ids` at `time` (s)."""

    time: float
    ids: tuple[str, ...]
    images: NDArray[np.uint8]


@dataclass(frozen=True)
class Decision:
    """One decision interval of the n road users that were learned in it: the first n rows of its steps' worlds."""

    steps: tuple[Step, ...]
    """Its SUMO steps; the last one is the state that the next decision starts from."""
    modes: NDArray[np.int64] | None
    """Mode of each learned road user, (n,); None where the driver knows no modes."""
    constraints: dict[str, int]
    """How many of these decisions each rule that is not learned has changed, by its name (agent.constraints)."""
    surface: NDArray[np.uint8]
    """Surface under each learned road user at the end, (n,)."""
    wrapped_around: NDArray[np.bool_]
    """Who was brought back to the other side of the scene, (n,)."""
    lost: NDArray[np.bool_]
    """Who was no longer in SUMO at the end without having arrived, (n,). Spawned ones were added again."""
    arrived: tuple[str, ...]
    """Lent road users that SUMO took off the network at their destination."""
    taken_over: tuple[str, ...]
    """Road users of the scenario that are learned from the end of this interval on."""
    handed_back: tuple[str, ...]
    """Road users that are SUMO's again from the end of this interval on."""
    returned_to_route: tuple[str, ...]
    """Those of them that had left the scene, and that SUMO has put on their route again."""
    interventions: int
    """How often a background vehicle began to brake for a learned road user."""


Event = Started | Decision | Views
