"""The connection to a Ray cluster, or to a Ray instance of its own on this machine. Only this module imports Ray.

Ray executes whatever it receives: a Ray instance of its own requires a token that only this process and its children
know. Whether a cluster requires one is up to its operators
(https://docs.ray.io/en/latest/ray-security/token-auth.html).
"""

import logging
import os
import re
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from slrl_sumo.errors import InputError
from slrl_sumo.extras import require

LOCAL = "local"
"""Address of a Ray instance of its own on this machine."""

AUTO = "auto"
"""Address of the cluster that this machine belongs to."""

CONNECT_S = 15
"""s in which a cluster must have answered."""

LOOPBACK = "127.0.0.2"
"""Address of a Ray instance of its own: Ray replaces 127.0.0.1 by the machine's outer address."""

TOKEN = secrets.token_hex(32)
"""Token of each Ray instance of this process, because Ray keeps the first token that it has read."""

ENVIRONMENT = ("RAY_USAGE_STATS_ENABLED", "TMPDIR", "RAY_AUTH_MODE", "RAY_AUTH_TOKEN_PATH")
"""Environment variables for Ray and its processes; restored when the connection has ended."""

MAX_FOLDER_LENGTH = 40
"""Characters of a folder in which Ray can still create its sockets (107 for the whole path)."""


@contextmanager
def ray_cluster(address: str, cpus: int | None = None) -> Iterator[Any]:
    """Connect to a Ray cluster (see jobs.pool.Backend.ray) and yield the module `ray`.

    `cpus`: cores of a Ray instance of its own; None: all. Raises InputError within CONNECT_S if Ray is not installed,
    no cluster answers, or it cannot be used. Whatever runs on the cluster for this process ends with the connection.
    """
    check_ray(address)
    folder = None
    settings = {"RAY_USAGE_STATS_ENABLED": "0"}
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    logging.getLogger("ray").setLevel(logging.CRITICAL)
    options: dict[str, Any] = {"address": address, "log_to_driver": False, "logging_level": logging.CRITICAL}
    try:
        if address == LOCAL:
            folder = _folder()
            settings["TMPDIR"] = str(folder)
            if "RAY_AUTH_MODE" not in os.environ:
                token = folder / "token"
                token.touch(mode=0o600)
                token.write_text(TOKEN, encoding="utf-8")
                settings |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN_PATH": str(token)}
            options |= {"num_cpus": cpus, "include_dashboard": False, "_temp_dir": str(folder)}
            options |= {"_node_ip_address": LOOPBACK, "object_store_memory": 512 * 2**20}
        os.environ.update(settings)
        ray = _connected(address, options)
        try:
            yield ray
        finally:
            ray.shutdown()
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)


def is_ray_address(text: str) -> bool:
    """Whether `text` has the form of an address: local, auto or HOST:PORT."""
    return text in (LOCAL, AUTO) or re.fullmatch(r"([\w.\-]+|\[[\da-fA-F:]+\]):\d+", text) is not None


def check_ray(address: str) -> None:
    """Raise InputError if Ray is not installed, or `address` does not answer. Fast: does not import Ray."""
    require("ray", f"--ray {address}")
    if not is_ray_address(address):
        raise _error(address, "give HOST:PORT of a cluster's head, auto for the one of this machine, or local")
    if address in (LOCAL, AUTO):
        return
    try:
        _reach(address, timeout=3.0)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise _error(
            address, f"no answer there ({reason}); start a cluster with ray start --head, or name another"
        ) from None


def check_head(ray: Any, address: str) -> None:
    """Raise InputError if the cluster's head is gone: Ray would wait for a minute, ignore signals, and then exit."""
    for timeout in (1.0, 3.0, 6.0):
        try:
            return _reach(ray.get_runtime_context().gcs_address, timeout)
        except ConnectionRefusedError:
            time.sleep(timeout / 3)
        except OSError:
            continue
    raise _error(
        address,
        "the cluster's head does not answer any more; finished results are kept: repeat this when it is back, or "
        "without `ray`",
    )


def _error(address: str, message: str) -> InputError:
    return InputError(message, argument="ray", value=address)


def _reach(address: str, timeout: float) -> None:
    host, _, port = address.rpartition(":")
    socket.create_connection((host.strip("[]"), int(port)), timeout=timeout).close()


def _connected(address: str, options: dict[str, Any]) -> Any:
    """The module `ray`, connected."""
    import ray

    if ray.is_initialized():
        raise _error(address, "this process is connected to a Ray cluster already")
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        if address != LOCAL:
            _try(address)
        ray.init(**options)
    except (RuntimeError, OSError, ValueError, TypeError) as error:
        ray.shutdown()
        raise _error(address, in_one_line(str(error))) from None
    finally:
        if threading.current_thread() is threading.main_thread():
            for number, handler in handlers.items():  # Ray has set its own, which would exit without a message
                signal.signal(number, handler)
    with suppress(ImportError):
        # Ray prints on stdout which of its workers and machines died, without a switch for it; callers report it.
        from ray._private import worker

        worker.print_to_stdstream = lambda *_, **__: None
    return ray


def _try(address: str) -> None:
    """Connect in a process of its own: Ray would wait for minutes, ignore signals, and print messages."""
    code = "import ray, sys, logging; ray.init(sys.argv[1], log_to_driver=False, logging_level=logging.CRITICAL)"
    command = [sys.executable, "-c", code, address]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=CONNECT_S, check=False)
    except subprocess.TimeoutExpired:
        raise _error(
            address,
            f"no Ray answered within {CONNECT_S} s; check that it is the port of a cluster's head, that this machine "
            "belongs to it, and that it has the same token (RAY_AUTH_TOKEN_PATH)",
        ) from None
    if done.returncode:
        raise ConnectionError(done.stderr)


def in_one_line(text: str) -> str:
    """Ray's message about a failed connection, shortened."""
    if "ersion mismatch" in text:
        numbers = re.findall(r"(Ray|Python): *([\d.]+\w*)", text)
        parts = [f"{name} {number}" for name, number in numbers]
        return f"the cluster has {' and '.join(parts[:2])}, this is {' and '.join(parts[2:4])}; install the same here"
    if "any running Ray instance" in text:
        return "no Ray runs on this machine; start one with ray start --head, or join a cluster"
    if "oken" in text and "uthentication" in text:
        return "the cluster requires its token; see RAY_AUTH_TOKEN_PATH in Ray's documentation"
    last = [line for line in text.splitlines() if line.strip()]
    return f"no connection ({last[-1].strip()[:300] if last else 'Ray gives no reason'})"


def _folder() -> Path:
    """A new folder with a path so short that Ray can create its sockets in it."""
    try:
        for parent in (tempfile.gettempdir(), "/tmp"):
            if len(parent) + len("/slrl_ray_12345678") <= MAX_FOLDER_LENGTH:
                return Path(tempfile.mkdtemp(prefix="slrl_ray_", dir=parent))
    except OSError as error:
        raise InputError(f"no place for temporary files ({error.strerror}); make room, or set TMPDIR") from None
    raise InputError("no place for Ray's sockets: set TMPDIR to a folder with a short path")
