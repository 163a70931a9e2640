"""The command line: parses, calls, prints. Heavy modules are imported inside the commands, so that --help is quick."""

import shlex
import sys

# Commands register themselves: the order here is that of --help.
from slrl_sumo.cli import simulate, measure, show, learn  # noqa: F401  # isort: skip
from slrl_sumo.cli.app import app
from slrl_sumo.errors import InputError, SlrlError, SumoError


def main() -> None:
    """Entry point. Exit codes: 0 done, 1 wrong input (one line on stderr), 2 usage, 3 SUMO died."""
    try:
        app()
    except InputError as error:
        _fail(1, error)
    except SumoError as error:
        _fail(3, SumoError(f"{error}; outputs are complete up to there; repeat it with: {shlex.join(_command())}"))


def _command() -> list[str]:
    return ["slrl-sumo", *sys.argv[1:]]


def _fail(code: int, error: SlrlError) -> None:
    print(f"slrl-sumo: {error}", file=sys.stderr)
    sys.exit(code)
