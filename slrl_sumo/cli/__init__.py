"""The command line: parses, calls, prints. Heavy modules are imported inside the commands, so that --help is quick."""

import os
import shlex
import sys

# Commands register themselves: the order here is that of --help.
from slrl_sumo.cli import scenarios, simulate, measure, bench, show, learn  # noqa: F401  # isort: skip
from slrl_sumo.cli.app import app, claims
from slrl_sumo.cli.defect import write_defect
from slrl_sumo.errors import DefectError, InputError, SumoError
from slrl_sumo.jobs.interrupt import interruptible
from slrl_sumo.jobs.ray_cluster import LOCAL, is_ray_address
from slrl_sumo.jobs.standard_streams import open_closed_streams


def main() -> None:
    """Entry point. Exit codes: 0 done, 1 an input is wrong (one line on stderr), 2 usage, 3 SUMO died, 4 a defect,
    128 + n signal n ended it."""
    open_closed_streams()
    # PyTorch reads this when it is loaded. Threads that spin while waiting are several times slower on busy machines.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        _run_app()
    except InputError as error:
        _fail(1, error.as_options())
    except SumoError as error:
        command = shlex.join(["slrl-sumo", *sys.argv[1:]])
        _fail(3, f"{error}; repeat it with: {command}")
    except Exception as error:
        defect = DefectError.of(error)
        _fail(4, f"{defect}; please report it with {write_defect(defect)}")


def _run_app() -> None:
    """Run the command; the exit code of a command that a signal ends is 128 + the number of the signal."""
    with interruptible() as caught, claims:
        try:
            app(with_ray_address(sys.argv[1:]), prog_name="slrl-sumo")
        except (SystemExit, KeyboardInterrupt):  # the library of the command line makes the one of the other
            # Where an interrupt came inside an `exec`, as in the imports of dataclasses, CPython remembers it and would
            # end by SIGINT, whatever the exit code is; the next `exec` makes it forget.
            exec("")
            if caught:
                sys.exit(128 + caught[0])
            raise


def with_ray_address(words: list[str]) -> list[str]:
    """The words of the command line, where `--ray` without an address has become `--ray local`."""
    result = []
    for word, following in zip(words, [*words[1:], ""], strict=False):
        result.append(word)
        if word == "--ray" and (following.startswith("-") or not is_ray_address(following)):
            result.append(LOCAL)
    return result


def _fail(code: int, message: str) -> None:
    print(f"slrl-sumo: {message}", file=sys.stderr)
    sys.exit(code)
