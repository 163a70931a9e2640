"""Scenarios run in plain SUMO, are the same for the same seed, and are written all or not at all."""

import stat
import subprocess
from collections import defaultdict
from dataclasses import replace
from itertools import product
from math import dist
from pathlib import Path

import pytest
import sumolib
from lxml import etree

from slrl_sumo.netgen import binaries
from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.scenario import write_scenario
from slrl_sumo.netgen.specs import DemandSpec, IntersectionSpec, NetSpec, RandomSpec, RoundaboutSpec, SharedSpaceSpec

BUSY = DemandSpec(cars_per_hour=900.0, bicycles_per_hour=700.0, pedestrians_per_hour=700.0, duration=60.0, seed=1)

VARIATIONS: list[NetSpec] = [
    *[
        IntersectionSpec(arms=arms, lanes=lanes, control=control, angle_spread=15.0, seed=2)
        for arms, lanes, control in product((3, 4), (1, 2), ("priority", "right_before_left", "traffic_light"))
    ],
    *[
        IntersectionSpec(sidewalks=sidewalks, crossings=crossings, cycle_lanes=cycle_lanes, arm_length=60.0)
        for (sidewalks, crossings), cycle_lanes in product(((True, True), (True, False), (False, False)), (True, False))
    ],
    *[
        RoundaboutSpec(arms=arms, radius=16.0, cycle_lanes=cycle_lanes, sidewalks=walks, crossings=walks, seed=2)
        for arms, (cycle_lanes, walks) in product((3, 5), ((True, True), (False, True), (True, False), (False, False)))
    ],
    *[SharedSpaceSpec(arms=arms, angle_spread=15.0, seed=3) for arms in (2, 3, 4)],
    RandomSpec(iterations=8, seed=1),
    RandomSpec(iterations=12, sidewalks=False, crossings=False, cycle_lanes=False, signal_share=0.0, seed=2),
]


def fcd_paths(config: Path) -> dict[str, list[tuple[float, float]]]:
    """Run plain `sumo -c` in another process and folder; the positions of each road user, by id."""
    fcd = config.parent / "fcd.xml"
    command = [binaries.binary("sumo"), "-c", str(config), "--fcd-output", str(fcd)]
    done = subprocess.run(command, cwd="/", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Error" not in done.stderr
    paths = defaultdict(list)
    for row in etree.parse(fcd).iter("vehicle", "person"):
        paths[row.get("id")].append((float(row.get("x")), float(row.get("y"))))
    return paths


@pytest.mark.parametrize("spec", VARIATIONS, ids=repr)
def test_every_variation_runs_in_plain_sumo_and_all_three_types_move(spec: NetSpec, tmp_path: Path) -> None:
    paths = fcd_paths(write_scenario(spec, BUSY, tmp_path / "made"))
    for name in ("passenger", "bicycle", "pedestrian"):
        went = [dist(p[0], p[-1]) for i, p in paths.items() if i.startswith(f"{name}.")]
        assert len(went) >= 3
        assert max(went) > 20.0


def test_the_same_specs_give_the_same_files_and_another_seed_others(tmp_path: Path) -> None:
    spec = RandomSpec(iterations=7, seed=1)
    for parent in ("a", "b"):
        write_scenario(spec, DemandSpec(seed=1), tmp_path / parent / "made")
    write_scenario(replace(spec, seed=2), DemandSpec(seed=2), tmp_path / "c" / "made")
    a, b, c = ({f.name: f.read_bytes() for f in (tmp_path / parent / "made").iterdir()} for parent in ("a", "b", "c"))
    assert a.keys() == {"made.net.xml", "made.rou.xml", "made.sumocfg", "README.md"}
    assert a == b
    assert all(a[name] != c[name] for name in a)
    assert not any(str(tmp_path).encode() in content for content in a.values())


def test_the_config_is_what_moved_road_users_need(tmp_path: Path) -> None:
    config = write_scenario(IntersectionSpec(), DemandSpec(duration=120.0), tmp_path / "made")
    options = {e.tag: e.get("value") for e in etree.parse(config).iter() if e.get("value")}
    assert options["step-length"] == "0.4"
    assert (options["begin"], options["end"]) == ("0", "120")
    assert (options["time-to-teleport"], options["collision.action"]) == ("-1", "warn")
    assert options["pedestrian.model"] == "striping"
    assert not [name for name in options if "output" in name]


def test_the_readme_shows_a_call_that_makes_the_same_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_scenario(SharedSpaceSpec(seed=3), DemandSpec(seed=4), tmp_path / "one" / "made").parent
    before = {f.name: f.read_bytes() for f in folder.iterdir()}
    script = before["README.md"].decode().split("```python\n")[1].split("```")[0]
    (tmp_path / "two").mkdir()
    monkeypatch.chdir(tmp_path / "two")
    exec(script, {})
    assert {f.name: f.read_bytes() for f in (tmp_path / "two" / "made").iterdir()} == before


def test_other_files_in_the_folder_stay(tmp_path: Path) -> None:
    folder = tmp_path / "my town (1)"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    (folder / "README.md").write_text("old")
    config = write_scenario(SharedSpaceSpec(), BUSY, folder)
    assert config == folder / "my-town-1.sumocfg"
    assert (folder / "notes.txt").read_text() == "mine"
    assert (folder / "README.md").read_text().startswith("# my-town-1")
    assert fcd_paths(config)


def test_an_unwritable_folder_is_one_clear_line_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    (tmp_path / "taken" / "taken.net.xml").mkdir(parents=True)
    for folder in (tmp_path / "file" / "made", tmp_path / "file", tmp_path / "taken"):
        with pytest.raises(NetgenError, match="cannot write the scenario to") as caught:
            write_scenario(SharedSpaceSpec(), BUSY, folder)
        assert "\n" not in str(caught.value)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["file", "taken", "taken.net.xml"]


def test_a_missing_program_is_named_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sumolib, "checkBinary", lambda name, bindir=None: name)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(NetgenError, match="netgenerate was not found: pip install eclipse-sumo"):
        write_scenario(IntersectionSpec(), BUSY, tmp_path / "made")
    assert list(tmp_path.iterdir()) == []


def test_a_failing_program_is_quoted_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "fails"
    program.write_text("#!/bin/sh\necho 'Warning: so so' >&2\necho 'Error: out of asphalt' >&2\nexit 3\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(binaries, "binary", lambda name: str(program))
    with pytest.raises(NetgenError, match=r"^netgenerate failed \(exit code 3\): Error: out of asphalt$"):
        write_scenario(IntersectionSpec(), BUSY, tmp_path / "made")
    assert list(tmp_path.iterdir()) == [program]
