"""The environments through gymnasium and Stable-Baselines3, on a real SUMO."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium
import libsumo
import numpy as np
import pytest
import torch
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env

import slrl_sumo.learning.envs
from slrl_sumo.agent.decide import choose
from slrl_sumo.agent.driver import make_selector
from slrl_sumo.errors import InputError
from slrl_sumo.learning.envs import RoadUserEnv
from slrl_sumo.learning.rewards.terms import TERMS, RewardWeights
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy, PolicyConfig
from slrl_sumo.perception.route_features import ROUTE_FEATURES
from slrl_sumo.scene.types import RoadUserType

IDS = ("slrl_sumo/Intersection-v0", "slrl_sumo/SharedSpace-v0", "slrl_sumo/Random-v0")


@pytest.fixture(autouse=True)
def closed() -> Iterator[None]:
    """SUMO is free before and after each test, whatever becomes of it."""
    yield
    holder = slrl_sumo.learning.envs._holder
    if holder is not None:
        holder.close()
    assert not libsumo.isLoaded()


def make(**keywords: Any) -> RoadUserEnv:
    env = gymnasium.make(IDS[0], **keywords).unwrapped
    assert isinstance(env, RoadUserEnv)
    return env


def play(env: RoadUserEnv, seed: int, steps: int) -> list[Any]:
    """Vector, reward and information of every step, with resets where episodes end."""
    actions = np.random.default_rng(9).integers(0, 20, steps)
    env.reset(seed=seed)
    seen: list[Any] = []
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        seen.append([observation["vector"].tolist(), reward, terminated, truncated, info])
        if terminated or truncated:
            seen.append(env.reset()[0]["vector"].tolist())
    return seen


@pytest.mark.parametrize("name", IDS)
def test_gymnasium_finds_nothing_to_complain_of(name: str) -> None:
    check_env(gymnasium.make(name).unwrapped)


def test_importing_the_package_is_cheap_and_the_module_in_the_name_registers() -> None:
    script = (
        "import sys, slrl_sumo\n"
        "assert not {'torch', 'libsumo', 'gymnasium'} & set(sys.modules)\n"
        "import gymnasium\n"
        "env = gymnasium.make('slrl_sumo.learning.envs:slrl_sumo/SharedSpace-v0')\n"
        "print(env.reset(seed=1)[1]['scenario'])\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (0, "shared-space\n"), done.stderr


def test_stable_baselines_trains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from stable_baselines3 import PPO

    monkeypatch.setenv("SB3_LOGDIR", str(tmp_path))
    env = gymnasium.make(IDS[0], episode_steps=32)
    with torch.random.fork_rng():
        model = PPO("MultiInputPolicy", env, n_steps=128, batch_size=64, n_epochs=1, seed=1, device="cpu")
        before = {name: values.clone() for name, values in model.policy.state_dict().items()}
        model.learn(256)
    changed = [name for name, values in model.policy.state_dict().items() if not torch.equal(values, before[name])]
    assert any("image" in name for name in changed)
    assert any("action_net" in name for name in changed)
    assert len(model.ep_info_buffer) >= 4  # episodes ended and were counted
    env.close()


def test_same_seed_and_actions_same_episodes() -> None:
    env = make(episode_steps=10)
    first, again, other = play(env, 3, 35), play(env, 3, 35), play(env, 4, 35)
    np.testing.assert_equal(first, again)
    with pytest.raises(AssertionError):
        np.testing.assert_equal(first, other)
    assert sum(step[2] or step[3] for step in first if len(step) == 5) >= 3


def test_an_episode_that_goes_on_in_the_same_traffic_begins_elsewhere() -> None:
    env = make(episode_steps=5, ego="car")
    env.reset(seed=3)
    while True:
        here = position(env)
        observation, _, terminated, truncated, _ = env.step(np.int64(0))
        if terminated or truncated:
            break
    time = env._arena.world.time  # type: ignore[union-attr]
    begin, _ = env.reset()
    assert env._arena.world.time == time > 60.0  # type: ignore[union-attr]
    assert np.hypot(*(position(env) - here)) > 10.0
    assert not np.array_equal(begin["image"], observation["image"])
    # An episode that was broken off is not taken up again: SUMO begins anew.
    env.step(np.int64(0))
    env.reset()
    assert env._arena.world.time < time  # type: ignore[union-attr]


def test_sumo_begins_anew_before_the_traffic_runs_out(copy_scenario: Any) -> None:
    short = copy_scenario("intersection", (".sumocfg", '<end value="600"/>', '<end value="66"/>'))
    env = make(scenario=str(short), episode_steps=4, others="sumo")
    env.reset(seed=1)
    times = []
    for _ in range(30):
        _, _, terminated, truncated, _ = env.step(np.int64(0))
        times.append(env._arena.world.time)  # type: ignore[union-attr]
        if terminated or truncated:
            env.reset()
    assert max(times) <= 66.5
    assert (np.diff(times) < 0).any()


def position(env: RoadUserEnv) -> np.ndarray:
    assert env._arena is not None
    return np.array([env._arena.world.x[env._slot], env._arena.world.y[env._slot]])


def test_time_truncates_and_no_sooner() -> None:
    env = make(episode_steps=6, others="sumo", ego="pedestrian")
    env.reset(seed=5)
    ends = [env.step(np.int64(3))[2:4] for _ in range(6)]
    assert ends == [(False, False)] * 5 + [(False, True)]
    with pytest.raises(ResetNeeded, match="reset"):
        env.step(np.int64(3))


def test_contact_terminates() -> None:
    env = make(ego="car")
    env.reset(seed=1)
    arena, slot = env._arena, env._slot
    assert arena is not None
    users = arena.simulation.population.world
    other = int(np.flatnonzero((users.type == RoadUserType.CAR) & (np.arange(len(users)) != slot))[0])
    x, y, heading, speed = users.x.copy(), users.y.copy(), users.heading.copy(), users.speed.copy()
    x[other], y[other] = x[slot] + 8.0 * np.cos(heading[slot]), y[slot] + 8.0 * np.sin(heading[slot])
    heading[other] = heading[slot] + np.pi
    speed[[slot, other]] = 8.0
    arena.simulation.population.world = replace(users, x=x, y=y, heading=heading, speed=speed)
    arena.simulation.world = arena.simulation.population.world.join(
        arena.world.take(np.arange(len(users), len(arena.world)))
    )
    arena.consider()
    observation, reward, terminated, truncated, info = env.step(np.int64(0))
    assert (terminated, truncated) == (True, False)
    assert info["terms"]["contact"] == -1.0
    assert reward < -0.5 * RewardWeights().contact
    # The last look is at the one that it ran into, not at the next place.
    assert observation["vector"][9] >= 1
    with pytest.raises(ResetNeeded):
        env.step(np.int64(0))


def test_terms_make_up_the_reward_by_the_weights() -> None:
    weights = RewardWeights(**{name: 0.5 + number for number, name in enumerate(TERMS)})
    env = make(weights=weights)
    env.reset(seed=6)
    for action in range(20):
        _, reward, terminated, truncated, info = env.step(np.int64(action))
        assert reward == pytest.approx(sum(asdict(weights)[name] * info["terms"][name] for name in TERMS))
        assert set(info["terms"]) == set(TERMS)
        if terminated or truncated:
            env.reset()


@pytest.mark.parametrize("others", ["prior", "greedy", "sampled"])
def test_the_others_move_by_the_selector(others: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bundle = load_bundle("intersection")
    torch.manual_seed(1)
    policy = Policy(PolicyConfig(modes=20, hidden=16, head=8))
    for parameter in policy.parameters():
        parameter.data += 0.3 * torch.randn(parameter.shape)
    replace(bundle, policy=policy).save(tmp_path / "bundle")
    env = make(bundle=str(tmp_path / "bundle"), others=others)
    env.reset(seed=8)
    arena = env._arena
    assert arena is not None
    given: list[np.ndarray] = []
    real = arena.step
    monkeypatch.setattr(arena, "step", lambda modes: given.append(modes.copy()) or real(modes))
    seed = env._arena._seed  # type: ignore[union-attr]
    expected = make_selector(others, load_bundle(tmp_path / "bundle"), seed)
    rest = np.arange(16) != env._slot
    for action in (7, 11):
        wanted, _ = choose(arena.situation, expected, arena.world.ids[:16])
        _, _, terminated, _, _ = env.step(np.int64(action))
        np.testing.assert_array_equal(given[-1][rest], wanted[rest])
        assert given[-1][env._slot] == action
        assert not terminated


def test_among_sumos_own_the_ego_is_alone() -> None:
    env = make(others="sumo", agents=30)
    env.reset(seed=1)
    assert env._arena is not None
    assert env._arena.world.learned.sum() == 1
    assert len(env._arena.world) > 1


@pytest.mark.parametrize("others", ["prior", "sumo"])
@pytest.mark.parametrize("ego", ["car", "bicycle", "pedestrian"])
def test_the_ego_is_of_the_type_asked_for(ego: Any, others: Any) -> None:
    env = make(ego=ego, others=others)
    observation, info = env.reset(seed=1)
    assert info["type"] == ego
    assert info["id"].startswith(f"learned_{ego}.")
    assert observation["vector"][2:5].tolist() == [float(ego == name) for name in ("car", "bicycle", "pedestrian")]


def test_without_a_wish_egos_are_of_all_types() -> None:
    env = make()
    assert {env.reset(seed=seed)[1]["type"] for seed in range(12)} == {"car", "bicycle", "pedestrian"}


def test_the_view_from_above_shows_the_ego_in_the_middle() -> None:
    env = make(render_mode="rgb_array", ego="car", others="sumo")
    env.reset(seed=1)
    pictures = []
    for _ in range(2):
        picture = env.render()
        assert picture is not None
        assert picture.shape == (512, 512, 3)
        assert picture.dtype == np.uint8
        assert picture[256, 256].tolist() == [0xD5, 0x5E, 0x00]
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 5
        pictures.append(picture)
        env.step(np.int64(0))
    assert (pictures[0] != pictures[1]).any()
    env.render_mode = None
    assert env.render() is None


def test_the_last_picture_shows_the_end_and_not_the_next_place() -> None:
    env = make(render_mode="rgb_array", ego="car", others="sumo", episode_steps=3)
    env.reset(seed=1)
    for _ in range(3):
        near = position(env)
        *_, truncated, info = env.step(np.int64(0))
    assert truncated
    assert env._scene is not None
    moved = np.hypot(env._scene.x[0] - near[0], env._scene.y[0] - near[1])
    assert moved == pytest.approx(0.4 * info["speed_mps"], abs=0.02)
    assert np.hypot(*(position(env) - near)) > 5.0


def test_random_networks_come_from_the_seed_and_leave_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    env = gymnasium.make(IDS[2]).unwrapped
    views = [env.reset(seed=seed)[0]["image"] for seed in (1, 2, 1)]
    names = [env.reset(seed=1)[1]["scenario"], env.reset()[1]["scenario"], env.reset(seed=1)[1]["scenario"]]
    np.testing.assert_array_equal(views[0], views[2])
    assert not np.array_equal(views[0], views[1])
    assert names[0] == names[2] != names[1]
    assert len(list(tmp_path.glob("*/random-*"))) == 1
    env.close()
    assert not list(tmp_path.iterdir())


def test_options_switch_the_scenario_from_then_on() -> None:
    env = make()
    assert env.reset(seed=1)[1]["scenario"] == "intersection"
    assert env.reset(options={"scenario": "shared-space"})[1]["scenario"] == "shared-space"
    assert env.reset(seed=1)[1]["scenario"] == "shared-space"


def test_the_environment_that_was_reset_last_has_sumo() -> None:
    first, second = make(), make()
    first.reset(seed=1)
    second.reset(seed=1)
    with pytest.raises(InputError, match=r"^another environment .*one simulation per process.*reset this one"):
        first.step(np.int64(0))
    second.step(np.int64(0))
    first.close()  # takes nothing from the second
    second.step(np.int64(0))
    first.reset()
    first.step(np.int64(0))
    with pytest.raises(InputError, match="another environment"):
        second.step(np.int64(0))


def test_torch_computes_in_one_thread_while_an_environment_is_open() -> None:
    torch.set_num_threads(2)
    try:
        first, second = make(agents=2, others="greedy", preset="extended"), make(agents=2)
        first.reset(seed=1)
        first.step(np.int64(0))
        assert torch.get_num_threads() == 1
        second.reset(seed=1)  # ends the simulation of the first
        assert torch.get_num_threads() == 1
        first.close()
        assert torch.get_num_threads() == 1
        second.close()
        assert torch.get_num_threads() == 2
        second.close()
        with pytest.raises(InputError):
            second.reset(seed=1, options={"scenario": "nowhere"})
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(1)


def test_a_simulation_of_the_users_own_is_left_alone(copy_scenario: Any) -> None:
    libsumo.start(["sumo", "-c", str(copy_scenario("intersection")), "--no-step-log"])
    try:
        with pytest.raises(InputError, match="already open"):
            make().reset(seed=1)
        libsumo.simulationStep()
    finally:
        libsumo.close()


def test_close_frees_sumo_and_a_reset_opens_it_again() -> None:
    env = make()
    env.reset(seed=1)
    assert libsumo.isLoaded()
    env.close()
    assert not libsumo.isLoaded()
    env.close()
    env.reset()
    env.step(np.int64(0))


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"ego": "tram"}, "ego='tram'.*'pedestrian'"),
        ({"others": "lane"}, "others='lane'.*'sumo'"),
        ({"agents": 0}, "agents=0"),
        ({"scenario": "nowhere"}, "nowhere: no such"),
        ({"bundle": "nothing"}, "nothing"),
    ],
)
def test_what_cannot_be_used_is_said_when_it_is_made(keywords: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        RoadUserEnv(**keywords)


def test_a_bundle_without_a_trained_selector_has_no_greedy_others(tmp_path: Path) -> None:
    replace(load_bundle("intersection"), policy=None).save(tmp_path / "untrained")
    with pytest.raises(InputError, match="no trained selector"):
        RoadUserEnv(bundle=str(tmp_path / "untrained"), others="greedy")


def test_wishes_that_the_scenario_cannot_meet_close_sumo() -> None:
    env = make(ego="bicycle", agents=1)
    with pytest.raises(InputError, match="none of the 1 learned road users is a bicycle"):
        env.reset(seed=1)
    assert not libsumo.isLoaded()


def test_actions_beyond_the_modes_are_refused() -> None:
    env = make()
    env.reset(seed=1)
    with pytest.raises(InvalidAction, match="0 to 19"):
        env.step(np.int64(20))


def test_with_the_preset_extended_the_ego_knows_its_route() -> None:
    env = make(preset="extended", ego="car", agents=6)
    check_env(env, skip_render_check=True)
    seen, _ = env.reset(seed=2)
    route = dict(zip(ROUTE_FEATURES, seen["route"].tolist(), strict=True))
    assert route["known"] == 1.0
    assert route["lateral_offset"] == pytest.approx(0.0, abs=0.3)
    assert route["desired_speed"] > 0.5
    magenta = (seen["image"] == [255, 0, 255]).all(axis=-1)
    assert magenta.any()
    _, _, _, _, info = env.step(np.int64(3))
    assert info["terms"]["progress"] != 0.0
    # Without it nothing of that is there.
    plain = make(ego="car", agents=6)
    seen, _ = plain.reset(seed=2)
    assert set(seen) == {"vector", "image"}
    assert not (seen["image"] == [255, 0, 255]).all(axis=-1).any()


def test_others_see_the_preset_that_their_selector_was_trained_with(tmp_path: Path) -> None:
    policy = Policy(PolicyConfig(preset="extended", hidden=16, head=8))
    replace(load_bundle("intersection"), policy=policy).save(tmp_path / "bundle")
    with pytest.raises(InputError, match="sees the preset 'extended'; give preset='extended'"):
        RoadUserEnv(bundle=str(tmp_path / "bundle"), others="greedy")
    env = make(bundle=str(tmp_path / "bundle"), others="greedy", preset="extended", agents=4)
    env.reset(seed=1)
    env.step(np.int64(0))
