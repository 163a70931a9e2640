"""One running SUMO simulation: the only module that imports libsumo."""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from slrl_sumo.errors import InputError, SumoError
from slrl_sumo.scene.types import DECISION_INTERVAL
from slrl_sumo.sumo.command import notices, start_command, sumo_step_length
from slrl_sumo.sumo.network import Network, read_network
from slrl_sumo.sumo.reader import Reader
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.spawned import SpawnedControl


class SumoSession:
    """A SUMO simulation of one scenario, from start to close; a context manager.

    libsumo holds one simulation per process: opening a second session is an error. After `__enter__`:

    - `api`: libsumo; `network`: the lanes and junctions; `reader`: reads all road users; `placement`: adds and moves
      learned ones;
    - `time`: simulation time in s; `step_length`: SUMO's step in s; `substeps`: SUMO steps per decision interval;
    - `notices`: what was changed in the scenario, one line each.

    Raises InputError when SUMO refuses the scenario, with SUMO's own reason; SumoError when it fails later: in `step`,
    or in any call within the with block.
    """

    def __init__(
        self, scenario: Scenario, *, seed: int = 1, step_length: float | None = None, keep_outputs: bool = False
    ) -> None:
        self.scenario = scenario
        self.step_length, step_notices = sumo_step_length(scenario, step_length)
        self.substeps = round(DECISION_INTERVAL / self.step_length)
        self.notices = step_notices + notices(scenario, keep_outputs)
        self._seed = seed
        self._keep_outputs = keep_outputs
        self._scratch: Path | None = None
        self._open = False

    def __enter__(self) -> Self:
        import libsumo

        if libsumo.isLoaded():
            raise InputError(
                "a SUMO simulation is already open in this process; close it first (libsumo holds only one)"
            )
        self.api: Any = libsumo
        if not self._keep_outputs:
            self._scratch = Path(tempfile.mkdtemp(prefix="slrl_sumo_"))
        command = start_command(self.scenario, step_length=self.step_length, seed=self._seed, outputs_to=self._scratch)
        self._open = True
        with _captured_output() as printed:
            try:
                libsumo.start(command)
            except (libsumo.TraCIException, libsumo.FatalTraCIError) as error:
                # Refused while reading routes, SUMO stays half loaded and would block every later session.
                self.close()
                added = " ".join(f"--{name} {value}" for name, value in self.scenario.added.items())
                where = f"{self.scenario.config}{f' with --sumo-options {added!r}' if added else ''}"
                raise InputError(f"{where}: {_sumo_reason(printed, str(error))}") from None
        try:
            self.network: Network = read_network(libsumo)
            self.placement = SpawnedControl(libsumo, self.network)
            self.reader = Reader(libsumo)
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        refused = isinstance(error, self.api.TraCIException | self.api.FatalTraCIError)
        time = self.time if refused else 0.0
        self.close()
        if refused:
            raise SumoError(f"SUMO refused a call at {time:g} s: {' '.join(str(error).split())}") from error

    @property
    def time(self) -> float:
        """Simulation time in s: that of the next step, as libsumo counts."""
        return float(self.api.simulation.getTime())

    @property
    def end(self) -> float | None:
        """The scenario's end in s, None where it has none."""
        return self.scenario.seconds("end")

    def step(self) -> None:
        """One SUMO step. Raises SumoError when SUMO gives up."""
        time = self.time
        try:
            self.api.simulationStep()
        except (self.api.TraCIException, self.api.FatalTraCIError) as error:
            raise SumoError(f"SUMO stopped at {time:g} s: {' '.join(str(error).split())}") from None

    def close(self) -> None:
        """End the simulation and remove what SUMO wrote on the side."""
        try:
            # Another session may have been opened since this one was closed: it is not ours to end.
            if self._open and self.api.isLoaded():
                self.api.close()
        finally:
            self._open = False
            if self._scratch is not None:
                shutil.rmtree(self._scratch, ignore_errors=True)


def _sumo_reason(printed: IO[bytes], message: str) -> str:
    """SUMO's reason for refusing a scenario as one line: its first error with the lines that continue it."""
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
    """Everything that this process, C++ code included, prints to stdout and stderr meanwhile goes to a file."""
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
    """Version that the library itself reports; it may differ from its package's where PYTHONPATH points elsewhere."""
    import libsumo

    return str(libsumo.getVersion()[1]).removeprefix("SUMO ").strip()
