"""Events of a run: plain values that can cross a process border. Needs neither SUMO nor PyTorch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.formats.signal_states import SignalState
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.scene.state import WorldState

LEFT_SURFACE = 1.0
"""Distance (m) off its own surfaces from which a road user has left them."""
MOST_DECISIONS = 216_000
"""Greatest number of decisions (24 h) of a run in a scenario without an end whose road users do not leave."""


@dataclass(frozen=True)
class Step:
    """All road users after a SUMO step, the learned road users first, as in the trace."""

    time: float
    """Time (s) of this step in SUMO's FCD output."""
    world: WorldState
    places: Places


@dataclass(frozen=True)
class Started:
    """Data of a run that are known when all road users are at their starting places."""

    scenario: str
    bundle: str
    selector: str
    begin: float
    """Begin of the simulation, s."""
    step_length: float
    """SUMO's step, s."""
    decisions: int | None
    """Number of decisions; None: until the scenario's road users have left, at most MOST_DECISIONS."""
    notices: tuple[str, ...]
    """Changes of the scenario and choices by default, one line each."""
    surfaces: SurfaceShapes
    """The ground; without shapes from another process, unless requested."""
    step: Step
    """All road users at the start."""
    mode_centres: NDArray[np.float64] | None = None
    """Centre of the cluster of each mode, (3, modes, 2), see ModelBundle; None if the selector has no modes."""
    modes_by: str = ""
    """The quantity that is clustered into modes, as in the bundle's training record."""
    signals: tuple[SignalState, ...] = ()
    """States of all traffic lights in `step`."""
    compiling: str = ""
    """Message if the first decisions will compile the inner loops; else empty."""


@dataclass(frozen=True)
class Views:
    """Ego images (k, 20, 40, 3) of the learned road users `ids` at `time` (s)."""

    time: float
    ids: tuple[str, ...]
    images: NDArray[np.uint8]


@dataclass(frozen=True)
class Decision:
    """A decision interval of n learned road users, the first n rows of the worlds of its steps."""

    steps: tuple[Step, ...]
    """SUMO steps of the interval; the last step is the initial state of the next decision."""
    modes: NDArray[np.int64] | None
    """Mode of each learned road user, (n,); None if the selector has no modes."""
    constraints: dict[str, int]
    """Number of decisions that each constraint has changed, by name (agent.constraints)."""
    surface: NDArray[np.uint8]
    """Surface under each learned road user at the end, (n,)."""
    left_surface: NDArray[np.bool_]
    """Whether each learned road user was more than LEFT_SURFACE off its own surfaces at the end, (n,)."""
    wrapped_around: NDArray[np.bool_]
    """Whether each learned road user left the scene and was reinserted on the other side, (n,)."""
    lost: NDArray[np.bool_]
    """Whether SUMO removed each learned road user before its arrival, (n,). Spawned road users are added again."""
    arrived: tuple[str, ...]
    """Road users of the scenario that reached their destination while learned, or after they were handed back."""
    under_way: int
    """Number of road users in the network at the end that are learned, or were learned and then handed back."""
    taken_over: tuple[str, ...]
    """Road users of the scenario that are learned from the end of this interval on; in the first decision also road
    users that are learned from its begin on."""
    handed_back: tuple[str, ...]
    """Road users that SUMO moves again from the end of this interval on."""
    returned_to_route: tuple[str, ...]
    """Road users handed back because they had left their route or the scene; SUMO put them back on their route."""
    interventions: int
    """Number of times that a background road user began to be held for a learned road user."""
    left_to_sumo: tuple[tuple[str, str], ...] = ()
    """Road users of the scenario that match the takeover but cannot be taken over, with the reason. Each road user
    appears once, and again if the reason changes."""
    refused: tuple[tuple[str, str], ...] = ()
    """Road users, mostly learned, that could not be moved, with the reason: from then on SUMO moves them; spawned road
    users are removed."""

    signals: tuple[SignalState, ...] = ()
    """States of traffic lights in the last step that differ from the end of the previous decision."""


Event = Started | Decision | Views
