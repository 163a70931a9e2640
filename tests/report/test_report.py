"""The report of a run, from events made by hand: what is counted, and that every figure has its definition."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import make_recording, make_world
from matplotlib import rc_context
from PIL import Image

from slrl_sumo.api.run import write_run
from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.ground.picture import draw_ground
from slrl_sumo.ground.surfaces import Ribbon, Surface, SurfaceShapes
from slrl_sumo.metrics.conflicts import ttc_conflicts
from slrl_sumo.metrics.distributions import kinematics
from slrl_sumo.report.definitions import DEFINITIONS
from slrl_sumo.report.looks import LIGHT, LOOKS
from slrl_sumo.report.map_figures import draw_density, draw_paths
from slrl_sumo.report.mode_figures import draw_modes
from slrl_sumo.report.motion_figures import draw_motion
from slrl_sumo.report.recorder import RunRecorder
from slrl_sumo.report.reference import counts_by_group, reference_for
from slrl_sumo.report.report import write_report
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.events import Decision, Started, Step, Views
from slrl_sumo.simulation.settings import RunSettings

ROAD = SurfaceShapes((Ribbon(Surface.ROAD, np.array([[-20.0, 0.0], [200.0, 0.0]]), 12.0),))
NOWHERE = Places(("car",) * 4, ("", "in_0", "in_0", "in_1"), np.zeros(4), np.zeros(4, np.bool_))
PICTURES = ("paths", "motion", "density", "space_time", "conflicts", "modes", "ego_images")


def world(frame: int, learned: int = 2) -> WorldState:
    """Four cars on a road along x: two learned ones at 10 m/s, 20 m apart; SUMO's own at 4 m/s before them, which the
    first one comes near, and one beside it."""
    x = np.array([20.0, 0.0, 60.0, 0.0]) + 0.4 * frame * np.array([10.0, 10.0, 4.0, 8.0])
    return make_world(
        x,
        [0.0, 0.0, 0.0, 3.0],
        speed=[10.0, 10.0, 4.0, 8.0],
        ids=("a", "b", "c", "d"),
        length=4.0,
        width=2.0,
        learned=np.arange(4) < learned,
        time=0.4 * frame,
    )


def decision(frame: int, learned: int = 2, wrapped_around: tuple[bool, ...] = (False, False)) -> Decision:
    return Decision(
        steps=(Step(0.4 * frame, world(frame, learned), NOWHERE),),
        modes=np.array([3, 7])[:learned],
        constraints={},
        surface=np.ones(learned, np.uint8),
        wrapped_around=np.array(wrapped_around[:learned]),
        lost=np.zeros(learned, np.bool_),
        arrived=(),
        left_surface=np.zeros(1, np.bool_),
        under_way=1,
        taken_over=(),
        handed_back=(),
        returned_to_route=(),
        interventions=0,
    )


STARTED = Started(
    scenario="a <b>road</b>",
    bundle="made",
    selector="greedy",
    begin=0.0,
    step_length=0.4,
    decisions=14,
    notices=("less & more",),
    surfaces=ROAD,
    step=Step(0.0, world(0), NOWHERE),
    mode_centres=np.random.default_rng(1).normal(0.0, 9.0, (3, 20, 2)),
)


@pytest.fixture
def builder() -> RunRecorder:
    """13 intervals; from the ninth on one of the two is SUMO's."""
    made = RunRecorder(STARTED)
    for frame in range(1, 14):
        if frame == 5:
            made.add(Views(2.0, ("a",), np.full((1, 20, 40, 3), 200, np.uint8)))
        made.add(decision(frame, 2 if frame < 9 else 1))
    return made


def summary() -> dict[str, Any]:
    figures = dict.fromkeys(("mean_speed_mps", "standing_share", "survival_steps", "success_rate", "off_surface_share"))
    types = {"car": 2, "bicycle": 0, "pedestrian": 0}
    return {
        "scenario": STARTED.scenario,
        "bundle": "made",
        "selector": "greedy",
        "seed": 1,
        "begin_s": 0.0,
        "sumo_step_s": 0.4,
        "decisions": 13,
        "decision_interval_s": 0.4,
        "agent_steps": 21,
        "wall_s": 1.0,
        "real_time_factor": 5.2,
        "per_type": {
            name: {**figures, "mean_speed_mps": 9.87, "count": count, "collisions": 0, "near_misses": 1}
            for name, count in types.items()
        },
        **dict.fromkeys(
            ("lost", "wrapped_around", "taken_over", "handed_back", "returned_to_route", "arrived", "under_way"), 0
        ),
        "notices": list(STARTED.notices),
    }


def test_a_road_user_handed_back_goes_on_as_another_track(builder: RunRecorder) -> None:
    record = builder.build()
    tracks = dict(zip(record.tracks.ids, np.diff(record.tracks.starts).tolist(), strict=True))
    assert tracks == {"a": 14, "b": 9, "b#1": 5, "c": 14, "d": 14}
    assert record.tracks.learned.tolist() == [name in ("a", "b") for name in record.tracks.ids]
    first = record.tracks.mode[:14].tolist()
    assert first == [-1, *[3] * 13]
    assert record.seconds == pytest.approx(5.2)
    assert record.modes is not None
    assert (record.modes[0, 3], record.modes[0, 7], record.modes.sum()) == (13, 8, 21)


def test_a_reinserted_road_user_begins_a_new_track() -> None:
    made = RunRecorder(STARTED)
    made.add(decision(1))
    made.add(decision(2, wrapped_around=(True, False)))
    assert sorted(made.build().tracks.ids) == ["a", "a#1", "b", "c", "d"]


def test_conflicts_are_counted_by_type_and_control(builder: RunRecorder) -> None:
    record = builder.build()
    found = ttc_conflicts(record.tracks)
    # The first comes up to the slow one: 36 m at 6 m/s, so below 1.5 s from frame 12 on. They never touch.
    assert counts_by_group(found, record.tracks) == {("car", "car"): {"learned": 0, "mixed": 1, "background": 0}}
    assert found.value == pytest.approx([(36.0 - 0.4 * 13 * 6.0) / 6.0])


def test_a_long_run_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("slrl_sumo.report.recorder.MOST_ROWS", 12)
    made = RunRecorder(STARTED)
    for frame in range(1, 14):
        made.add(decision(frame))
    record = made.build()
    assert record.cut
    assert len(record.tracks) == 12
    assert record.seconds == pytest.approx(0.8)


def test_the_page_has_every_picture_and_every_link_leads_to_its_definition(
    builder: RunRecorder, tmp_path: Path
) -> None:
    write_report(builder.build(), tmp_path / "report", summary())
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert sorted(p.name for p in (tmp_path / "report").iterdir()) == sorted(
        ["report.html", *(f"{name}{look}.png" for name in PICTURES for look in ("", "-dark"))]
    )
    assert set(re.findall(r'<source srcset="(\w+)-dark\.png" media="\(prefers-color-scheme: dark\)"', page)) == set(
        PICTURES
    )
    assert set(re.findall(r'<img src="(\w+)\.png"', page)) == set(PICTURES)
    anchors = set(re.findall(r'id="([\w-]+)"', page))
    links = re.findall(r'href="#([\w-]+)"', page)
    assert len(links) > 40
    assert set(links) <= anchors
    assert set(DEFINITIONS) <= anchors
    # Every column of figures has a heading that is a link; only the names of the rows have none.
    heads = re.findall(r"<th>(.*?)</th>", page)
    assert {head for head in heads if "href" not in head} == {"type", "", "pair"}
    assert "<td>9.87</td>" in page
    assert "<b>road" not in page
    assert "less &amp; more" in page
    # Nothing is fetched from elsewhere.
    assert not re.search(r"(src|href)=\"(https?:)?//", page)


def test_figures_fit_light_and_dark_pages(builder: RunRecorder, tmp_path: Path) -> None:
    """Their corners have the colour of the page, and what is drawn stands out from it."""
    write_report(builder.build(), tmp_path / "report", summary())
    for look, page in (("", 255), ("-dark", 24)):
        for name in set(PICTURES) - {"ego_images"}:
            grey = np.asarray(Image.open(tmp_path / "report" / f"{name}{look}.png").convert("L"), np.int64)
            assert {abs(int(grey[y, x]) - page) < 2 for y in (0, -1) for x in (0, -1)} == {True}, name
            assert (abs(grey - page) > 150).sum() > 500, name


@pytest.mark.parametrize("north", [0.0, 5.8e6])
def test_figures_are_those_of_matplotlib(north: float, tmp_path: Path) -> None:
    """Drawn once, in the layout of the light figure and with titles without a search, they show what `savefig` writes,
    also where the ticks of the y axis have an offset and titles must avoid it."""
    shapes = SurfaceShapes(tuple(replace(one, points=one.points + np.array([0.0, north])) for one in ROAD.shapes))
    world_there = replace(world(0), y=world(0).y + north)
    made = RunRecorder(
        replace(STARTED, scenario=8 * "a long name ", surfaces=shapes, step=Step(0.0, world_there, NOWHERE))
    )
    for frame in range(1, 14):
        moved = replace(world(frame), y=world(frame).y + north)
        made.add(replace(decision(frame), steps=(Step(0.4 * frame, moved, NOWHERE),)))
    record = made.build()
    write_report(record, tmp_path / "report", summary())
    tracks, motion = record.tracks, kinematics(record.tracks, record.tracks.learned)
    for look in LOOKS:
        with rc_context(look.style):
            ground = draw_ground(shapes, look.greys)
            figures = {
                "paths": draw_paths(record.started.scenario, tracks, tracks.learned, ground, look),
                "motion": draw_motion(motion, reference_for(record, None).motion, "SUMO's own in this run", look),
                "density": draw_density(tracks, ground),
            }
            for name, figure in figures.items():
                figure.savefig(tmp_path / "expected.png", dpi=110)
                found, expected = (
                    np.asarray(Image.open(file))
                    for file in (tmp_path / "report" / f"{name}{look.suffix}.png", tmp_path / "expected.png")
                )
                assert np.array_equal(found, expected), (name, look.suffix)


@pytest.mark.parametrize(
    ("modes_by", "expected"),
    [("accelerations", "acceleration"), ("curved", "root of the distance"), ("relative", "ahead after 4.8 s, less")],
)
def test_modes_are_labelled_by_what_they_are_clusters_of(modes_by: str, expected: str) -> None:
    counts = np.zeros((3, 20), np.int64)
    counts[[0, 2], 3] = 5
    figure = draw_modes(counts, np.zeros((3, 20, 2)), modes_by, LIGHT)
    cars, pedestrians = (axes.get_xlabel() for axes in figure.axes[:2])
    assert cars.startswith(expected)
    assert pedestrians.startswith("ahead after 4.8 s")


def test_what_is_not_there_has_no_section(tmp_path: Path) -> None:
    alone = replace(world(0, 4).take(np.array([0])), learned=np.array([True]))
    made = RunRecorder(replace(STARTED, step=Step(0.0, alone, NOWHERE), mode_centres=None))
    write_report(made.build(), tmp_path / "report", summary())
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert {p.stem for p in (tmp_path / "report").glob("*.png")} == {"paths", "paths-dark"}
    assert "section-modes" not in page
    assert "section-queues" not in page
    assert "section-motion" not in page


def test_a_recording_takes_the_place_of_sumos_own() -> None:
    builder = RunRecorder(STARTED)
    for frame in range(1, 21):  # long enough for a window of realism
        builder.add(decision(frame))
    recording = make_recording((4.0 * np.arange(30), 0.0, 0.0), length=4.0, width=2.0, source="a street")
    record = builder.build()
    found, own = reference_for(record, recording), reference_for(record, None)
    assert found.name == "a street"
    assert found.motion["speed"][0] == pytest.approx(np.full(29, 10.0))
    assert found.realism["car"].features["speed"] > 0.9
    assert set(found.realism["car"].groups) == {"kinematic", "interactive"}
    assert own.name == "SUMO's own in this run"
    assert own.realism["car"].features["speed"] < 0.5
    assert "map" in own.realism["car"].groups


def test_a_folder_that_cannot_be_written_is_told(builder: RunRecorder, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_report(builder.build(), tmp_path / "file", summary())


def test_a_recording_that_cannot_be_compared_with_is_told_before_anything_runs(tmp_path: Path) -> None:
    def call(recording: Path, report: Path | None) -> None:
        write_run(RunSettings("intersection", agents=1), report=report, recording=recording)

    with pytest.raises(InputError, match=r"the report compares with it; add `report=DIR`"):
        call(tmp_path / "a.npz", None)
    with pytest.raises(InputError, match=r"cannot read .*a.npz"):
        call(tmp_path / "a.npz", tmp_path / "report")
    made = RunRecorder(STARTED)
    replace(made.build().tracks, dt=0.1).save(tmp_path / "a.npz")
    with pytest.raises(InputError, match=r"its interval is 0.1 s, not 0.4 s"):
        call(tmp_path / "a.npz", tmp_path / "report")


def test_places_where_vehicles_queued_are_on_a_map_and_in_a_table(tmp_path: Path) -> None:
    made = RunRecorder(STARTED)
    standing = replace(world(1), speed=np.zeros(4))
    for frame in range(1, 20):
        made.add(replace(decision(frame), steps=(Step(0.4 * frame, replace(standing, time=0.4 * frame), NOWHERE),)))
    write_report(made.build(), tmp_path / "report", summary())
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "report" / "queues-dark.png").is_file()
    section = page.partition('id="section-queues"')[2].partition("<h2")[0]
    assert re.search(r"<td>1</td><td>in_0</td><td>10, 1</td><td>1 to \d</td><td>3</td>", section), section
