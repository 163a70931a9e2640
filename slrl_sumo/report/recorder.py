"""Record of a run for its report: positions, modes and ego images, collected during the run."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.formats.signal_states import Shown, SignalState, add_state
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.formats.trajectory_builder import TrajectoryBuilder
from slrl_sumo.metrics.traffic.queues import StandingLanes
from slrl_sumo.scene.jumps import jumped
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.events import Decision, Event, Started, Views

MOST_ROWS = 1_000_000
"""Greatest number of stored positions, so that a long run has bounded costs."""


@dataclass(frozen=True, eq=False)
class RunRecord:
    """The record of a run."""

    started: Started
    tracks: Trajectories
    """All road users every 0.4 s; a road user that is taken over or handed back continues in a new track."""
    modes: NDArray[np.int64] | None
    """Number of choices of each mode by type, (3, modes); None if the selector has no modes."""
    views: tuple[Views, ...]
    cut: bool
    """Whether the run was longer than `tracks`."""
    signals: Shown
    """States of traffic lights, every 0.4 s."""
    standing: StandingLanes

    @property
    def seconds(self) -> float:
        """Length of `tracks` in s."""
        return max(len(self.tracks.frames) - 1, 0) * self.tracks.dt


class RunRecorder:
    """Collects a RunRecord during a run."""

    def __init__(self, started: Started) -> None:
        self._started = started
        self._builder = TrajectoryBuilder(source=f"run of {started.scenario}")
        self._before: WorldState | None = None
        self._rows = 0
        self._modes: NDArray[np.int64] | None = None
        if started.mode_centres is not None:
            self._modes = np.zeros(started.mode_centres.shape[:2], np.int64)
        self._views: list[Views] = []
        self._cut = False
        self._signals: Shown = {}
        self._standing = StandingLanes()
        self._show(started.step.time, started.signals)
        self._extend(started.step.world, (), None)

    def add(self, event: Event) -> None:
        """Add a decision, or ego images of some road users."""
        if isinstance(event, Views):
            self._views.append(event)
        elif isinstance(event, Decision):
            world = event.steps[-1].world
            self._show(event.steps[-1].time, event.signals)
            self._standing.add(world, event.steps[-1].places.lane)
            self._extend(world, [world.ids[row] for row in np.flatnonzero(event.wrapped_around)], event.modes)
            if event.modes is not None and self._modes is not None:
                np.add.at(self._modes, (world.type[: len(event.modes)].astype(np.intp), event.modes), 1)

    def _show(self, time: float, signals: tuple[SignalState, ...]) -> None:
        for each in signals:
            add_state(self._signals, each.signal, round(1000 * time), each.state)

    def _extend(self, world: WorldState, reinserted: Collection[str], modes: NDArray[np.int64] | None) -> None:
        self._rows += len(world)
        if self._rows > MOST_ROWS:
            self._cut = True
            return
        # A jump to the other side of the scene ends a track.
        new_tracks = set(reinserted)
        if self._before is not None:
            new_tracks.update(jumped(self._before, world))
            learned_before = dict(zip(self._before.ids, self._before.learned.tolist(), strict=True))
            now = zip(world.ids, world.learned.tolist(), strict=True)
            new_tracks.update(name for name, learned in now if learned_before.get(name, learned) != learned)
        self._builder.append(world, new_tracks, modes)
        self._before = world

    def build(self) -> RunRecord:
        """The collected record."""
        return RunRecord(
            self._started,
            self._builder.build(),
            self._modes,
            tuple(self._views),
            self._cut,
            self._signals,
            self._standing,
        )
