"""A bundle that was fitted to cars and pedestrians alone, from the import to the run."""

import json
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.hc import PIXELS_PER_METRE
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.learning.environments.road_user_env import RoadUserEnv
from slrl_sumo.learning.rewards.transition import recorded_speed
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.simulation.placement.spawn import starting_points, type_counts
from slrl_sumo.simulation.shares import parse_mix, served_shares
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession

Cli = Callable[..., subprocess.CompletedProcess[str]]


def test_a_recording_from_which_nothing_can_be_learned_is_named(
    cli: Cli, traffic: list[Trajectories], tmp_path: Path
) -> None:
    still = traffic[0]
    replace(still, x=np.zeros(len(still.x)), y=np.zeros(len(still.y))).save(tmp_path / "still.npz")
    done = cli("fit", tmp_path / "still.npz", "--out", tmp_path / "b", "--epochs", 1)
    assert done.returncode == 1
    assert f"{tmp_path / 'still.npz'}: nothing can be learned: car: 1 distinct destinations" in done.stderr


@pytest.fixture(scope="module")
def two(cli: Cli, traffic: list[Trajectories], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundle, made by the commands of the tutorial from a file in the format of HC."""
    folder = tmp_path_factory.mktemp("two")
    some = traffic[0]
    kept = np.flatnonzero((some.type[some.track] != 1) & (some.track % 3 > 0))
    lines = [
        f"{some.frame[k]},{some.track[k]},{PIXELS_PER_METRE * some.x[k]},{-PIXELS_PER_METRE * some.y[k]},"
        f"{3 if some.type[some.track[k]] == 0 else 1}"
        for k in kept.tolist()
    ]
    (folder / "D1.csv").write_text("\n".join(lines), encoding="utf-8")
    assert cli("import", "hc", folder / "D1.csv", "--out", folder / "d1.npz").returncode == 0
    done = cli("fit", folder / "d1.npz", "--out", folder / "bundle", "--epochs", 1)
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith("note: no models for bicycle: 0 tracks of 6 s or longer")
    return folder / "bundle"


def test_evaluate_leaves_the_missing_type_as_recorded(
    cli: Cli, two: Path, traffic: list[Trajectories], tmp_path: Path
) -> None:
    traffic[1].save(tmp_path / "all.npz")
    words = ("--bundle", two, "--selectors", "constant-velocity", "--starts", 40, "--out", tmp_path / "out")
    done = cli("evaluate", tmp_path / "all.npz", *words)
    assert done.returncode == 0, done.stderr
    note = "bundle bundle has no models for bicycle: as recorded, without figures"
    assert f"note: {note}" in done.stderr
    result = json.loads((tmp_path / "out" / "results.json").read_text())
    assert {row["type"] for row in result["rows"]} == {"car", "pedestrian"}
    assert result["notes"][0] == note


def test_a_run_spawns_the_types_that_are_there(cli: Cli, two: Path, tmp_path: Path) -> None:
    words = ("--bundle", two, "--steps", 2, "--agents", 12, "--fcd", tmp_path / "fcd.csv")
    done = cli("run", "shared-space", *words)
    assert done.returncode == 0, done.stderr
    assert "bundle 'bundle' has no models for bicycle: their share goes to the other types" in done.stderr
    assert "learned_bicycle" not in (tmp_path / "fcd.csv").read_text()
    assert "learned_pedestrian" in (tmp_path / "fcd.csv").read_text()


def test_asking_for_the_missing_type_is_refused(two: Path) -> None:
    bundle = load_bundle(two)
    assert served_shares("car=1,pedestrian=0.5", bundle).tolist() == [1.0, 0.0, 0.5]
    with pytest.raises(InputError, match="'bundle' has no models for bicycle: leave it out, or use another") as error:
        served_shares("car=1,bicycle=0.5", bundle)
    assert error.value.argument == "takeover"
    with SumoSession(find_scenario("shared-space"), seed=1) as session:
        points = starting_points(session.network)
    with pytest.raises(InputError, match="'bundle' has no models for bicycle; leave it out of `mix`"):
        type_counts(4, parse_mix("bicycle=1"), points, "here", bundle)
    counts, notices = type_counts(16, None, points, "here", bundle)
    assert counts.tolist() == [10, 0, 6]
    assert len(notices) == 1


def test_environments_and_training_know_the_types(two: Path) -> None:
    bundle = load_bundle(two)
    car, bicycle, pedestrian = recorded_speed(bundle)
    assert min(car, pedestrian) > 0.5
    assert bicycle == 0.0
    with pytest.raises(InputError, match="ego='bicycle': bundle 'bundle' has no models for it"):
        RoadUserEnv(scenario="shared-space", bundle=str(two), ego="bicycle")
    env = RoadUserEnv(bundle=str(two), agents=8, scenario="shared-space")
    _, info = env.reset(seed=1)
    assert info["type"] != "bicycle"
    env.close()
