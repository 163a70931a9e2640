"""Training a selector from a bundle: networks, PPO, checkpoints, logs, and the bundle with its selector.

The folder OUT-training beside the bundle OUT holds everything that is needed to resume the training:

settings.json     request and settings
networks/         generated scenarios
checkpoint.pt     policy, optimiser and number of updates
log.csv           figures of every update; tensorboard/ has the same as charts
"""

import json
import math
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, get_args

import torch

from slrl_sumo.errors import InputError, check_whole_number
from slrl_sumo.formats.trajectory_file import load_trajectories
from slrl_sumo.ground.mask import everywhere_road
from slrl_sumo.jobs.pool import MAX_WORKERS, Backend, portable_name
from slrl_sumo.learning.environments.source import ArenaSource
from slrl_sumo.learning.rl.actor import Agent
from slrl_sumo.learning.rl.batch import Batch
from slrl_sumo.learning.rl.checkpoint import read_checkpoint, read_record, restore, save_checkpoint, write_record
from slrl_sumo.learning.rl.imitation import demonstrations, imitate, recorded_traffic
from slrl_sumo.learning.rl.ppo import learn
from slrl_sumo.learning.rl.rollouts import WorkerRollouts
from slrl_sumo.learning.rl.selector_card import with_selector
from slrl_sumo.learning.rl.training_log import EpisodeFigures, Figures, TrainingLog, read_rows
from slrl_sumo.learning.rl.training_settings import TrainSettings
from slrl_sumo.models.bundle import ModelBundle, load_bundle
from slrl_sumo.models.bundle_folder import shipped_bundles
from slrl_sumo.models.policy import Policy
from slrl_sumo.netgen.errors import NetgenError
from slrl_sumo.netgen.families import Family, generate
from slrl_sumo.perception.presets import PRESETS, vector_for
from slrl_sumo.sumo.scenario import find_scenario

Report = Callable[[str, int, int, Figures], None]
"""Called with a stage, its completed amount, its total, and its figures."""


@dataclass(frozen=True)
class TrainRequest:
    """Request of a training; fields are named as in `slrl-sumo train`."""

    scenarios: str
    """Families (intersection, roundabout, shared-space, random, town) or scenarios, separated by commas."""
    bundle: str
    out: Path
    steps: int
    """Total number of agent-steps."""
    workers: int = 2
    seed: int = 1
    device: str = "auto"
    threads: int | None = None
    """Number of PyTorch threads in the update; None: the number of workers, which are idle then, but at most the number
    of cores. On busy cores, threads that wait for each other slow updates down, ten times if they spin
    (OMP_WAIT_POLICY)."""

    recordings: tuple[Path, ...] = ()
    """Trajectories to imitate, in addition to plain SUMO traffic in the scenarios."""

    ray: str | None = None
    """Ray cluster of the simulations, see slrl_sumo.jobs.pool.Backend. The result does not depend on it."""
    goes_on: bool = False
    """Whether the training starts from the selector of the bundle, without imitation, and with a teacher only for the
    types `kl_kept`."""

    def __post_init__(self) -> None:
        check_whole_number("steps", self.steps, 1, 10**12)
        check_whole_number("workers", self.workers, 1, MAX_WORKERS)
        check_whole_number("threads", 1 if self.threads is None else self.threads, 1, 1024)
        check_whole_number("seed", self.seed, 0, 2**31 - 1)

    @property
    def folder(self) -> Path:
        """Folder of checkpoints and logs."""
        return self.out.parent / f"{self.out.name}-training"


def train(request: TrainRequest, settings: TrainSettings, *, resume: bool, report: Report) -> ModelBundle:
    """Train a selector, save the bundle with it as `request.out`, and return the bundle.

    The policy is trained by imitation first (slrl_sumo.learning.rl.imitation), then by PPO. `report` is called for the
    stages "recording" and "imitation", then for "training" with agent-steps and the figures of each update (see
    EpisodeFigures). With `resume`, the training continues from its last checkpoint, exactly as without the
    interruption, or for more steps than before (learning_rate and kl_coef then follow the new total); otherwise the
    folder must not contain a checkpoint. Raises InputError, also if figures or weights are no longer finite, and
    SumoError if a worker fails repeatedly.
    """
    bundle, device = load_bundle(request.bundle), _device(request.device)
    if request.goes_on:
        settings = going_on(settings, bundle)
    folder = request.folder
    rollout_size = request.workers * settings.arena.agents * settings.ppo.num_steps
    total = max(1, round(request.steps / rollout_size))
    record = _record(request, settings)
    state = _prepare(folder, record, resume)
    if state is not None:
        imitated = read_record(folder / "imitation.json")
    rows = [] if state is None else read_rows(folder, state["iteration"])
    scenarios = _scenarios(request.scenarios, settings, folder / "networks")
    torch.set_num_threads(request.threads or min(request.workers, os.cpu_count() or 1))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(request.seed)
        policy = Policy(replace(settings.policy, modes=bundle.config.modes))
    if request.goes_on and bundle.policy is not None:
        policy.load_state_dict(bundle.policy.state_dict())
    agent = Agent(policy, bundle.prior, settings.ppo.explore, settings.ppo.learning_rate, device)
    done = 0
    if state is None:
        imitated = _imitated(policy, bundle, request, scenarios, settings, report)
        _check_weights(policy, "imitation")
        write_record(folder / "imitation.json", imitated)
        agent.begin.load_state_dict(policy.state_dict())
        save_checkpoint(folder, agent, 0)
    else:
        done = state["iteration"]
        if not 0 <= done <= 10**12:
            raise InputError(f"{folder}: its checkpoint is damaged ({done} updates); delete it to start again")
        if done < total and done % settings.networks.reset_every:
            raise InputError(
                f"{folder}: ended after {done} updates, in the middle of {settings.networks.reset_every} with the same "
                "simulations, and cannot be resumed; start a new training with more `steps`"
            )
        restore(agent, state, folder / "checkpoint.pt")
    preset, image = settings.policy.preset, settings.policy.image
    seen = replace(settings.arena, preset=preset, image=image, state=vector_for(bundle.config.preset, preset))
    arena = replace(seen, weights=settings.reward, teacher=settings.teacher)
    source = ArenaSource(tuple(map(portable_name, scenarios)), portable_name(request.bundle, shipped_bundles()), arena)
    log = TrainingLog(folder, rows, done, rollout_size)
    rollouts = WorkerRollouts(source, policy.config, settings.ppo.explore, Backend(request.workers, request.ray))
    episodes = EpisodeFigures(request.workers * arena.agents)
    reset_every = settings.networks.reset_every
    clock = time.perf_counter()

    def after(iteration: int, batch: Batch, infos: list[dict[str, Any]], losses: dict[str, float]) -> None:
        nonlocal clock
        if iteration % reset_every == 0:
            episodes.start()
        now = time.perf_counter()
        speed = {"speed/agent_steps_per_s": rollout_size / (now - clock), "speed/workers_replaced": rollouts.replaced}
        clock = now
        figures = episodes.figures(batch, infos) | {f"loss/{name}": value for name, value in losses.items()} | speed
        log.add(iteration, figures)
        report("training", (iteration + 1) * rollout_size, total * rollout_size, figures)
        _check_finite({"reward": float(batch.rewards.sum()), **losses}, f"update {iteration + 1}")
        _check_weights(agent.policy, f"update {iteration + 1}")
        if (iteration + 1) % reset_every == 0 or iteration + 1 == total:
            save_checkpoint(folder, agent, iteration + 1)

    try:
        learn(
            agent,
            rollouts,
            settings.ppo,
            iterations=range(done, total),
            total=total,
            reset_every=reset_every,
            seed=request.seed,
            after=after,
        )
    finally:
        rollouts.close()
        log.close()
    trained = with_selector(bundle, agent.policy.cpu(), record | {"imitation": imitated}, log.rows)
    trained = replace(trained, name=request.out.name)
    trained.save(request.out)
    return trained


def going_on(settings: TrainSettings, bundle: ModelBundle) -> TrainSettings:
    """Settings of a training that starts from the selector of `bundle`: its shapes, no imitation, and a teacher only
    for the types `kl_kept`."""
    if bundle.policy is None:
        raise InputError(f"bundle {bundle.name}: it has no trained selector to go on from; give it as `bundle`")
    ppo = replace(settings.ppo, kl_coef_last=0.0, kl_until=0.0, teacher_first=0)
    return replace(settings, policy=bundle.policy.config, ppo=ppo, imitation=replace(settings.imitation, epochs=0))


def _record(request: TrainRequest, settings: TrainSettings) -> dict[str, Any]:
    """Everything that determines the result, as JSON values."""
    asked = {
        "scenarios": request.scenarios,
        "bundle": request.bundle,
        "recordings": [path.name for path in request.recordings],
    }
    numbers = {"steps": request.steps, "workers": request.workers, "seed": request.seed, "goes_on": request.goes_on}
    return json.loads(json.dumps({**asked, **numbers, "settings": asdict(settings)}))  # type: ignore[no-any-return]


def _prepare(folder: Path, record: dict[str, Any], resume: bool) -> dict[str, Any] | None:
    """Create the folder of the training, or load the checkpoint to resume from."""
    checkpoint, asked = folder / "checkpoint.pt", folder / "settings.json"
    if checkpoint.exists() and not resume:
        raise InputError(f"{folder}: holds a training already; continue it with `resume=True`, or give another `out`")
    if resume and asked.exists():
        before = read_record(asked)
        steps = before.get("steps", 0)
        if not isinstance(steps, int):
            raise InputError(f"{asked}: is damaged (its steps are {steps!r}); delete {folder} to start again")
        longer = max(steps, record["steps"])
        odd = _difference(before | {"steps": longer}, record)
        if odd:
            raise InputError(f"{folder}: was started with another {odd}; resume with the same settings")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_record(asked, record)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); give another `out`") from None
    if not checkpoint.exists():
        return None
    return read_checkpoint(checkpoint)


def _difference(a: Any, b: Any, where: str = "") -> str:
    """The first key in which two JSON values differ, as section.key; empty if they are equal."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted(set(a) | set(b)):
            odd = _difference(a.get(key), b.get(key), f"{where}.{key}" if where else key)
            if odd:
                return odd
        return ""
    return "" if a == b else f"{where} ({a} then, {b} now)"


def _scenarios(text: str, settings: TrainSettings, folder: Path) -> tuple[str, ...]:
    """Scenarios of the training: scenarios named in `text`, and generated scenarios of families."""
    found: list[str] = []
    for name in (part.strip() for part in text.split(",")):
        if name not in get_args(Family):
            find_scenario(name)
            found.append(name)
            continue
        for seed in range(settings.networks.first_seed, settings.networks.first_seed + settings.networks.count):
            place = folder / f"{name}-{seed}"
            if not (place / f"{place.name}.sumocfg").exists():
                try:
                    generate(name, seed, place)
                except NetgenError as error:
                    raise InputError(str(error)) from None
            found.append(str(place))
    return tuple(found)


def _imitated(
    policy: Policy,
    bundle: ModelBundle,
    request: TrainRequest,
    scenarios: tuple[str, ...],
    settings: TrainSettings,
    report: Report,
) -> Figures:
    """Train `policy` by imitation; returns the last figures."""
    plan = settings.imitation
    last: Figures = {}
    # Recordings have no routes: selectors with routes learn in simulations only.
    if not plan.epochs or PRESETS[settings.policy.preset].knows_route:
        return last
    parts = []
    sources: tuple[Path | str, ...] = (*request.recordings, *scenarios)
    for number, source in enumerate(sources):
        report("recording", number, len(sources), last)
        if isinstance(source, Path):
            recording = load_trajectories(source)
            if not len(recording):
                raise InputError(f"--recording {source}: holds no road user; give recordings with some")
            ground = everywhere_road(recording.x, recording.y)
        else:
            # Use SUMO seeds, like the seeds of the networks, that no evaluation uses.
            seed = settings.networks.first_seed + number
            recording, ground = recorded_traffic(find_scenario(source), plan.seconds, seed)
        parts.append(demonstrations(recording, ground, bundle, plan.stride))

    def after(share: float, figures: Figures) -> None:
        last.update(figures)
        report("imitation", round(share * plan.epochs), plan.epochs, figures)

    imitate(policy, bundle, parts, plan, request.seed, after)
    return last


def _check_finite(figures: Figures, when: str) -> None:
    """Raise InputError if a figure is NaN or infinite."""
    for name, value in figures.items():
        if not math.isfinite(value):
            raise InputError(
                f"the training failed: the {name} of {when} is {value}; lower the learning_rate or the largest weights "
                "in `config`, and start again"
            )


def _check_weights(policy: Policy, when: str) -> None:
    """Like `_check_finite`, for the weights of the policy."""
    _check_finite({name: float(value.detach().sum()) for name, value in policy.named_parameters()}, when)


def _device(name: str) -> torch.device:
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError):
        raise InputError("PyTorch has no such device here; use cpu, or auto", argument="device", value=name) from None
    return torch.device(name)
