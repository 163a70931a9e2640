"""The report of a run: figures and a page."""

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from slrl_sumo.formats.output_files import writing
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.metrics.conflicts import pet_conflicts, ttc_conflicts
from slrl_sumo.metrics.distributions import kinematics
from slrl_sumo.metrics.queues import find_queues
from slrl_sumo.report.conflict_figures import draw_conflicts
from slrl_sumo.report.map_figures import draw_density, draw_paths, draw_space_time
from slrl_sumo.report.mode_figures import draw_modes, draw_views
from slrl_sumo.report.motion_figures import draw_motion
from slrl_sumo.report.page import page
from slrl_sumo.report.queue_figures import draw_queues
from slrl_sumo.report.recorder import RunRecord
from slrl_sumo.report.reference import reference_for


def write_report(
    record: RunRecord, folder: Path, summary: dict[str, Any], recording: Trajectories | None = None
) -> None:
    """Write report.html and its figures into `folder`, which is created.

    `summary`: as `run --summary` writes it. `recording`: trajectories to compare the learned road users with; None:
    SUMO's own road users in the same run. Raises InputError where the folder cannot be written.
    """
    tracks, learned, surfaces = record.tracks, record.tracks.learned, record.started.surfaces
    ttc, pet = (find(tracks).with_vehicles(tracks) for find in (ttc_conflicts, pet_conflicts))
    reference = reference_for(record, recording)
    ours = kinematics(tracks, learned)
    figures: dict[str, Figure] = {"paths": draw_paths(record.started, tracks, learned)}
    if any(len(values) for values in ours["speed"]):
        figures["motion"] = draw_motion(ours, reference.motion, reference.name)
    if len(tracks.frames) > 1:
        figures["density"] = draw_density(surfaces, tracks)
    if (space_time := draw_space_time(tracks, learned, surfaces)) is not None:
        figures["space_time"] = space_time
    queues = find_queues(tracks)
    if queues:
        figures["queues"] = draw_queues(queues, surfaces)
    if len(ttc) or len(pet):
        figures["conflicts"] = draw_conflicts(ttc, pet, tracks, learned, surfaces)
    if record.modes is not None and record.modes.any() and record.started.mode_centres is not None:
        figures["modes"] = draw_modes(record.modes, record.started.mode_centres)
    if record.views:
        figures["ego_images"] = draw_views(record.views)
    with writing(folder):
        folder.mkdir(exist_ok=True)
        for name, figure in figures.items():
            figure.savefig(folder / f"{name}.png", dpi=110)
        text = page(record, summary, reference, ours, {"ttc": ttc, "pet": pet}, queues, tuple(figures))
        (folder / "report.html").write_text(text, encoding="utf-8")
