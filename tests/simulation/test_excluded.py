"""Road users that are left alone: by attach, in runs, by the command line, and in environments."""

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import libsumo
import numpy as np
import pytest

import slrl_sumo
from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.make import vector_env
from slrl_sumo.simulation.excluded import parse_excluded
from slrl_sumo.sumo.scenario import find_scenario

Cli = Callable[..., "subprocess.CompletedProcess[str]"]
OPTIONS = ["--step-length", "0.4", "--time-to-teleport", "-1", "--collision.action", "warn", "--no-warnings"]
EGO, SLOW = "ego", 2.0
ALL = {"car": 1, "bicycle": 1, "pedestrian": 1}


@pytest.fixture
def api() -> Iterator[Any]:
    libsumo.start(["sumo", "-c", str(find_scenario("signalised").config), *OPTIONS, "--no-step-log"])
    yield libsumo
    libsumo.close()


def driven(api: Any, exclude: Any) -> tuple[set[str], list[float]]:
    """All ids that were learned while the script drives its ego at 2 m/s, and the speeds of the ego."""
    learned: set[str] = set()
    speeds = []
    with slrl_sumo.attach(api, takeover={"car": 1}, exclude=exclude) as attached:
        api.route.add("way", ["in0", "out2"])
        api.vehicle.add(EGO, "way", typeID="passenger0", departLane="best", departSpeed="max")
        for _ in range(50):
            if EGO in api.vehicle.getIDList():
                api.vehicle.setSpeed(EGO, SLOW)
            attached.step()
            learned |= set(attached.ids)
            speeds.append(api.vehicle.getSpeed(EGO))
        assert EGO in attached.world.ids
    return learned, speeds


def test_a_script_drives_its_ego_among_learned_road_users(api: Any) -> None:
    learned, speeds = driven(api, [EGO])
    assert len(learned) > 5
    assert EGO not in learned
    assert speeds[10:] == pytest.approx([SLOW] * 40)  # after it has braked from the speed of its departure


def test_without_exclude_the_ego_is_learned(api: Any) -> None:
    learned, speeds = driven(api, ())
    assert EGO in learned
    assert max(speeds[10:]) > 2.0 * SLOW


def test_a_run_leaves_them_to_sumo_and_counts_them() -> None:
    all_users = slrl_sumo.run("signalised", takeover=ALL, steps=60)
    assert all_users.trajectories is not None
    taken = all_users.trajectories.ids[0].partition("#")[0]
    result = slrl_sumo.run("signalised", takeover=ALL, steps=60, exclude={taken, "later"})
    assert result.summary.left_to_sumo["excluded"] == 1
    assert "excluded" not in all_users.summary.left_to_sumo
    assert result.summary.options["exclude"] == sorted(["later", taken])
    assert result.summary.notices == ["exclude: no road user had one of the ids later"]
    assert not all_users.summary.notices
    tracks = result.trajectories
    assert tracks is not None
    mine = [row for row, road_user in enumerate(tracks.ids) if road_user.partition("#")[0] == taken]
    assert mine
    assert not tracks.learned[mine].any()
    assert tracks.learned.any()
    assert slrl_sumo.run(**result.summary.options).summary.left_to_sumo == result.summary.left_to_sumo


def test_the_command_line_takes_ids_and_a_summary_repeats_them(cli: Cli, tmp_path: Path) -> None:
    words = ("run", "signalised", "--takeover", "car=1", "--steps", 3, "--quiet")
    done = cli(*words, "--exclude", "ego,bus_3", "--exclude", "van", "--summary", "a.json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    done = cli("run", "--config", "a.json", "--summary", "b.json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "note: exclude: no road user had one of the ids bus_3, ego, van\n")
    for name in ("a.json", "b.json"):
        assert json.loads((tmp_path / name).read_text())["options"]["exclude"] == ["bus_3", "ego", "van"]
    (tmp_path / "run.toml").write_text('takeover = "car=1"\nexclude = ["ego"]\nsteps = 3\n')
    done = cli("run", "signalised", "--config", "run.toml", "--summary", "c.json", cwd=tmp_path)
    assert json.loads((tmp_path / "c.json").read_text())["options"]["exclude"] == ["ego"]
    done = cli(*words, "--exclude", "ego,,van", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (
        1,
        "slrl-sumo: --exclude ego,,van: give ids of road users, as ['ego'] or 'ego,bus_3'\n",
    )


def test_environments_leave_them_to_sumo() -> None:
    def taken(**options: Any) -> set[str]:
        env = vector_env("intersection", num_envs=12, takeover=ALL, warm_up=90.0, **options)
        env.reset(seed=5)
        ids: set[str] = set()
        for _ in range(10):
            ids |= set(env.slots.arena.simulation.population.ids)
            env.step(np.full(12, -1))
        env.close()
        return ids

    first = sorted(taken())
    left = taken(exclude=first[:2])
    assert first[2:]
    assert left
    assert left.isdisjoint(first[:2])


def test_ids_are_a_list_or_a_text() -> None:
    assert parse_excluded(()) == parse_excluded("") == ()
    assert parse_excluded("ego, bus_3") == parse_excluded({"bus_3", "ego"}) == ("bus_3", "ego")
    for wrong in (5, None, ["ego", 3], ["ego", ""], "ego,", iter(["ego"])):
        with pytest.raises(InputError, match=r"^exclude.*: give ids of road users"):
            parse_excluded(wrong)  # type: ignore[arg-type]
