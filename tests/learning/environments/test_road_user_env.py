"""The environment of one road user through gymnasium and Stable-Baselines3, on a real SUMO."""

import subprocess
import sys
import tempfile
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

import slrl_sumo  # noqa: F401 (registers the ids)
from slrl_sumo.environment_ids import IDS
from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.road_user_env import RoadUserEnv
from slrl_sumo.learning.environments.simulation_env import ACTION_SPACE
from slrl_sumo.learning.environments.slots import SpawnedSlots
from slrl_sumo.learning.rewards.terms import TERMS, RewardWeights
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig
from slrl_sumo.perception.route_features import ROUTE_FEATURES
from slrl_sumo.scene.types import RoadUserType

QUICK: dict[str, Any] = {"warm_up": 8.0}


def make(name: str = "slrl_sumo/Intersection-v0", **keywords: Any) -> RoadUserEnv:
    env = gymnasium.make(name, **QUICK | keywords).unwrapped
    assert isinstance(env, RoadUserEnv)
    return env


def slots_of(env: RoadUserEnv) -> SpawnedSlots:
    """The slots of a simulation that is in this process."""
    inner = env._simulation._work._env
    assert inner is not None
    assert isinstance(inner.slots, SpawnedSlots)
    return inner.slots


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


@pytest.mark.parametrize(
    "keywords",
    [
        {"id": "slrl_sumo/Intersection-v0"},
        pytest.param({"id": "slrl_sumo/SharedSpace-v0"}, marks=pytest.mark.slow),
        pytest.param({"id": "slrl_sumo/Random-v0"}, marks=pytest.mark.slow),
        pytest.param({"id": "slrl_sumo/RoadUser-v0", "scenario": "signalised", "image": True}, marks=pytest.mark.slow),
        pytest.param(
            {"id": "slrl_sumo/RoadUser-v0", "scenario": "district", "takeover": "car=0.5", "warm_up": 60.0},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_gymnasium_finds_nothing_to_complain_of(keywords: dict[str, Any]) -> None:
    assert keywords["id"] in IDS
    env = gymnasium.make(**{"agents": 4, "warm_up": 0.0} | keywords).unwrapped
    check_env(env)
    env.close()


@pytest.mark.parametrize(
    ("imports", "name"),
    [
        ("import slrl_sumo, gymnasium", "slrl_sumo/Intersection-v0"),
        ("import gymnasium, slrl_sumo", "slrl_sumo/Intersection-v0"),
        ("import gymnasium", "slrl_sumo:slrl_sumo/Intersection-v0"),
    ],
)
def test_the_ids_are_there_after_the_import_which_is_cheap(imports: str, name: str) -> None:
    script = (
        "import sys, slrl_sumo.environment_ids\n"
        "assert not {'torch', 'libsumo', 'gymnasium', 'pettingzoo'} & set(sys.modules)\n"
        "for module in [name for name in sys.modules if name.startswith('slrl_sumo')]: del sys.modules[module]\n"
        "sys.meta_path = [finder for finder in sys.meta_path if 'Gymnasium' not in type(finder).__name__]\n"
        f"{imports}\n"
        f"print(gymnasium.spec({name.split(':')[-1]!r}).kwargs if ':' not in {name!r} else "
        f"gymnasium.make({name!r}).unwrapped._scenario)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert "intersection" in done.stdout


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_stable_baselines_trains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from stable_baselines3 import PPO

    monkeypatch.setenv("SB3_LOGDIR", str(tmp_path))
    env = gymnasium.make("slrl_sumo/Intersection-v0", episode_steps=16, agents=4)
    with torch.random.fork_rng():
        model = PPO("MultiInputPolicy", env, n_steps=64, batch_size=32, n_epochs=1, seed=1, device="cpu")
        before = {name: values.clone() for name, values in model.policy.state_dict().items()}
        model.learn(128)
    changed = [name for name, values in model.policy.state_dict().items() if not torch.equal(values, before[name])]
    assert any("policy_net" in name for name in changed)
    assert any("action_net" in name for name in changed)
    assert len(model.ep_info_buffer) >= 4  # episodes ended and were counted
    env.close()


@pytest.mark.usefixtures("here")
def test_same_seed_and_actions_same_episodes() -> None:
    env = make(episode_steps=10)
    first, again, other = play(env, 3, 35), play(env, 3, 35), play(env, 4, 35)
    np.testing.assert_equal(first, again)
    with pytest.raises(AssertionError):
        np.testing.assert_equal(first, other)
    assert sum(step[2] or step[3] for step in first if len(step) == 5) >= 3


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_an_episode_that_goes_on_in_the_same_traffic_begins_elsewhere() -> None:
    env = make(episode_steps=5, ego="car")
    env.reset(seed=3)
    while True:
        here = position(env)
        observation, _, terminated, truncated, _ = env.step(np.int64(0))
        if terminated or truncated:
            break
    time = slots_of(env).arena.world.time
    begin, info = env.reset()
    assert slots_of(env).arena.world.time == time > 8.0
    assert np.hypot(*(position(env) - here)) > 10.0
    assert not np.array_equal(begin["rollouts"], observation["rollouts"])
    assert "terms" not in info
    # An episode that was broken off is not taken up again: SUMO begins anew.
    env.step(np.int64(0))
    env.reset()
    assert slots_of(env).arena.world.time < time


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_sumo_begins_anew_before_the_traffic_runs_out(copy_scenario: Any) -> None:
    short = copy_scenario("intersection", (".sumocfg", '<end value="600"/>', '<end value="14"/>'))
    env = make(scenario=str(short), episode_steps=4, others="sumo")
    env.reset(seed=1)
    times = []
    for _ in range(30):
        _, _, terminated, truncated, _ = env.step(np.int64(0))
        times.append(slots_of(env).arena.world.time)
        if terminated or truncated:
            env.reset()
    assert max(times) <= 14.5
    assert (np.diff(times) < 0).any()


def position(env: RoadUserEnv) -> np.ndarray:
    world = slots_of(env).arena.world
    return np.array([world.x[env._slot], world.y[env._slot]])


@pytest.mark.usefixtures("here")
def test_time_truncates_and_no_sooner() -> None:
    env = make(episode_steps=6, others="sumo", ego="pedestrian")
    env.reset(seed=5)
    ends = [env.step(np.int64(3))[2:4] for _ in range(6)]
    assert ends == [(False, False)] * 5 + [(False, True)]
    with pytest.raises(ResetNeeded, match="the episode is over"):
        env.step(np.int64(3))
    env.close()
    with pytest.raises(ResetNeeded, match="no episode has begun"):
        env.step(np.int64(3))


def test_options_of_a_reset_that_are_unknown_are_named() -> None:
    message = "reset: there is no option 'scen'; did you mean 'scenario'"
    with pytest.raises(InputError, match=message):
        make().reset(seed=1, options={"scen": "signalised"})
    with pytest.raises(InputError, match=message):
        gymnasium.make_vec("slrl_sumo/Intersection-v0", 2, **QUICK).reset(seed=1, options={"scen": "signalised"})


def test_keywords_of_vector_environments_that_are_unknown_are_named() -> None:
    with pytest.raises(
        InputError, match="there is no keyword 'agents'; there are scenario, num_envs, others, takeover"
    ):
        gymnasium.make_vec("slrl_sumo/Intersection-v0", 2, agents=2)


@pytest.mark.usefixtures("here")
def test_contact_terminates() -> None:
    env = make(ego="car")
    env.reset(seed=1)
    arena, slot = slots_of(env).arena, env._slot
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


@pytest.mark.usefixtures("here")
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


@pytest.mark.usefixtures("here")
def test_among_sumos_own_the_ego_is_alone() -> None:
    env = make(others="sumo", agents=30)
    env.reset(seed=1)
    world = slots_of(env).arena.world
    assert world.learned.sum() == 1
    assert len(world) > 1


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("others", ["prior", "sumo"])
@pytest.mark.parametrize("ego", ["bicycle", "pedestrian"])
def test_the_ego_is_of_the_type_asked_for(ego: Any, others: Any) -> None:
    env = make(ego=ego, others=others, warm_up=0.0)
    observation, info = env.reset(seed=1)
    assert info["type"] == ego
    assert info["id"].startswith(f"learned_{ego}.")
    assert observation["vector"][2:5].tolist() == [float(ego == name) for name in ("car", "bicycle", "pedestrian")]


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_without_a_wish_egos_are_of_all_types() -> None:
    env = make(warm_up=0.0)
    assert {env.reset(seed=seed)[1]["type"] for seed in range(8)} == {"car", "bicycle", "pedestrian"}


def test_with_a_takeover_the_ego_goes_to_its_destination() -> None:
    env = make(takeover={"pedestrian": 1}, warm_up=60.0, others="rule", agents=24)
    _, first = env.reset(seed=5)
    assert first["type"] == "pedestrian"
    for _ in range(400):
        assert env._reply is not None
        rollouts = dict(zip(PolicyConfig(preset="extended").rollout_features, env._reply.seen["rollouts"][env._slot].T,
                            strict=True))  # fmt: skip
        action = (3.0 * rollouts["heading_error"] + 5.0 * rollouts["collision"] - rollouts["speed"]).argmin()
        _, _, terminated, truncated, info = env.step(np.int64(action))
        if terminated or truncated:
            break
    assert terminated
    assert info["reached"]
    assert info["id"] == first["id"]
    env.close()


@pytest.mark.usefixtures("here")
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


@pytest.mark.usefixtures("here")
def test_the_last_picture_shows_the_end_and_not_the_next_place() -> None:
    env = make(render_mode="rgb_array", ego="car", others="sumo", episode_steps=3)
    env.reset(seed=1)
    for _ in range(3):
        near = position(env)
        *_, truncated, info = env.step(np.int64(0))
    assert truncated
    shown = slots_of(env).world
    moved = np.hypot(shown.x[0] - near[0], shown.y[0] - near[1])
    assert moved == pytest.approx(0.4 * info["speed_mps"], abs=0.02)
    assert np.hypot(*(position(env) - near)) > 5.0
    last = env.render()
    env.reset()
    assert not np.array_equal(env.render(), last)


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_random_networks_come_from_the_seed_and_leave_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    env = make("slrl_sumo/Random-v0")
    first, other, again = (env.reset(seed=seed) for seed in (1, 2, 1))
    np.testing.assert_array_equal(first[0]["rollouts"], again[0]["rollouts"])
    assert first[1]["scenario"] == again[1]["scenario"] != other[1]["scenario"]
    assert env.reset()[1]["scenario"] != first[1]["scenario"]
    assert len(list(tmp_path.glob("*/random-*"))) == 1
    env.close()
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("here")
def test_options_switch_the_scenario_from_then_on() -> None:
    env = make(warm_up=0.0)
    assert env.reset(seed=1)[1]["scenario"] == "intersection"
    assert env.reset(options={"scenario": "shared-space"})[1]["scenario"] == "shared-space"
    assert env.reset(seed=1)[1]["scenario"] == "shared-space"


def test_environments_side_by_side_in_one_process() -> None:
    first, second = make(agents=2), make(agents=2)
    threads = torch.get_num_threads()
    one, two = first.reset(seed=1), second.reset(seed=1)
    np.testing.assert_equal(one, two)
    np.testing.assert_equal(first.step(np.int64(0)), second.step(np.int64(0)))
    first.close()
    second.step(np.int64(0))
    second.close()
    assert torch.get_num_threads() == threads
    assert not libsumo.isLoaded()


def test_a_simulation_of_the_users_own_is_left_alone(copy_scenario: Any) -> None:
    libsumo.start(["sumo", "-c", str(copy_scenario("intersection")), "--no-step-log"])
    try:
        env = make(agents=2)
        env.reset(seed=1)
        libsumo.simulationStep()
        env.close()
    finally:
        libsumo.close()


@pytest.mark.slow
def test_workers_of_gymnasium_have_the_simulation_in_themselves() -> None:
    envs = gymnasium.make_vec("slrl_sumo/Intersection-v0", 2, "async", agents=2, **QUICK)
    seen, _ = envs.reset(seed=[1, 1])
    np.testing.assert_array_equal(seen["vector"][0], seen["vector"][1])
    envs.step(np.zeros(2, np.int64))
    envs.close()


@pytest.mark.usefixtures("here")
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
        ({"others": "lane"}, "others='lane'.*'sampled'"),
        ({"preset": "large"}, "preset='large'.*'extended'"),
        ({"agents": 0}, "agents=0"),
        ({"episode_steps": 0}, "episode_steps=0"),
        ({"scenario": "nowhere"}, "nowhere: no such"),
        ({"bundle": "nothing"}, "nothing"),
        ({"takeover": {"car": 1}, "mix": {"car": 1}}, "leave one of"),
        ({"takeover": {"car": 2}}, "takeover=.*from 0 to 1"),
        ({"takeover": {"car": 1}, "others": "sumo"}, "others='sumo': not with `takeover`.*'rule'"),
        ({"epsiode_steps": 3}, "there is no keyword 'epsiode_steps'; did you mean 'episode_steps'\\?"),
        ({"egos": "car"}, "there is no keyword 'egos'; did you mean 'ego'\\?"),
        ({"agents": 2.5}, "agents=2.5: give a whole number from 1 to"),
        ({"episode_steps": 2.5}, "episode_steps=2.5: give a whole number from 1 to"),
        ({"warm_up": float("nan")}, "warm_up=nan: give a number from 0 to"),
        ({"warm_up": -1}, "warm_up=-1: give a number from 0 to"),
        ({"weights": {"close": 1}}, "weights={'close': 1}: give RewardWeights"),
        ({"weights": RewardWeights(red=float("inf"))}, "weights: red is inf; give finite numbers"),
        ({"reward": 3}, "reward=3: give a function"),
        ({"observe": 3, "observation_space": ACTION_SPACE}, "observe=3: give a function"),
        ({"others": "greedy", "preset": "paper"}, "others='greedy': it sees the preset 'extended'"),
        ({"observe": lambda situation: situation}, "give `observe` and `observation_space` together"),
    ],
)
def test_what_cannot_be_used_is_said_when_it_is_made(keywords: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        RoadUserEnv(**{"scenario": "intersection"} | keywords)


def test_a_bundle_without_a_trained_selector_has_no_greedy_others(tmp_path: Path) -> None:
    replace(load_bundle("intersection"), policy=None).save(tmp_path / "untrained")
    with pytest.raises(InputError, match="no trained selector"):
        RoadUserEnv(scenario="intersection", bundle=str(tmp_path / "untrained"), others="greedy")


@pytest.mark.usefixtures("here")
def test_a_bundle_without_a_trained_selector_is_observed_with_routes(tmp_path: Path) -> None:
    replace(load_bundle("intersection"), policy=None).save(tmp_path / "untrained")
    env = make(bundle=str(tmp_path / "untrained"), agents=2)
    seen, _ = env.reset(seed=1)
    assert "route" in seen
    env.step(np.int64(0))


@pytest.mark.usefixtures("here")
def test_wishes_that_the_scenario_cannot_meet_are_named() -> None:
    env = make(ego="bicycle", agents=1)
    with pytest.raises(InputError, match=r"none of the 1 learned road users .* is a bicycle"):
        env.reset(seed=1)


@pytest.mark.usefixtures("here")
def test_actions_beyond_the_modes_are_refused() -> None:
    env = make()
    env.reset(seed=1)
    with pytest.raises(InvalidAction, match="0 to 19"):
        env.step(np.int64(20))


@pytest.mark.usefixtures("here")
def test_the_preset_says_what_the_ego_knows() -> None:
    env = make(preset="extended", ego="car", agents=6, image=True)
    seen, _ = env.reset(seed=2)
    route = dict(zip(ROUTE_FEATURES, seen["route"].tolist(), strict=True))
    assert route["known"] == 1.0
    assert route["lateral_offset"] == pytest.approx(0.0, abs=0.3)
    assert route["desired_speed"] > 0.5
    magenta = (seen["image"] == [255, 0, 255]).all(axis=-1)
    assert magenta.any()
    # Some modes brake to a stand.
    assert any(env.step(np.int64(mode))[4]["terms"]["progress"] != 0.0 for mode in range(10))
    env.close()
    # Without it nothing of that is there.
    plain = make(preset="paper", ego="car", agents=6, image=True)
    seen, _ = plain.reset(seed=2)
    assert set(seen) == {"vector", "image", "rollouts", "action_mask"}
    assert seen["rollouts"].shape == (20, 4)
    assert not (seen["image"] == [255, 0, 255]).all(axis=-1).any()


@pytest.mark.usefixtures("here")
def test_others_see_images_that_the_ego_does_not_see(tmp_path: Path) -> None:
    policy = Policy(PolicyConfig(preset="extended", hidden=16, head=8, image=True))
    replace(load_bundle("intersection"), policy=policy).save(tmp_path / "bundle")
    env = make(bundle=str(tmp_path / "bundle"), others="greedy", agents=4, image=False)
    seen, _ = env.reset(seed=1)
    assert "image" not in seen
    env.step(np.int64(0))
