"""`python -m slrl_sumo` is `slrl-sumo`."""

import sys
from contextlib import ExitStack

from slrl_sumo.jobs.interrupt import interruptible_to_the_end

IMPORTED_AHEAD = ("slrl_sumo.simulation.run", "libsumo")
"""What the process with SUMO needs in every run."""


def main() -> None:
    """The command line; an interrupt while it is imported ends it like one during a command."""
    with ExitStack() as stack:
        try:
            with interruptible_to_the_end():
                if sys.argv[1:2] == ["run"] and "--help" not in sys.argv:
                    from slrl_sumo.jobs.process import started_ahead

                    stack.enter_context(started_ahead(*IMPORTED_AHEAD))
                from slrl_sumo.cli import main as command_line
        except KeyboardInterrupt:
            raise SystemExit(130) from None
        command_line()


if __name__ == "__main__":
    main()
