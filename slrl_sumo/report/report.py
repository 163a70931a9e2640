"""The report of a run: figures and a page."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from slrl_sumo.formats.output_files import writing
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.ground.picture import draw_ground
from slrl_sumo.metrics.conflicts import pet_conflicts, ttc_conflicts
from slrl_sumo.metrics.distributions import kinematics
from slrl_sumo.metrics.traffic.queues import find_queues
from slrl_sumo.report.conflict_figures import draw_conflicts
from slrl_sumo.report.looks import LOOKS, Look
from slrl_sumo.report.map_figures import draw_density, draw_paths, draw_space_time
from slrl_sumo.report.mode_figures import draw_modes, draw_views
from slrl_sumo.report.motion_figures import draw_motion
from slrl_sumo.report.page import page
from slrl_sumo.report.pictures import Layout, title_style, write_picture
from slrl_sumo.report.queue_figures import draw_queues
from slrl_sumo.report.recorder import RunRecord
from slrl_sumo.report.reference import reference_for


def write_report(
    record: RunRecord, folder: Path, summary: dict[str, Any], recording: Trajectories | None = None
) -> None:
    """Write report.html and its figures, each for light and for dark pages, into `folder`, which is created.

    `summary`: as `run --summary` writes it. `recording`: trajectories to compare the learned road users with; None:
    SUMO's own road users in the same run. Raises InputError where the folder cannot be written.
    """
    tracks, learned, surfaces = record.tracks, record.tracks.learned, record.started.surfaces
    ttc, pet = (find(tracks, levels=surfaces.levels).with_vehicles(tracks) for find in (ttc_conflicts, pet_conflicts))
    reference = reference_for(record, recording)
    ours = kinematics(tracks, learned)
    queues = find_queues(tracks)

    def draw(look: Look) -> Iterator[tuple[str, Figure]]:
        ground = draw_ground(surfaces, look.greys)
        yield "paths", draw_paths(record.started.scenario, tracks, learned, ground, look)
        if any(len(values) for values in ours["speed"]):
            yield "motion", draw_motion(ours, reference.motion, reference.name, look)
        if len(tracks.frames) > 1:
            yield "density", draw_density(tracks, ground)
        if (space_time := draw_space_time(tracks, learned, ground, look)) is not None:
            yield "space_time", space_time
        if queues:
            yield "queues", draw_queues(queues, ground, look)
        if len(ttc) or len(pet):
            yield "conflicts", draw_conflicts(ttc, pet, learned, ground, look)
        if record.modes is not None and record.modes.any() and record.started.mode_centres is not None:
            yield "modes", draw_modes(record.modes, record.started.mode_centres, record.started.modes_by, look)
        if record.views:
            yield "ego_images", draw_views(record.views)

    with writing(folder):
        folder.mkdir(exist_ok=True)
        drawn: dict[str, Layout] = {}
        titles = title_style(surfaces)
        for look in LOOKS:
            with rc_context({**titles, **look.style}):
                for name, figure in draw(look):
                    drawn[name] = write_picture(figure, folder / f"{name}{look.suffix}.png", drawn.get(name))
        text = page(record, summary, reference, ours, {"ttc": ttc, "pet": pet}, queues, list(drawn))
        (folder / "report.html").write_text(text, encoding="utf-8")
