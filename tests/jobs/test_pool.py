"""Jobs in processes that are killed, and in scenarios that SUMO does not survive."""

import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable
from functools import partial
from pathlib import Path

import pytest
from lxml import etree

from slrl_sumo.errors import DefectError, InputError, SumoError
from slrl_sumo.jobs import pool
from slrl_sumo.jobs.pool import JOB_ATTEMPTS, Backend, Finished, run_jobs
from slrl_sumo.jobs.workers import MachineLostError
from slrl_sumo.metrics.outcomes import TypeOutcome
from slrl_sumo.studies.episodes.episode import Episode, EpisodeSettings, run_episode

Played = Finished[Episode, tuple[TypeOutcome, ...]]

SETTINGS = EpisodeSettings("intersection", "intersection", steps=8)


@pytest.fixture(autouse=True)
def _findable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Worker processes import this module by its name."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2])


def episodes(count: int, agents: int = 6) -> list[Episode]:
    return [Episode("prior", agents, 1, number) for number in range(count)]


def play_all(settings: EpisodeSettings, some: Iterable[Episode], processes: int) -> Generator[Played, None, None]:
    return run_jobs(partial(run_episode, settings), some, Backend(processes))


def worker_pids() -> set[int]:
    """Process ids of the workers of this process."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == os.getpid() and b"spawn_main" in (folder / "cmdline").read_bytes():
                found.add(int(folder.name))
        except (OSError, IndexError):
            continue  # it has ended meanwhile
    return found


def outcomes(played: Iterable[Played]) -> dict[Episode, object]:
    return {each.job: each.record for each in played}


@pytest.mark.slow
def test_a_worker_that_is_killed_is_replaced_and_nothing_changes() -> None:
    settings = EpisodeSettings("intersection", "intersection", steps=100)
    undisturbed = outcomes(play_all(settings, episodes(5, agents=24), 1))
    results = play_all(settings, episodes(5, agents=24), 2)
    first = next(results)
    before = worker_pids()
    assert len(before) == 2
    victim = min(before)
    os.kill(victim, signal.SIGKILL)  # in the middle: an episode takes longer than this line
    second = next(results)
    during = worker_pids()
    assert outcomes([first, second, *results]) == undisturbed
    assert None not in undisturbed.values()
    assert victim not in during
    assert worker_pids() == set()


def test_an_episode_that_always_kills_its_process_is_left_out() -> None:
    results = play_all(SETTINGS, episodes(2), 1)
    first = next(results)
    (spared,) = worker_pids()
    os.kill(spared, signal.SIGKILL)
    killed = {spared}
    ended = threading.Event()

    def kill_whoever_comes() -> None:
        while not ended.is_set():
            for pid in worker_pids() - killed:
                os.kill(pid, signal.SIGKILL)
                killed.add(pid)
            time.sleep(0.01)

    killer = threading.Thread(target=kill_whoever_comes)
    killer.start()
    rest = list(results)
    ended.set()
    killer.join()
    assert first.record is not None
    assert [(each.job, each.record) for each in rest] == [(episodes(2)[1], None)]
    assert "SIGKILL" in rest[0].reason
    assert len(killed) == JOB_ATTEMPTS


def test_closing_ends_the_workers_and_removes_their_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    results = play_all(SETTINGS, episodes(4), 2)
    next(results)
    assert len(list(tmp_path.iterdir())) == 2
    results.close()
    assert worker_pids() == set()
    assert list(tmp_path.iterdir()) == []


def test_wrong_input_is_told_as_such() -> None:
    with pytest.raises(InputError, match="fit into this network"):
        list(play_all(SETTINGS, episodes(2, agents=5000), 1))
    assert worker_pids() == set()


def test_a_scenario_that_sumo_does_not_survive_is_given_up(copy_scenario: Callable[..., Path]) -> None:
    # No connection leads from in0 back to in0's begin: SUMO finds out when the vehicle is to depart.
    config = copy_scenario(
        "intersection",
        (".sumocfg", "<time>", '<input><route-steps value="1"/></input><time>'),
        (".rou.xml", "</routes>", '<vehicle id="astray" depart="30"><route edges="out0 in0"/></vehicle></routes>'),
    )
    routes = config.with_name("intersection.rou.xml")
    ordered = etree.parse(str(routes))
    ordered.getroot()[:] = sorted(ordered.getroot(), key=lambda e: float(e.get("depart") or e.get("begin") or -1))
    ordered.write(str(routes))
    with pytest.raises(SumoError, match=r"first 3 simulations all failed.*astray"):
        list(play_all(EpisodeSettings(str(config), "intersection", steps=8), episodes(9), 2))


def half_or_die(number: int) -> float:
    """Divides by two; 3 kills the process as a crash of SUMO would, 5 is a bug."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGSEGV)
    if number == 5:
        raise ZeroDivisionError("five")
    return number / 2


def test_only_as_many_jobs_are_drawn_as_can_run_and_each_comes_back_once() -> None:
    drawn = []

    def numbers() -> Iterable[int]:
        for number in range(100, 130):
            drawn.append(number)
            yield number

    results = run_jobs(half_or_die, numbers(), Backend(2))
    found = []
    for finished in results:
        found.append((finished.job, finished.record))
        assert len(drawn) <= len(found) + 3
    assert sorted(found) == [(number, number / 2) for number in range(100, 130)]


@pytest.mark.slow
def test_a_job_that_always_dies_is_left_out_with_the_signal_and_the_others_are_done() -> None:
    found = {each.job: each for each in run_jobs(half_or_die, range(5), Backend(2))}
    assert {job: each.record for job, each in found.items()} == {0: 0.0, 1: 0.5, 2: 1.0, 3: None, 4: 2.0}
    assert found[3].reason == f"its process died (SIGSEGV), {JOB_ATTEMPTS} times"


def test_a_bug_is_told_with_its_traceback() -> None:
    with pytest.raises(DefectError, match=r"^a defect of slrl_sumo \(ZeroDivisionError: five\)") as caught:
        list(run_jobs(half_or_die, [5], Backend(1)))
    assert "in half_or_die" in caught.value.details
    assert "".join(caught.value.__notes__) == caught.value.details


class _UnluckyWorkers:
    """Two workers whose machines are lost a number of times, and that answer in reverse order."""

    def __init__(self, losses: int) -> None:
        self.losses, self.begun, self.running = losses, list[int](), dict[int, bytes]()

    def capacity(self) -> int:
        return 2

    def begin(self, number: int, job: bytes) -> None:
        self.begun.append(pickle.loads(job))
        self.running[number] = job

    def wait(self) -> list[tuple[int, int | MachineLostError]]:
        ended = [(number, -pickle.loads(job)) for number, job in sorted(self.running.items())][::-1]
        self.running.clear()
        if self.losses:
            self.losses -= 1
            return [(number, MachineLostError("gone")) for number, _ in ended]
        return [*ended]

    def close(self) -> None: ...


def test_jobs_whose_machines_are_lost_are_done_elsewhere_and_counted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    workers = _UnluckyWorkers(losses=JOB_ATTEMPTS + 2)
    monkeypatch.setattr(pool, "_workers", lambda work, backend: workers)
    found = list(run_jobs(half_or_die, range(5), Backend(2)))
    assert sorted((each.job, each.record) for each in found) == [(job, -job) for job in range(5)]
    assert len(workers.begun) == 5 + 2 * (JOB_ATTEMPTS + 2)
    assert sorted(workers.begun[2:4]) == [0, 1]  # at once, not after all the others


def test_jobs_that_lose_every_machine_are_left_out_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    workers = _UnluckyWorkers(losses=10**6)
    monkeypatch.setattr(pool, "_workers", lambda work, backend: workers)
    found = sorted((each.job, each.reason) for each in run_jobs(half_or_die, range(2), Backend(2)) if not each.record)
    assert found == [(job, f"gone, {pool.MACHINE_ATTEMPTS} times") for job in range(2)]
