"""Episodes in processes that are killed, and in scenarios that SUMO does not survive."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
from lxml import etree

from slrl_sumo.analysis.episode_workers import ATTEMPTS, Played, play_all
from slrl_sumo.analysis.episodes import Episode, EpisodeSettings
from slrl_sumo.errors import InputError, SumoError

SETTINGS = EpisodeSettings("intersection", "intersection", steps=8)


def episodes(count: int, agents: int = 6) -> list[Episode]:
    return [Episode("prior", agents, 1, number) for number in range(count)]


def workers() -> set[int]:
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
    return {each.episode: each.outcome for each in played}


def test_a_worker_that_is_killed_is_replaced_and_nothing_changes() -> None:
    settings = EpisodeSettings("intersection", "intersection", steps=100)
    undisturbed = outcomes(play_all(settings, episodes(5, agents=24), 1))
    results = play_all(settings, episodes(5, agents=24), 2)
    first = next(results)
    before = workers()
    assert len(before) == 2
    victim = min(before)
    os.kill(victim, signal.SIGKILL)  # in the middle: an episode takes longer than this line
    second = next(results)
    during = workers()
    assert outcomes([first, second, *results]) == undisturbed
    assert None not in undisturbed.values()
    assert victim not in during
    assert workers() == set()


def test_an_episode_that_always_kills_its_process_is_left_out() -> None:
    results = play_all(SETTINGS, episodes(2), 1)
    first = next(results)
    (spared,) = workers()
    os.kill(spared, signal.SIGKILL)
    killed = {spared}
    ended = threading.Event()

    def kill_whoever_comes() -> None:
        while not ended.is_set():
            for pid in workers() - killed:
                os.kill(pid, signal.SIGKILL)
                killed.add(pid)
            time.sleep(0.01)

    killer = threading.Thread(target=kill_whoever_comes)
    killer.start()
    rest = list(results)
    ended.set()
    killer.join()
    assert first.outcome is not None
    assert [(each.episode, each.outcome) for each in rest] == [(episodes(2)[1], None)]
    assert "SIGKILL" in rest[0].reason
    assert len(killed) == ATTEMPTS


def test_closing_ends_the_workers_and_removes_their_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    results = play_all(SETTINGS, episodes(4), 2)
    next(results)
    assert len(list(tmp_path.iterdir())) == 2
    results.close()
    assert workers() == set()
    assert list(tmp_path.iterdir()) == []


def test_wrong_input_is_told_as_such() -> None:
    with pytest.raises(InputError, match="fit into this network"):
        list(play_all(SETTINGS, episodes(2, agents=5000), 1))
    assert workers() == set()


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
    with pytest.raises(SumoError, match=r"first 3 episodes all failed.*astray"):
        list(play_all(EpisodeSettings(str(config), "intersection", steps=8), episodes(9), 2))
