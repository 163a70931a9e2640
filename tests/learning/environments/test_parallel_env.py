"""The parallel environment through PettingZoo's own tests, in a process of its own."""

import os
import re
import secrets
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import slrl_sumo
from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.learning.environments.make import parallel_env
from slrl_sumo.learning.environments.parallel_env import ParallelRoadUserEnv
from slrl_sumo.models.bundle_folder import SHIPPED
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.sumo.scenario import find_scenario

ALL_TYPES = {"car": 1, "bicycle": 1, "pedestrian": 1}


@pytest.fixture(scope="module")
def env() -> Iterator[ParallelRoadUserEnv]:
    env = slrl_sumo.parallel_env("intersection", agents=4, episode_steps=6, warm_up=4.0)
    yield env
    env.close()


def onward(seen: Any) -> np.int64:
    """The mode that leads along the route."""
    rollouts = dict(zip(PolicyConfig(preset="extended").rollout_features, seen["rollouts"].T, strict=True))
    cost = 5.0 * rollouts["collision"] + 10.0 * rollouts["off_surface"] + 3.0 * rollouts["heading_error"]
    return np.int64((cost - rollouts["speed"] + 100.0 * (1 - seen["action_mask"])).argmin())


def test_it_passes_pettingzoos_test(env: ParallelRoadUserEnv, capsys: pytest.CaptureFixture[str]) -> None:
    parallel_api_test(env, num_cycles=20)
    assert capsys.readouterr().out == "Passed Parallel API test\n"


@pytest.mark.usefixtures("here")
def test_it_passes_pettingzoos_test_with_a_takeover() -> None:
    env = parallel_env("district", agents=6, takeover=ALL_TYPES, episode_steps=12, warm_up=40.0)
    parallel_api_test(env, num_cycles=15)
    env.close()


@pytest.mark.parametrize("options", [{}, pytest.param({"takeover": ALL_TYPES}, marks=pytest.mark.slow)])
def test_it_passes_pettingzoos_test_with_seeds(options: dict[str, Any]) -> None:
    parallel_seed_test(lambda: parallel_env("intersection", agents=4, episode_steps=10, warm_up=10.0, **options))


@pytest.mark.usefixtures("here")
def test_agents_enter_at_their_departure_and_leave_for_good() -> None:
    env = parallel_env("intersection", agents=12, takeover={"pedestrian": 1}, warm_up=30.0)
    seen, infos = env.reset(seed=2)
    begun, entered, left, reached = set(env.agents), set[str](), set[str](), 0
    ids = {agent: info["id"] for agent, info in infos.items()}
    assert all(info["type"] == "pedestrian" for info in infos.values())
    for _ in range(260):
        if not env.agents:
            break
        before = set(env.agents)
        actions = {agent: onward(seen[agent]) for agent in env.agents}
        seen, rewards, terminated, truncated, infos = env.step(actions)
        assert rewards.keys() == terminated.keys() == truncated.keys() == infos.keys() == before | set(env.agents)
        new = set(env.agents) - before
        assert not new & (begun | entered | left)
        entered |= new
        ids |= {agent: infos[agent]["id"] for agent in new}
        left |= before - set(env.agents)
        for agent in before:
            assert infos[agent]["id"] == ids[agent]
            assert infos[agent]["reached"] <= terminated[agent]
            reached += infos[agent]["reached"]
    env.close()
    assert entered
    assert reached
    assert len(set(ids.values())) == len(ids)


def test_a_simulation_that_dies_is_an_error_and_a_reset_begins_anew(env: ParallelRoadUserEnv) -> None:
    before, _ = env.reset(seed=3)
    assert env._simulation._process is not None
    os.kill(env._simulation._process.pid, signal.SIGKILL)
    with pytest.raises(SumoError, match="its process died"):
        env.step(dict.fromkeys(env.agents, np.int64(0)))
    after, _ = env.reset(seed=3)
    np.testing.assert_equal(before, after)
    os.kill(env._simulation._process.pid, signal.SIGKILL)
    again, _ = env.reset(seed=3)  # as where SUMO dies while it loads
    np.testing.assert_equal(before, again)


@pytest.mark.usefixtures("here")
def test_a_copy_is_another_simulation() -> None:
    env = parallel_env("intersection", agents=2, warm_up=0.0, reward=lambda transition: transition.users.speed)
    copy = cloudpickle.loads(cloudpickle.dumps(env))
    assert copy.observation_space("road_user_0") == env.observation_space("road_user_0")
    first, _ = env.reset(seed=1)
    env.close()
    same, _ = copy.reset(seed=1)
    np.testing.assert_equal(first, same)
    assert copy._simulation is not env._simulation


def test_a_reset_without_a_seed_takes_the_next_one(env: ParallelRoadUserEnv) -> None:
    env.reset(seed=7)
    next_one, _ = env.reset()
    same, _ = env.reset(seed=8)
    np.testing.assert_equal(next_one, same)


def test_actions_must_be_there_and_modes(env: ParallelRoadUserEnv) -> None:
    env.reset(seed=1)
    with pytest.raises(InputError, match="actions: there is none for road_user_1, road_user_2, road_user_3"):
        env.step({"road_user_0": np.int64(0)})
    with pytest.raises(InputError, match="road_user_0: 20 is no mode; give a whole number from 0 to 19"):
        env.step(dict.fromkeys(env.agents, np.int64(20)))
    with pytest.raises(InputError, match=r"road_user_0: 2\.9 is no mode"):
        env.step(dict.fromkeys(env.agents, 2.9))  # type: ignore[arg-type]


def test_functions_of_a_script_reach_the_simulation_and_the_script_runs_once(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import numpy, slrl_sumo\n"
        "from gymnasium import spaces\n"
        "print('begins')\n"
        "def observe(situation):\n"
        "    return situation.observation.vector[:, :1]\n"
        "env = slrl_sumo.parallel_env('intersection', agents=2, warm_up=0.0, observe=observe,\n"
        "                             observation_space=spaces.Box(0.0, 100.0, (1,), numpy.float32),\n"
        "                             reward=lambda transition: transition.users.speed)\n"
        "seen, _ = env.reset(seed=1)\n"
        "_, reward, _, _, infos = env.step(dict.fromkeys(env.agents, 0))\n"
        "print([reward[agent] == infos[agent]['speed_mps'] for agent in reward], seen['road_user_0'].shape)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (0, "begins\n[True, True] (1,)\n"), done.stderr


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("own", "message"),
    [
        ({"reward": lambda transition: 1.0}, r"reward: it returned an array of shape \(\); return .* \(2,\)"),
        ({"reward": lambda transition: ["x", "y"]}, r"reward: it returned no numbers \(could not convert .*'x'"),
        ({"reward": lambda transition: [0.0, float("nan")]}, r"reward: it returned nan for learned_\w+\.\d+; return"),
        ({"reward": lambda transition: [-float("inf"), 0.0]}, r"reward: it returned -inf for learned_\w+\.\d+; return"),
        ({"reward": lambda transition: 1 / 0}, r"reward: it raised ZeroDivisionError \(.*line \d+, in <lambda>\)"),
    ],
)
def test_rewards_that_fail_are_named(own: dict[str, Any], message: str) -> None:
    env = parallel_env("intersection", agents=2, warm_up=0.0, **own)
    env.reset(seed=1)
    with pytest.raises(InputError, match=message):
        env.step(dict.fromkeys(env.agents, np.int64(0)))
    env.close()


@pytest.mark.usefixtures("here")
def test_observations_unlike_their_space_are_named() -> None:
    from gymnasium import spaces

    box = spaces.Box(0.0, 1.0, (3,), np.float32)
    options: dict[str, Any] = {"warm_up": 0.0, "observe": lambda situation: situation.observation.vector}
    env = parallel_env("intersection", agents=2, observation_space=box, **options)
    with pytest.raises(InputError, match=r"observe: 'observation' has the shape \(2, 12\); return \(2, 3\)"):
        env.reset(seed=1)
    env.close()
    env = parallel_env("intersection", agents=2, observation_space=spaces.Dict({"near": box}), **options)
    with pytest.raises(InputError, match=r"observe: it returned \['observation'\]; its space has \['near'\]"):
        env.reset(seed=1)
    env.close()


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("returned", "message"),
    [([["a"], ["b"]], "observe: it returned no numbers"), ([[1.0], [1.0, 2.0]], "observe: it returned no array")],
)
def test_observations_that_are_no_numbers_are_named(returned: Any, message: str) -> None:
    from gymnasium import spaces

    box = spaces.Box(0.0, 1.0, (1,), np.float32)
    env = parallel_env("intersection", agents=2, warm_up=0.0, observe=lambda situation: returned, observation_space=box)
    with pytest.raises(InputError, match=message):
        env.reset(seed=1)
    env.close()


def test_keywords_and_options_that_are_unknown_are_named(env: ParallelRoadUserEnv) -> None:
    with pytest.raises(InputError, match="there is no keyword 'takover'; did you mean 'takeover'"):
        slrl_sumo.parallel_env("intersection", takover={"car": 1})  # type: ignore[call-arg]
    with pytest.raises(InputError, match="reset: there is no option 'scen'; did you mean 'scenario'"):
        env.reset(seed=1, options={"scen": "signalised"})


def test_scenarios_and_bundles_may_be_paths(tmp_path: Path) -> None:
    scenario = find_scenario("intersection").config
    assert slrl_sumo.parallel_env(Path("intersection"), agents=2).possible_agents == ["road_user_0", "road_user_1"]
    env = slrl_sumo.parallel_env(scenario, agents=2, warm_up=0.0, bundle=SHIPPED / "intersection")
    seen, _ = env.reset(seed=1)
    env.close()
    assert seen["road_user_0"]["vector"].shape == (12,)
    for words in ({"scenario": 5}, {"scenario": "intersection", "bundle": None}):
        with pytest.raises(InputError, match="give the name"):
            slrl_sumo.parallel_env(**words)  # type: ignore[arg-type]


def test_without_pettingzoo_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pettingzoo", None)
    monkeypatch.delitem(sys.modules, ParallelRoadUserEnv.__module__)
    with pytest.raises(InputError, match=r"needs PettingZoo, which is not installed: pip install 'slrl-sumo\[rl\]'$"):
        slrl_sumo.parallel_env("intersection")


@pytest.mark.slow
def test_the_example_trains_by_supersuit_and_stable_baselines(tmp_path: Path) -> None:
    example = Path(slrl_sumo.__file__).parent.parent / "docs" / "examples" / "train_parallel_env.py"
    done = subprocess.run(
        [sys.executable, example, "512", tmp_path],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "SB3_LOGDIR": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"512 decisions; 16 road users earned -?\d+\.\d each\n", done.stdout)
    assert (tmp_path / "policy.zip").is_file()


@pytest.mark.slow
def test_the_example_trains_by_rllib(tmp_path: Path) -> None:
    pytest.importorskip("tree", reason="RLlib needs dm_tree, which no extra installs: pip install dm_tree")
    example = Path(slrl_sumo.__file__).parent.parent / "docs" / "examples" / "train_rllib.py"
    # Ray's sockets need a short path, and its token would be left in the home folder.
    with tempfile.TemporaryDirectory(prefix="ray_", ignore_cleanup_errors=True) as folder:
        token = Path(folder, "token")
        token.write_text(secrets.token_hex(32))
        done = subprocess.run(
            [sys.executable, example, "1", tmp_path],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
            env={**os.environ, "TMPDIR": folder, "RAY_AUTH_TOKEN_PATH": str(token), "RAY_USAGE_STATS_ENABLED": "0"},
        )
    assert done.returncode == 0, done.stderr
    assert re.search(r"^iteration 1: they earned -?\d+\.\d$", done.stdout, re.MULTILINE)
    assert any((tmp_path / "rllib").iterdir())
