"""The command line: parses, calls, prints. Heavy modules are imported inside the commands, so that --help is quick."""

import os
import shlex
import sys

# Commands register themselves: the order here is that of --help.
from slrl_sumo.cli import simulate, measure, show, learn  # noqa: F401  # isort: skip
from slrl_sumo.cli.app import app
from slrl_sumo.errors import InputError, SlrlError, SumoError
from slrl_sumo.jobs.ray_address import LOCAL, may_be_address


def main() -> None:
    """Entry point. Exit codes: 0 done, 1 wrong input (one line on stderr), 2 usage, 3 SUMO died."""
    # PyTorch reads it when it is loaded. Threads that spin while they wait are several times slower on busy machines.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        app(with_ray_address(sys.argv[1:]))
    except InputError as error:
        _fail(1, error)
    except SumoError as error:
        _fail(3, SumoError(f"{error}; outputs are complete up to there; repeat it with: {shlex.join(_command())}"))


def with_ray_address(words: list[str]) -> list[str]:
    """The words of the command line, where `--ray` without an address has become `--ray local`."""
    result = []
    for word, following in zip(words, [*words[1:], ""], strict=True):
        result.append(word)
        if word == "--ray" and (following.startswith("-") or not may_be_address(following)):
            result.append(LOCAL)
    return result


def _command() -> list[str]:
    return ["slrl-sumo", *sys.argv[1:]]


def _fail(code: int, error: SlrlError) -> None:
    print(f"slrl-sumo: {error}", file=sys.stderr)
    sys.exit(code)
