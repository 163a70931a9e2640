"""The report of a run: collects what happens while it goes on, then writes pictures and a page."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from slrl_sumo.formats.output_files import writing
from slrl_sumo.formats.trajectories import Trajectories, TrajectoryBuilder
from slrl_sumo.ground.surfaces import SurfaceShapes
from slrl_sumo.metrics.conflicts import Conflicts, pet_conflicts, ttc_conflicts
from slrl_sumo.metrics.distributions import Kinematics, kinematics
from slrl_sumo.metrics.realism import Realism, realism
from slrl_sumo.report.conflict_figures import draw_conflicts
from slrl_sumo.report.map_figures import draw_density, draw_paths, draw_space_time
from slrl_sumo.report.mode_figures import draw_modes, draw_views
from slrl_sumo.report.motion_figures import draw_motion
from slrl_sumo.scene.state import WorldState
from slrl_sumo.scene.types import TYPE_NAMES
from slrl_sumo.simulation.events import Decision, Event, Started, Views
from slrl_sumo.simulation.record import jumped

MOST_ROWS = 1_000_000
"""Positions after which no more are collected, so that the report of a long run has bounded costs."""
LEARNED, BACKGROUND = "+", "-"
"""What is put before the ids of tracks: who is taken over, or handed back, goes on in a new track."""


@dataclass(frozen=True, eq=False)
class Traced:
    """What is known of a run when it is over."""

    started: Started
    tracks: Trajectories
    """Everybody, every 0.4 s; ids begin with LEARNED or BACKGROUND."""
    learned: NDArray[np.bool_]
    """Which tracks are those of learned road users, (T,)."""
    modes: NDArray[np.int64] | None
    """How often each type chose each mode, (3, modes); None where the driver knows no modes."""
    views: tuple[Views, ...]
    cut: bool
    """Whether the run was longer than what is in `tracks`."""

    @property
    def seconds(self) -> float:
        """How long `tracks` are."""
        return max(len(self.tracks.frames) - 1, 0) * self.tracks.dt


@dataclass(frozen=True, eq=False)
class Compared:
    """Who the learned road users are measured against."""

    name: str
    motion: Kinematics
    realism: dict[str, Realism]
    """By type name; empty where the two have no type in common."""


class ReportBuilder:
    """Collects what the report needs while a run goes on, then writes it.

    `recording`: trajectories that the learned road users are compared with; None: SUMO's own in the same run.
    """

    def __init__(self, started: Started, recording: Trajectories | None = None) -> None:
        self._started, self._recording = started, recording
        self._builder = TrajectoryBuilder(source=f"run of {started.scenario}")
        self._before: WorldState | None = None
        self._rows = 0
        self._modes: NDArray[np.int64] | None = None
        if started.mode_centres is not None:
            self._modes = np.zeros(started.mode_centres.shape[:2], np.int64)
        self._views: list[Views] = []
        self._cut = False
        self._extend(started.step.world, ())

    def add(self, event: Event) -> None:
        """Take a decision, or images of what some road users see."""
        if isinstance(event, Views):
            self._views.append(event)
        elif isinstance(event, Decision):
            world = event.steps[-1].world
            wrapped = [world.ids[row] for row in np.flatnonzero(event.wrapped_around)]
            self._extend(world, wrapped)
            if event.modes is not None and self._modes is not None:
                np.add.at(self._modes, (world.type[: len(event.modes)].astype(np.intp), event.modes), 1)

    def _extend(self, world: WorldState, wrapped: "list[str] | tuple[str, ...]") -> None:
        self._rows += len(world)
        if self._rows > MOST_ROWS:
            self._cut = True
            return
        marks = [LEARNED if learned else BACKGROUND for learned in world.learned.tolist()]
        marked = replace(world, ids=tuple([mark + name for mark, name in zip(marks, world.ids, strict=True)]))
        # A jump to the other side is not a way that somebody went.
        anew = {LEARNED + name for name in wrapped}
        if self._before is not None:
            anew.update(jumped(self._before, marked))
        self._builder.append(marked, anew)
        self._before = marked

    def build(self) -> Traced:
        """What was collected."""
        tracks = self._builder.build()
        learned = np.array([name.startswith(LEARNED) for name in tracks.ids], np.bool_)
        return Traced(self._started, tracks, learned, self._modes, tuple(self._views), self._cut)

    def write(self, folder: Path, summary: dict[str, Any]) -> None:
        """Write report.html and its pictures into `folder`, which is created; `summary`: that of `run --summary`."""
        from slrl_sumo.report.page import page

        traced = self.build()
        ttc, pet = (find(traced.tracks).with_vehicles(traced.tracks) for find in (ttc_conflicts, pet_conflicts))
        compared = compare_with(traced, self._recording)
        ours = kinematics(traced.tracks, traced.learned)
        pictures: dict[str, Figure] = {"paths": draw_paths(traced.started, traced.tracks, traced.learned)}
        if any(len(values) for values in ours["speed"]):
            pictures["motion"] = draw_motion(ours, compared.motion, compared.name)
        if len(traced.tracks.frames) > 1:
            pictures["density"] = draw_density(traced.started.surfaces, traced.tracks)
        if (space_time := draw_space_time(traced.tracks, traced.learned, traced.started.surfaces)) is not None:
            pictures["space_time"] = space_time
        pictures["conflicts"] = draw_conflicts(ttc, pet, traced.tracks, traced.learned, traced.started.surfaces)
        if traced.modes is not None and traced.modes.any() and traced.started.mode_centres is not None:
            pictures["modes"] = draw_modes(traced.modes, traced.started.mode_centres)
        if traced.views:
            pictures["ego_images"] = draw_views(traced.views)
        with writing(folder):
            folder.mkdir(exist_ok=True)
            for name, figure in pictures.items():
                figure.savefig(folder / f"{name}.png", dpi=110)
            text = page(traced, summary, compared, ours, {"ttc": ttc, "pet": pet}, tuple(pictures))
            (folder / "report.html").write_text(text, encoding="utf-8")


def compare_with(traced: Traced, recording: Trajectories | None) -> Compared:
    """What the learned road users are measured against: a recording, or SUMO's own road users in the same run.

    A recording is somewhere else, so that the map features are left out.
    """
    tracks, learned = traced.tracks, traced.learned
    if recording is not None:
        scores = realism(simulated=tracks, reference=recording, tracks=learned)
        return Compared(recording.source or "the recording", kinematics(recording), scores)
    shapes: SurfaceShapes = traced.started.surfaces
    scores = realism(simulated=tracks, reference=tracks, tracks=learned, reference_tracks=~learned, shapes=shapes)
    return Compared("SUMO's own in this run", kinematics(tracks, ~learned), scores)


def counts_by_party(
    found: Conflicts, tracks: Trajectories, learned: NDArray[np.bool_]
) -> dict[tuple[str, str], dict[str, int]]:
    """Encounters by pair of types and by who they are: `learned`, `mixed`, `background`; only pairs that there are."""
    counts: dict[tuple[str, str], dict[str, int]] = {}
    for a, b in zip(found.a.tolist(), found.b.tolist(), strict=True):
        first, second = sorted((int(tracks.type[a]), int(tracks.type[b])))
        pair = TYPE_NAMES[first], TYPE_NAMES[second]
        party = ("background", "mixed", "learned")[int(learned[a]) + int(learned[b])]
        counts.setdefault(pair, dict.fromkeys(("learned", "mixed", "background"), 0))[party] += 1
    return dict(sorted(counts.items()))
