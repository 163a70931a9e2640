"""A training as a whole: it resumes exactly, and wrong settings are said in one line."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import torch

from slrl_sumo.agent.mode_cost import CostWeights
from slrl_sumo.errors import InputError
from slrl_sumo.learning.environments.arena import ArenaSettings
from slrl_sumo.learning.rl.imitation import ImitationSettings
from slrl_sumo.learning.rl.ppo import PpoSettings
from slrl_sumo.learning.rl.train import TrainRequest, going_on, train
from slrl_sumo.learning.rl.training_settings import (
    NOT_FOR_USERS,
    RANGES,
    NetworkSettings,
    TrainSettings,
    read_settings,
    recorded_settings,
)
from slrl_sumo.models.bundle import load_bundle
from slrl_sumo.models.policy import Policy
from slrl_sumo.models.policy_config import PolicyConfig

SELECTORS = Path(__file__).parents[3] / "tools" / "selectors"
SHARED_SPACE_PARTS = ("shared-space-further", "shared-space-crowded")
SETTINGS = TrainSettings(
    ppo=PpoSettings(num_steps=4, num_minibatches=2, update_epochs=1),
    arena=ArenaSettings(agents=8, warm_up=0.0, episode_steps=4),
    policy=PolicyConfig(channels=(4, 4), hidden=16, head=8),
    networks=NetworkSettings(count=2, reset_every=2),
    imitation=ImitationSettings(epochs=1, seconds=30.0),
)


class _StoppedError(Exception):
    pass


def _train(out: Path, *, resume: bool = False, stop_after: int | None = None) -> list[dict[str, float]]:
    request = TrainRequest("shared-space", "intersection", out, steps=6 * 32, workers=1)
    seen: list[dict[str, float]] = []
    stages: list[str] = []

    def report(stage: str, done: int, total: int, figures: dict[str, float]) -> None:
        stages.append(stage)
        if stage != "training":
            return
        assert total == 6 * 32
        seen.append({"done": done, **figures})
        if stop_after is not None and done == stop_after * 32:
            raise _StoppedError

    if stop_after is None:
        train(request, SETTINGS, resume=resume, report=report)
    else:
        with pytest.raises(_StoppedError):
            train(request, SETTINGS, resume=resume, report=report)
    # A resumed training has imitated already.
    assert stages[0] == ("training" if resume else "recording")
    return seen


def _comparable(rows: list[dict[str, float]]) -> list[Any]:
    """Figures as text, so that NaN equals NaN, without those of the clock."""
    return [{k: repr(v) for k, v in row.items() if not k.startswith("speed/") and k[-2:] != "_s"} for row in rows]


@pytest.mark.slow
def test_a_stopped_training_resumes_exactly(tmp_path: Path) -> None:
    whole = _train(tmp_path / "whole")
    begun = _train(tmp_path / "parts", stop_after=4)  # the checkpoint is that of update 2: 3 and 4 are done again
    rest = _train(tmp_path / "parts", resume=True)
    assert rest[0]["done"] == 3 * 32
    assert _comparable(begun[:2] + rest) == _comparable(whole)
    same, other = (tmp_path / name / "selector.safetensors" for name in ("whole", "parts"))
    assert same.read_bytes() == other.read_bytes()
    logs = [(tmp_path / f"{name}-training" / "log.csv").read_text().splitlines() for name in ("whole", "parts")]
    assert len(logs[0]) == len(logs[1]) == 1 + 6

    bundle = load_bundle(tmp_path / "whole")
    assert bundle.policy is not None
    assert bundle.policy_training is not None
    assert bundle.policy_training["steps"] == 6 * 32
    assert "## Selector" in bundle.card
    before = load_bundle("intersection")
    assert before.policy is None or before.card.count("## Selector") == 1
    assert bundle.card.startswith(before.card.split("\n## Selector")[0].rstrip("\n"))

    request = TrainRequest("shared-space", "intersection", tmp_path / "whole", steps=6 * 32, workers=1)
    nothing = lambda *_: None  # noqa: E731
    with pytest.raises(InputError, match="holds a training already; continue it with `resume=True`"):
        train(request, SETTINGS, resume=False, report=nothing)
    with pytest.raises(InputError, match=r"started with another seed \(1 then, 2 now\)"):
        train(replace(request, seed=2), SETTINGS, resume=True, report=nothing)
    with pytest.raises(InputError, match=r"started with another settings.ppo.gamma"):
        train(request, replace(SETTINGS, ppo=replace(SETTINGS.ppo, gamma=0.5)), resume=True, report=nothing)
    with pytest.raises(InputError, match=r"started with another steps \(192 then, 96 now\)"):
        train(replace(request, steps=3 * 32), SETTINGS, resume=True, report=nothing)

    # For more steps than were asked for it goes on where it ended, unless that was between two starts.
    done: list[int] = []
    longer = train(
        replace(request, steps=7 * 32),
        SETTINGS,
        resume=True,
        report=lambda stage, now, total, figures: done.append(now),
    )
    assert done == [7 * 32]
    assert longer.policy_training is not None
    assert longer.policy_training["steps"] == 7 * 32
    assert (tmp_path / "whole" / "selector.safetensors").read_bytes() != other.read_bytes()
    with pytest.raises(InputError, match="ended after 7 updates, in the middle of 2"):
        train(replace(request, steps=8 * 32), SETTINGS, resume=True, report=nothing)


@pytest.mark.slow
def test_the_preset_extended_is_taught_by_looking_ahead_and_reads_the_route(tmp_path: Path) -> None:
    settings = replace(SETTINGS, policy=replace(SETTINGS.policy, preset="extended"))
    request = TrainRequest("signalised", "intersection", tmp_path / "routes", steps=2 * 32, workers=1)
    stages: list[str] = []
    figures: dict[str, float] = {}

    def report(stage: str, done: int, total: int, latest: dict[str, float]) -> None:
        stages.append(stage)
        figures.update(latest)

    train(request, settings, resume=False, report=report)
    assert stages == ["training"] * 2  # recordings know no routes
    assert {f"reward/{name}" for name in ("progress", "off_path", "red", "priority")} <= set(figures)
    trained = load_bundle(tmp_path / "routes").policy
    assert trained is not None
    assert trained.config == replace(settings.policy, modes=20)
    torch.manual_seed(request.seed)
    begin = Policy(trained.config).state_dict()
    columns = trained.config.route_columns
    weights = "trunk.0.weight"
    assert not torch.equal(trained.state_dict()[weights][:, -columns:], begin[weights][:, -columns:])


def test_shipped_settings_of_selectors_can_be_read() -> None:
    presets = {file.stem: read_settings(file).policy.preset for file in sorted(SELECTORS.glob("*.toml"))}
    assert presets.pop("ablation") == "paper"
    assert presets.pop("ablation-routes") == "extended"
    # Settings of further parts tell only what differs from the part before.
    for *earlier, last in (("intersection", "intersection-further"), ("shared-space", *SHARED_SPACE_PARTS)):
        known = None
        for part in (*earlier, last):
            known = read_settings(SELECTORS / f"{part}.toml", known)
            assert known.policy.preset == "extended"
            assert part == earlier[0] or presets.pop(part) == "paper"
    assert presets == {
        "intersection": "extended",
        "intersection-image": "image",
        "intersection-paper": "paper",
        "shared-space": "extended",
        "shared-space-paper": "paper",
    }


def test_the_shipped_selector_records_the_settings_of_its_recipe() -> None:
    """Of its second part, so that `--from` goes on with them."""
    bundle = load_bundle("intersection")
    recorded = recorded_settings(bundle)
    first = read_settings(SELECTORS / "intersection.toml")
    assert recorded == going_on(read_settings(SELECTORS / "intersection-further.toml", first), bundle)
    assert recorded.arena.trips
    assert recorded_settings(replace(bundle, policy_training=None)) == TrainSettings()


def test_a_file_changes_the_settings_that_go_on(tmp_path: Path) -> None:
    file = tmp_path / "s.toml"
    file.write_text("[ppo]\nlearning_rate = 1e-4\n")
    recorded = recorded_settings(load_bundle("intersection"))
    changed = read_settings(file, recorded)
    assert changed == replace(recorded, ppo=replace(recorded.ppo, learning_rate=1e-4))


def test_one_that_goes_on_keeps_the_teacher_of_the_types_that_keep_it() -> None:
    bundle = load_bundle("intersection")
    settings = going_on(recorded_settings(bundle), bundle)
    assert settings.imitation.epochs == settings.ppo.teacher_first == 0
    # That of all others has no weight from the first update on.
    assert settings.ppo.kl_until == settings.ppo.kl_coef_last == 0.0
    assert settings.ppo.kl_kept == ("pedestrian",)
    assert settings.ppo.kl_coef > 0.0


def test_no_file_is_all_defaults_and_a_file_changes_what_it_names(tmp_path: Path) -> None:
    assert read_settings(None) == TrainSettings()
    file = tmp_path / "s.toml"
    file.write_text(
        "[ppo]\ngamma = 0.9\nonly = ['car']\n[reward]\nclose = 2\n[arena]\nmix = [0.2, 0.3, 0.5]\n[policy]\n"
        "channels = [4]\npreset = 'extended'\n[teacher]\nheading_error = 7\n"
    )
    settings = read_settings(file)
    assert settings.ppo == replace(PpoSettings(), gamma=0.9, only=("car",))
    assert settings.reward.close == 2.0
    assert settings.arena.mix == (0.2, 0.3, 0.5)
    assert settings.arena.staggered
    assert settings.policy.channels == (4,)
    assert settings.policy.preset == "extended"
    assert settings.teacher == CostWeights(heading_error=7.0)
    # Without asking for it, a policy needs no routes.
    assert TrainSettings().policy.preset == "paper"


def test_a_training_that_diverges_ends_with_an_error_and_without_a_bundle(tmp_path: Path) -> None:
    ppo = replace(SETTINGS.ppo, learning_rate=1e30, teacher_first=0)
    arena, policy = replace(SETTINGS.arena, agents=4), replace(SETTINGS.policy, preset="extended")
    request = TrainRequest("signalised", "intersection", tmp_path / "diverged", steps=3 * 16, workers=1)
    updates: list[int] = []
    with pytest.raises(InputError, match=r"the \w+_loss of update 1 is (nan|inf); lower the learning_rate"):
        train(
            request,
            replace(SETTINGS, ppo=ppo, arena=arena, policy=policy),
            resume=False,
            report=lambda stage, done, total, figures: updates.append(done),
        )
    assert updates == [16]
    assert not request.out.exists()


def test_all_numbers_of_the_settings_have_ranges() -> None:
    numbers = set()
    for section, values in asdict(TrainSettings()).items():
        for key, value in values.items():
            kind = str(get_type_hints(type(getattr(TrainSettings(), section)))[key])
            if key in NOT_FOR_USERS.get(section, ()) or isinstance(value, bool | str) or "str" in kind:
                continue
            numbers.add((section, key))
    assert numbers == set(RANGES)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[ppo]\nlearning_rte = 1e-3", "has no setting 'learning_rte'; did you mean 'learning_rate'?"),
        ("[rewards]\nclose = 1", r"no section \[rewards\]; did you mean 'reward'?"),
        ("gamma = 1", r"no section \[gamma\]"),
        ("[arena]\nweights = 1", "has no setting 'weights'"),
        ("[ppo]\ngamma = 'high'", r"\[ppo\] gamma is 'high': give a number"),
        ("[ppo]\nnum_steps = 1.5", "give a whole number"),
        ("[ppo]\nnorm_adv = 1", "give true or false"),
        ("[arena]\nmix = [1.0]", "give a list of 3 numbers"),
        ("[ppo]\ngamma = 1.5", "gamma is 1.5: give a number from 0 to 1"),
        ("[policy]\npreset = 'future'", r"\[policy\] preset is 'future': give paper or image or extended"),
        ("[policy]\npreset = 3", r"\[policy\] preset is 3: give paper or image or extended"),
        ("[ppo]\nonly = ['bus']", r"\[ppo\] only is 'bus': give car or bicycle or pedestrian"),
        ("[ppo]\nonly = 'car'", "give a list of several names"),
        ("[arena]\nextended = true", "has no setting 'extended'"),
        ("[teacher]\nheading_eror = 1", "has no setting 'heading_eror'; did you mean 'heading_error'?"),
        ("[reward]\nclose = nan", r"\[reward\] close is nan: give a number from 0 to 1e\+06"),
        ("[teacher]\nspeed = inf", r"\[teacher\] speed is inf: give a number from 0"),
        ("[ppo]\nclip_coef = -1", "clip_coef is -1: give a number from 0.001 to 1"),
        ("[policy]\nhidden = 0", "hidden is 0: give a number from 1 to 4096"),
        ("[policy]\nchannels = [4, 0]", "channels is 0: give a number from 1 to 4096"),
        (f"[policy]\nchannels = {[4] * 15}", "channels has 15 numbers: give at most 14"),
        ("[arena]\ndesired_speed = [nan, 4.0, 1.0]", "desired_speed is nan: give a number from 0.1 to 50"),
        ("[arena]\nmix = [0, 0, 0]", "mix is all zeros: give at least one type a share above 0"),
        ("[ppo", "is no TOML"),
    ],
)
def test_wrong_settings_are_said_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "s.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_settings(file)
    assert len(str(error.value).splitlines()) == 1
    assert str(file) in str(error.value)
