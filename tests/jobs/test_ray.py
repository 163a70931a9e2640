"""Studies on a real Ray cluster of two nodes on loopback, one of which is killed, and on a Ray of our own."""

import csv
import json
import os
import pickle
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from slrl_sumo import extras
from slrl_sumo.cli import with_ray_address
from slrl_sumo.errors import InputError
from slrl_sumo.jobs import ray_cluster
from slrl_sumo.jobs.ray_workers import perform

Cli = Callable[..., subprocess.CompletedProcess[str]]

EVALUATE = "evaluate intersection --bundle intersection --selectors prior,sumo --agents 24 --steps 40 --episodes 6"


SMALL = """
[ppo]
num_steps = 8
update_epochs = 1
[arena]
agents = 12
[imitation]
epochs = 0
[networks]
count = 2
reset_every = 4
"""


def session(leader: int) -> list[tuple[int, str]]:
    """The processes of a session: id and command of each."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):  # it has ended meanwhile
            state, _, _, its = (folder / "stat").read_text().rpartition(")")[2].split()[:4]
            if int(its) == leader and state != "Z":
                found.append((int(folder.name), (folder / "cmdline").read_text().replace("\0", " ")))
    return found


def kill(leader: int) -> None:
    """Kill a whole session, as a machine that loses power would."""
    for _ in range(3):
        for pid, _ in session(leader):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@dataclass
class Cluster:
    """A head and a second node, each with one core: addresses of loopback, a session of processes each."""

    folder: Path
    environment: dict[str, str]
    address: str
    nodes: list["subprocess.Popen[bytes]"] = field(default_factory=list)

    def start(self, *words: str) -> "subprocess.Popen[bytes]":
        """Start a node and wait until it has joined."""
        log = self.folder / f"node-{len(self.nodes)}.log"
        command = [str(Path(sys.executable).with_name("ray")), "start", "--block", "--num-cpus", "1"]
        command += ["--object-store-memory", "100000000", *words]
        with log.open("wb") as file:
            node = subprocess.Popen(command, env=self.environment, stdout=file, stderr=file, start_new_session=True)
        self.nodes.append(node)
        deadline = time.monotonic() + 120
        while "Ray runtime started" not in log.read_text():
            assert node.poll() is None, log.read_text()
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.1)
        return node

    def join(self) -> "subprocess.Popen[bytes]":
        """Start a node beside the head."""
        return self.start("--address", self.address, "--node-ip-address", f"127.0.0.{2 + len(self.nodes)}")

    def stop(self) -> None:
        for node in self.nodes:
            kill(node.pid)
            node.wait()


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    folder = Path(tempfile.mkdtemp(prefix="ray_"))
    (folder / "token").write_text(secrets.token_hex(32))
    settings = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN_PATH": str(folder / "token")}
    settings["TMPDIR"] = str(folder)  # processes of a killed node leave their folders behind
    with socket.create_server(("127.0.0.2", 0)) as free:
        port = free.getsockname()[1]
    cluster = Cluster(folder, {**os.environ, **settings, "RAY_USAGE_STATS_ENABLED": "0"}, f"127.0.0.2:{port}")
    try:
        words = ["--head", "--node-ip-address", "127.0.0.2", "--port", str(port), "--include-dashboard=false"]
        cluster.start(*words, "--temp-dir", str(folder))
        yield cluster
    finally:
        cluster.stop()
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(scope="module")
def tables(cli: Cli, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """EVALUATE by one local worker: the folder with its tables."""
    out = tmp_path_factory.mktemp("local") / "out"
    done = cli(*EVALUATE.split(), "--workers", 1, "--out", out)
    assert done.returncode == 0, done.stderr
    return out


def check_tables(out: Path, tables: Path) -> None:
    for name in ("results.json", "results.csv"):
        assert (out / name).read_bytes() == (tables / name).read_bytes()
    lines, expected = ((folder / "episodes.jsonl").read_text().splitlines() for folder in (out, tables))
    assert sorted(lines) == sorted(expected)  # each episode once


@pytest.mark.slow
def test_a_node_that_dies_costs_nothing_but_time(cluster: Cluster, tables: Path, tmp_path: Path) -> None:
    node = cluster.join()
    command = [sys.executable, "-m", "slrl_sumo", *EVALUATE.split(), "--ray", cluster.address]
    driver = subprocess.Popen(
        [*command, "--out", str(tmp_path / "out")],
        env=cluster.environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    log = tmp_path / "out" / "episodes.jsonl"
    deadline = time.monotonic() + 240
    # Until something is finished and that node is playing, too.
    while not (log.exists() and log.read_bytes().count(b"\n") > 2 and "spawn_main" in str(session(node.pid))):
        assert driver.poll() is None, driver.stderr and driver.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    kill(node.pid)
    assert log.read_bytes().count(b"\n") < 12
    out, err = driver.communicate(timeout=240)
    assert (driver.returncode, err) == (0, "")
    assert "raylet" not in out
    check_tables(tmp_path / "out", tables)


@pytest.mark.slow
def test_a_ray_of_our_own_gives_the_same_and_resumes_what_was_begun_without(
    cli_process: Cli, tables: Path, tmp_path: Path
) -> None:
    whole = (tables / "episodes.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "episodes.jsonl").write_bytes(b"".join(whole[:5]) + whole[5][:40])
    done = cli_process(*EVALUATE.split(), "--workers", 2, "--out", tmp_path / "out", "--ray")
    assert (done.returncode, done.stderr) == (0, "")
    check_tables(tmp_path / "out", tables)


@pytest.mark.slow
def test_a_training_goes_on_exactly_when_a_node_dies(cluster: Cluster, cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(SMALL)
    train = ["train", "intersection", "--bundle", "intersection", "--config", "small.toml", "--episodes", "0"]
    train += ["--steps", str(8 * 8 * 24), "--workers", "2"]
    done = cli(*train, "--out", "here", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    node = cluster.join()
    driver = subprocess.Popen(
        [sys.executable, "-m", "slrl_sumo", *train, "--out", "there", "--ray", cluster.address],
        env=cluster.environment,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )
    log = tmp_path / "there-training" / "log.csv"
    deadline = time.monotonic() + 240
    while not (log.exists() and log.read_bytes().count(b"\n") > 3):
        assert driver.poll() is None, driver.stderr and driver.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert "spawn_main" in str(session(node.pid))
    kill(node.pid)
    _, err = driver.communicate(timeout=240)
    assert driver.returncode == 0, err
    here, there = (tmp_path / name / "selector.safetensors" for name in ("here", "there"))
    assert here.read_bytes() == there.read_bytes()
    rows = []
    for name in ("here", "there"):
        with open(tmp_path / f"{name}-training" / "log.csv", newline="") as file:
            rows.append(list(csv.DictReader(file)))
    clocks = ("speed/agent_steps_per_s", "speed/workers_replaced", "loss/rollout_s", "loss/update_s")
    without = [[{k: v for k, v in row.items() if k not in clocks} for row in table] for table in rows]
    assert without[0] == without[1]
    assert len(without[0]) == 8
    replaced = [int(table[-1]["speed/workers_replaced"]) for table in rows]
    assert replaced[0] == 0
    assert replaced[1] >= 1  # Ray may put the new worker on the dead machine, as long as it has not noticed


@pytest.mark.slow
def test_a_comparison_and_recordings_on_ray_are_those_made_here(
    cluster: Cluster, cli: Cli, cli_process: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the node that is there: a Ray of each command's own takes 10 s more, and has the test above."""
    for name, value in cluster.environment.items():
        monkeypatch.setenv(name, value)
    compare = ["compare", "signalised", "--bundle", "intersection", "--seconds", "20", "--seeds", "1"]
    record = ["record", "intersection", "--seconds", "20", "--seeds", "2"]
    for command in (compare, record):
        here = cli(*command, "--out", tmp_path / f"{command[0]}-here")
        there = cli_process(*command, "--ray", cluster.address, "--out", tmp_path / f"{command[0]}-there")
        for done in (here, there):
            assert (done.returncode, done.stderr) == (0, "")
    for file in ("compare-{}/results.json", "compare-{}/runs.jsonl", "record-{}/seed-1.npz", "record-{}/seed-2.npz"):
        one, other = ((tmp_path / file.format(name)).read_bytes() for name in ("here", "there"))
        assert sorted(one.splitlines()) == sorted(other.splitlines())


@pytest.mark.slow
def test_ctrl_c_on_ray_keeps_what_is_finished_and_leaves_no_process(tmp_path: Path) -> None:
    (tmp_path / "tmp").mkdir()
    before = set(Path("/tmp").glob("slrl_ray_*"))
    words = "evaluate intersection --bundle intersection --selectors prior --agents 4 --steps 8 --episodes 100000"
    command = [sys.executable, "-m", "slrl_sumo", *words.split(), "--out", str(tmp_path / "out")]
    with subprocess.Popen(
        [*command, "--ray", "--workers", "1"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path / "tmp")},
        start_new_session=True,
    ) as driver:
        log = tmp_path / "out" / "episodes.jsonl"
        deadline = time.monotonic() + 120
        while not log.exists() or log.read_bytes().count(b"\n") < 4:
            assert driver.poll() is None
            assert time.monotonic() < deadline, "no episode is finished"
            time.sleep(0.05)
        os.killpg(driver.pid, signal.SIGINT)
        out, err = driver.communicate(timeout=60)
    assert (driver.returncode, out) == (130, "")
    (line,) = err.splitlines()
    assert "interrupted" in line
    assert all(json.loads(each) for each in log.read_text().splitlines())
    deadline = time.monotonic() + 30  # Ray's own processes see that it is over
    while session(driver.pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert session(driver.pid) == []
    assert set(Path("/tmp").glob("slrl_ray_*")) == before


@pytest.mark.slow
def test_a_cluster_with_another_token_is_not_waited_for(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "other").write_text(secrets.token_hex(32))
    monkeypatch.setattr(ray_cluster, "CONNECT_S", 6)
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    monkeypatch.setenv("RAY_AUTH_TOKEN_PATH", str(tmp_path / "other"))
    with pytest.raises(InputError, match="the same token"), ray_cluster.ray_cluster(cluster.address):
        pass


def test_an_option_without_an_address_means_a_ray_of_our_own() -> None:
    words = with_ray_address(["evaluate", "--ray", "campus", "--out", "o"])
    assert words == ["evaluate", "--ray", "local", "campus", "--out", "o"]
    assert with_ray_address(["train", "--ray"]) == ["train", "--ray", "local"]
    assert with_ray_address(["train", "--ray", "--seed", "1"]) == ["train", "--ray", "local", "--seed", "1"]
    for given in (["--ray", "head.example:6379"], ["--ray", "auto"], ["--ray=auto"], ["--ray", "[::1]:6379"]):
        assert with_ray_address(given) == given


@pytest.mark.parametrize(
    ("address", "complaint"),
    [
        ("127.0.0.2:1", "no answer there"),
        ("--ray=nowhere", "--ray nowhere: give HOST:PORT"),
        ("127.0.0.1:99999999", "no answer there"),
    ],
)
def test_an_address_without_a_cluster_gets_one_line(
    cli_process: Cli, tmp_path: Path, address: str, complaint: str
) -> None:
    ray = [address] if "=" in address else ["--ray", address]
    done = cli_process(*EVALUATE.split(), *ray, "--out", tmp_path / "out")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert complaint in line


def test_a_port_of_another_service_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray_cluster, "CONNECT_S", 3)
    with (
        socket.create_server(("127.0.0.2", 0)) as mute,
        pytest.raises(InputError, match="no Ray answered within 3 s"),
        ray_cluster.ray_cluster(f"127.0.0.2:{mute.getsockname()[1]}"),
    ):
        pass


def test_without_ray_it_is_said_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"pip install 'slrl-sumo\[ray\]'"), ray_cluster.ray_cluster("local"):
        pass


def test_other_versions_are_named() -> None:
    code = (
        "from ray._private.utils import check_version_info as check; "
        "check({'ray_version': '1.2.3', 'python_version': '3.1.4'}, 'this process', "
        "raise_on_mismatch=True, python_version_match_level='minor')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    line = ray_cluster.in_one_line(done.stderr)
    assert line.startswith("the cluster has Ray 1.2.3 and Python 3.1.4, this is Ray ")
    assert "\n" not in line
    answer = perform("0.0.0", b"", b"")
    assert "this is 0.0.0; install the same" in str(pickle.loads(answer))
