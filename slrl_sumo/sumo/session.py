"""Running SUMO simulations: started by this module with libsumo, or by a user's script."""

import os
import shutil
import sys
import tempfile
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.sumo.api import SumoApi
from slrl_sumo.sumo.network import Network, read_network
from slrl_sumo.sumo.reader import Reader
from slrl_sumo.sumo.refusals import is_end, is_refusal
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.command import divides_interval, notices, start_command, sumo_step_length
from slrl_sumo.sumo.scenario.input_check import check_inputs
from slrl_sumo.sumo.spawned import LEARNED_TYPES, SpawnedControl

ATTACHED = "slrl_sumo.attached"
"""Parameter of the first learned vType while learned road users are attached: every connection can read it."""
SYSTEM_LIBRARIES = (
    "where it misses a library of the system: apt-get install libx11-6 libxext6 libxrender1 libgl1 libatomic1"
)
"""Hint on Debian libraries that SUMO's wheels 1.28 need, and that small container images lack."""


class SumoSession:
    """A SUMO simulation of one scenario, from start to close; a context manager.

    libsumo allows one simulation per process: opening a second session is an error. After `__enter__`:

    - `api`: libsumo; `network`: lanes and junctions; `reader`: reads all road users; `spawned`: adds and moves spawned
      road users;
    - `time`: simulation time in s; `step_length`: SUMO's step in s; `substeps`: SUMO steps per decision interval;
    - `notices`: the changes to the scenario, one line each.

    `gui`: with the window of sumo-gui; the process must end after the session.

    Raises InputError if SUMO refuses the scenario, with SUMO's reason; SumoError if SUMO fails later, in `step` or
    because the simulation is closed within the with block.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        seed: int = 1,
        step_length: float | None = None,
        keep_outputs: bool = False,
        gui: bool = False,
    ) -> None:
        self.scenario = scenario
        self.step_length, step_notices = sumo_step_length(scenario, step_length)
        self.substeps = round(DECISION_INTERVAL / self.step_length)
        self.notices = step_notices + notices(scenario, keep_outputs)
        self._seed = seed
        self._keep_outputs = keep_outputs
        self._gui = gui
        self._scratch: Path | None = None
        self._remove_scratch: Callable[[], object] = lambda: None
        self._open = False

    def __enter__(self) -> Self:
        try:
            import libsumo
        except ImportError as error:
            raise InputError(f"libsumo cannot be imported ({error}); {SYSTEM_LIBRARIES}") from None

        if libsumo.isLoaded():
            raise InputError(
                "a SUMO simulation is already open in this process; close it first (libsumo holds only one)"
            )
        check_inputs(self.scenario)
        self.api: SumoApi = libsumo
        if not self._keep_outputs:
            self._scratch = Path(tempfile.mkdtemp(prefix="slrl_sumo_"))
            # The folder is also removed at the end of a process that does not close its simulation.
            self._remove_scratch = weakref.finalize(self, _remove, self._scratch)
        command = start_command(
            self.scenario, step_length=self.step_length, seed=self._seed, outputs_to=self._scratch, gui=self._gui
        )
        self._open = True
        with _captured_output() as printed:
            try:
                libsumo.start(command)
            except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
                # After a refusal while it reads routes, SUMO stays partly loaded and would block each later session.
                self.close()
                added = " ".join(f"--{name} {value}" for name, value in self.scenario.added.items())
                where = f"{self.scenario.config}{f' with --sumo-options {added!r}' if added else ''}"
                raise InputError(f"{where}: {_sumo_reason(printed, str(error))}") from None
        try:
            self.network: Network = read_network(libsumo)
            self.spawned = SpawnedControl(libsumo, self.network)
            self.reader = Reader(libsumo)
        except InputError as error:
            self.close()
            raise InputError(f"{self.scenario.config}: {error}") from None
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        import libsumo

        self.close()
        if isinstance(error, libsumo.FatalTraCIError):
            raise SumoError(f"SUMO has ended: {' '.join(str(error).split())}") from error

    @property
    def time(self) -> float:
        """Simulation time of the next step, s, as in libsumo."""
        return self.api.simulation.getTime()

    @property
    def end(self) -> float | None:
        """The scenario's end, s; None without an end."""
        return self.scenario.seconds("end")

    @property
    def expected(self) -> int:
        """Number of road users in the network or before their departure: at 0, SUMO ends a scenario without an end."""
        return self.api.simulation.getMinExpectedNumber()

    def step(self) -> None:
        """Run a SUMO step. Raises SumoError if SUMO fails."""
        import libsumo

        time = self.time
        try:
            self.api.simulationStep()
        except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
            raise SumoError(f"SUMO stopped at {time:g} s: {' '.join(str(error).split())}") from None

    def close(self) -> None:
        """End the simulation and remove the files that SUMO wrote into the scratch folder."""
        import libsumo

        try:
            # After this session was closed, another session may have been opened, which must stay open.
            # In 2 of 5 attempts, the window of sumo-gui never answered `close`: without outputs to finish, it closes
            # with the process.
            if self._open and libsumo.isLoaded() and (self._keep_outputs or not self._gui):
                libsumo.close()
        finally:
            self._open = False
            self._remove_scratch()


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)


_ATTACHMENTS = count(1)
"""Counter for the attachments of this process."""


class AttachedSession:
    """A simulation that a user's script has started, accessed by `api`: libsumo, traci or a TraCI connection.

    `network`, `reader`, `spawned`, `time` and `step_length`: see SumoSession. Raises InputError if `api` is none of
    these or has no simulation, if the step does not divide the decision interval, and if learned road users are already
    attached.
    """

    def __init__(self, api: SumoApi) -> None:
        self.api = api
        self._name, self._steps = f"{os.getpid()}.{next(_ATTACHMENTS)}", 0
        try:
            api.simulation.getTime()  # the step is known without a simulation
            self.step_length = float(api.simulation.getDeltaT())
        except Exception as error:
            raise InputError(
                f"it holds no running simulation ({' '.join(str(error).split())}); pass libsumo, traci or a TraCI "
                "connection after SUMO was started",
                argument="api",
                value=getattr(api, "__name__", type(api).__name__),
            ) from None
        if not divides_interval(self.step_length):
            raise InputError(
                f"the simulation's step of {self.step_length:g} s does not divide the decision interval of "
                f"{DECISION_INTERVAL:g} s; start SUMO with --step-length 0.4, 0.2 or 0.1"
            )
        types = api.vehicletype
        if LEARNED_TYPES[0] in types.getIDList() and types.getParameter(LEARNED_TYPES[0], ATTACHED):
            raise InputError("learned road users are attached to this simulation already; leave that context first")
        self.network = read_network(api)
        self.spawned = SpawnedControl(api, self.network)
        self.reader = Reader(api)

    @property
    def time(self) -> float:
        """Simulation time of the next step, s."""
        return float(self.api.simulation.getTime())

    def step(self) -> None:
        """Run a SUMO step."""
        self.api.simulationStep()
        self._steps += 1
        self.mark(attached=True)

    def mark(self, attached: bool) -> None:
        """Record in the simulation whether learned road users are attached, and after how many steps."""
        self.api.vehicletype.setParameter(LEARNED_TYPES[0], ATTACHED, self._marking if attached else "")

    @property
    def attached(self) -> bool:
        """Whether the simulation of this session is still open, and no other one was loaded."""
        try:
            return self._read_mark().startswith(f"{self._name} ")
        except Exception as error:
            if is_end(error):
                return False
            raise

    def check(self) -> None:
        """Raise InputError if the script has loaded another simulation or state since the last step.

        States contain the mark, so that a state that was saved after another step is detected.
        """
        if self._read_mark() != self._marking:
            raise InputError(
                "the script has loaded another simulation or state inside this context (load, loadState); leave the "
                "context before, and attach again"
            )

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Context manager that converts SUMO's errors to SumoError."""
        try:
            yield
        except Exception as error:
            if is_end(error):
                raise SumoError(f"the simulation was closed inside this context ({error})") from error
            if is_refusal(error):
                raise SumoError(f"SUMO stopped: {' '.join(str(error).split())}") from error
            raise

    @property
    def _marking(self) -> str:
        return f"{self._name} {self._steps}"

    def _read_mark(self) -> str:
        try:
            return self.api.vehicletype.getParameter(LEARNED_TYPES[0], ATTACHED)
        except Exception as error:
            if is_refusal(error):  # the type does not exist
                return ""
            raise


def _sumo_reason(printed: IO[bytes], message: str) -> str:
    """SUMO's reason for refusing a scenario, as one line: its first error with its continuation lines."""
    printed.seek(0)
    lines = [line.rstrip() for line in printed.read().decode(errors="replace").splitlines()]
    starts = [i for i, line in enumerate(lines) if line.startswith("Error:")]
    if not starts:
        return f"SUMO refuses it ({' '.join(message.split())})"
    reason = [lines[starts[0]].removeprefix("Error:").strip()]
    for line in lines[starts[0] + 1 :]:
        if line.startswith(("Error:  ", " ")):
            reason.append(line.removeprefix("Error:").strip())
        else:
            break
    return f"SUMO refuses it: {' '.join(reason)}"


@contextmanager
def _captured_output() -> Iterator[IO[bytes]]:
    """Context manager that redirects stdout and stderr of this process, including C++ code, to a file."""
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile() as file:
        saved = [(fd, os.dup(fd)) for fd in (1, 2)]
        try:
            for fd, _ in saved:
                os.dup2(file.fileno(), fd)
            yield file
        finally:
            for fd, copy in saved:
                os.dup2(copy, fd)
                os.close(copy)


def library_version() -> str:
    """Version that the library reports; it may differ from the version of the package because of PYTHONPATH."""
    import libsumo

    return str(libsumo.getVersion()[1]).removeprefix("SUMO ").strip()
