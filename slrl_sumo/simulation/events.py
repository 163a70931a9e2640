"""What happens in a run: plain values that can cross a process border. No simulator, no torch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.formats.signal_states import SignalState
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.scene.state import WorldState

LEFT_SURFACE = 1.0
"""m off its own surface from which on a road user has left it."""
MOST_DECISIONS = 216_000
"""Decisions (24 h) of a run in a scenario without an end whose road users do not leave."""


@dataclass(frozen=True)
class Step:
    """All road users after one SUMO step, the learned ones first: what goes into the trace."""

    time: float
    """s; the time that SUMO's own FCD output gives to this step."""
    world: WorldState
    places: Places


@dataclass(frozen=True)
class Started:
    """What is known when all road users are at their starting places."""

    scenario: str
    bundle: str
    selector: str
    begin: float
    """s."""
    step_length: float
    """SUMO's step, s."""
    decisions: int | None
    """How many decisions will be taken; None: until the scenario's road users have left, at most MOST_DECISIONS."""
    notices: tuple[str, ...]
    """What was changed in the scenario, or chosen by default; one line each."""
    surfaces: SurfaceShapes
    """The ground; from another process only on request."""
    step: Step
    """All road users at the start."""
    mode_centres: NDArray[np.float64] | None = None
    """Mean of what each mode is a cluster of, (3, modes, 2), see ModelBundle; None where the selector has no modes."""
    modes_by: str = ""
    """What modes are clusters of, as in the bundle's training record."""
    signals: tuple[SignalState, ...] = ()
    """What all traffic lights show in `step`."""
    compiling: str = ""
    """Message where the inner loops are still to be compiled, during the first decisions; else empty."""


@dataclass(frozen=True)
class Views:
    """Ego images (k, 20, 40, 3) of the learned road users `ids` at `time` (s)."""

    time: float
    ids: tuple[str, ...]
    images: NDArray[np.uint8]


@dataclass(frozen=True)
class Decision:
    """One decision interval of the n road users that were learned in it: the first n rows of its steps' worlds."""

    steps: tuple[Step, ...]
    """Its SUMO steps; the last one is the state that the next decision starts from."""
    modes: NDArray[np.int64] | None
    """Mode of each learned road user, (n,); None where the selector has no modes."""
    constraints: dict[str, int]
    """How many of these decisions each rule that is not learned has changed, by its name (agent.constraints)."""
    surface: NDArray[np.uint8]
    """Surface under each learned road user at the end, (n,)."""
    left_surface: NDArray[np.bool_]
    """Which learned road users were more than LEFT_SURFACE off their own surface at the end, (n,)."""
    wrapped_around: NDArray[np.bool_]
    """Learned road users that left the scene and were reinserted on its other side, (n,)."""
    lost: NDArray[np.bool_]
    """Learned road users that SUMO had removed at the end although they had not arrived, (n,). Spawned ones were added
    again."""
    arrived: tuple[str, ...]
    """Road users of the scenario that reached their destination while learned, or after they were handed back."""
    under_way: int
    """Road users that are learned, or were before they were handed back, and that are in the network at the end."""
    taken_over: tuple[str, ...]
    """Road users of the scenario that are learned from the end of this interval on; in the first decision also those
    that have been learned from its beginning on."""
    handed_back: tuple[str, ...]
    """Road users that SUMO moves again from the end of this interval on."""
    returned_to_route: tuple[str, ...]
    """Those handed back because they had left their route or the scene; SUMO put them on their route again."""
    interventions: int
    """How often a background vehicle began to brake for a learned road user."""
    left_to_sumo: tuple[tuple[str, str], ...] = ()
    """Road users of the scenario that a takeover would have taken from the end of this interval on, and why it cannot;
    each once, and again where the reason changes."""
    refused: tuple[tuple[str, str], ...] = ()
    """Road users, mostly learned ones, that could not be moved, and the reason: from then on SUMO moves them; spawned
    ones are removed."""

    signals: tuple[SignalState, ...] = ()
    """What traffic lights show in the last one of its steps, where that differs from the end of the decision before."""


Event = Started | Decision | Views
