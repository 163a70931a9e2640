"""Cost of learned road users in a scenario, and of the bare library calls that they need."""

import statistics
import tempfile
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
from numpy.typing import NDArray

from slrl_sumo.agent.make_driver import TRAINED
from slrl_sumo.agent.model_driver import ModelDriver
from slrl_sumo.agent.stopwatch import PARTS, Stopwatch
from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.write import FcdWriter
from slrl_sumo.jobs.memory import peak_memory_mib
from slrl_sumo.metrics.counters import RunCounters
from slrl_sumo.models.bundle import ModelBundle, load_bundle, tensors
from slrl_sumo.models.bundle_folder import usual_selector_of
from slrl_sumo.models.threads import one_thread
from slrl_sumo.perception.ego_image import EGO_COLS, EGO_ROWS, FINE
from slrl_sumo.perception.observation import Observation, observe
from slrl_sumo.perception.scene import Scene
from slrl_sumo.scene.geometry import Floats
from slrl_sumo.scene.state import WorldState
from slrl_sumo.simulation.cosimulation import CoSimulation
from slrl_sumo.simulation.placement.spawn import type_counts
from slrl_sumo.simulation.preparation import with_learned
from slrl_sumo.simulation.shares import parse_mix
from slrl_sumo.studies.bench.measurement_process import DoesNotFit, Workload
from slrl_sumo.sumo.scenario import find_scenario
from slrl_sumo.sumo.session import SumoSession
from slrl_sumo.sumo.spawned import bare_moves

WARM_UP_DECISIONS = 10
"""Number of decisions before the measurement: the first decisions draw the ground and read all road users from SUMO."""
REPEATS = 20
"""Number of repetitions of each bare call, of which the median is used."""


@dataclass(frozen=True)
class LearnedCost:
    """Cost of a workload; seconds are per decision of all its road users."""

    selector: str
    substeps: int
    """SUMO steps per decision."""
    parts_s: dict[str, float]
    """Seconds by PARTS."""
    floor_s: dict[str, float]
    """Seconds of the bare library calls: moves, SUMO's steps, crops, displacement models, image encoder."""
    peak_memory_mib: float
    """Peak memory of the process until the last decision, without the bare calls."""


def measure_learned(work: Workload) -> Generator[None, None, LearnedCost]:
    """Run learned road users, with summary and XML trace, then the bare calls for the same ones, in this process.
    Yields once after the warm-up.

    Raises DoesNotFit if the scenario has no room, InputError if the workload is wrong, SumoError if SUMO fails.
    """
    cv2.setNumThreads(1)
    selector = work.selector or usual_selector_of(work.bundle)
    # The memory of a run with PyTorch includes PyTorch.
    bundle = load_bundle(work.bundle, policy=selector in TRAINED, training=False)
    stopwatch = Stopwatch()
    seconds: list[dict[str, float]] = []
    scenario = find_scenario(work.scenario)
    with SumoSession(scenario, seed=work.seed) as session, tempfile.TemporaryDirectory() as folder:
        cosimulation = with_learned(
            session, selector, bundle, work.seed, threads=work.threads, stopwatch=stopwatch, traced=True
        )
        counts, _ = type_counts(work.agents, parse_mix(work.mix), cosimulation.points, str(scenario.config), bundle)
        try:
            cosimulation.spawn(counts, bundle.max_speed, work.seed)
        except InputError as error:
            raise DoesNotFit(error.as_options()) from None
        start = cosimulation.start()
        counters = RunCounters(start.world)
        with FcdWriter(Path(folder) / "fcd.xml") as writer:
            for number in range(WARM_UP_DECISIONS + work.steps):
                if number == WARM_UP_DECISIONS:
                    yield
                stopwatch.take()
                with one_thread():
                    decision = cosimulation.decide()
                for step in decision.steps:
                    writer.write(step.time, step.world, step.places)
                counters.add(decision)
                stopwatch.lap("record")
                if number >= WARM_UP_DECISIONS:
                    seconds.append(stopwatch.take())
        memory = peak_memory_mib()
        driver = cosimulation.driver
        sees = isinstance(driver, ModelDriver) and driver.agent.selector.needs_image
        floor_s = _floor(session, cosimulation, bundle, work.steps, sees=sees)
    return LearnedCost(selector, session.substeps, typical(seconds), floor_s, memory)


def typical(seconds: list[dict[str, float]]) -> dict[str, float]:
    """Mean of each part over the middle half of the decisions, ordered by their sums: the parts of the result are
    additive, and disturbed decisions have no effect."""
    table = np.array([[decision[part] for part in PARTS] for decision in seconds])
    order = np.argsort(table.sum(axis=1))
    middle = order[len(order) // 4 : len(order) - len(order) // 4]
    return dict(zip(PARTS, table[middle].mean(axis=0).tolist(), strict=True))


def _floor(
    session: SumoSession, cosimulation: CoSimulation, bundle: ModelBundle, steps: int, *, sees: bool
) -> dict[str, float]:
    """Seconds per decision of the calls that every implementation of the method needs; of images where its selector
    sees them."""
    learned = cosimulation.population.world
    observation = observe(Scene(cosimulation.world, np.arange(len(learned)), cosimulation.road_map))
    roadmap = cosimulation.road_map
    ground = np.zeros((round((roadmap.core + 2.0 * roadmap.margin) * roadmap.resolution),) * 2, np.uint8)
    moves, sumo_steps = _bare_sumo(session, learned, min(steps, REPEATS))
    return {
        "moves": session.substeps * moves,
        "sumo": session.substeps * sumo_steps,
        **({"crops": _seconds(lambda: _bare_crops(ground, learned.heading, roadmap.resolution))} if sees else {}),
        **_bare_models(bundle, observation, sees=sees),
    }


def _bare_sumo(session: SumoSession, learned: WorldState, steps: int) -> tuple[float, float]:
    """Seconds of moveToXY for all road users, to their current positions, and of the SUMO step after it."""
    # SUMO's step fills the reader's subscriptions: bare calls have none.
    session.reader.forget()
    move = bare_moves(session.api, learned)
    times = []
    for _ in range(steps):
        begin = perf_counter()
        move()
        middle = perf_counter()
        session.step()
        times.append((middle - begin, perf_counter() - middle))
    moves, sumo_steps = (statistics.median(column) for column in zip(*times, strict=True))
    return moves, sumo_steps


def _bare_crops(ground: NDArray[np.uint8], heading: Floats, resolution: float) -> None:
    """One affine crop per road user, of the size in which ego images are drawn, from the middle of a ground tile."""
    crop = np.empty((FINE * EGO_ROWS, FINE * EGO_COLS), np.uint8)
    scale, middle = resolution / FINE, 0.5 * len(ground)
    c, s = scale * np.cos(heading), scale * np.sin(heading)
    for matrix in np.stack(
        [np.stack([c, s, np.full_like(c, middle)], 1), np.stack([s, -c, np.full_like(c, middle)], 1)], 1
    ):
        cv2.warpAffine(ground, matrix, crop.shape[::-1], dst=crop, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)


def _bare_models(bundle: ModelBundle, observation: Observation, *, sees: bool) -> dict[str, float]:
    """Seconds of the displacement models of all modes and of the selector's image encoder."""
    import torch

    vector, kind = tensors(observation)
    networks = bundle.displacement.networks
    with one_thread(), torch.inference_mode():
        seconds = {"displacement": _seconds(lambda: networks.forward_all(vector, kind))}
        if sees and bundle.policy is not None and observation.image is not None:
            encoder = bundle.policy.encoder
            pixels = torch.from_numpy(observation.image).permute(0, 3, 1, 2).float().contiguous()
            seconds["encoder"] = _seconds(lambda: encoder(pixels))
    return seconds


def _seconds(call: Callable[[], object]) -> float:
    """Median duration of a call."""
    times = []
    for _ in range(REPEATS):
        begin = perf_counter()
        call()
        times.append(perf_counter() - begin)
    return statistics.median(times)
