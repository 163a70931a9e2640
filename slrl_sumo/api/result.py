"""The result of a run: summary, trajectories, report and replay."""

import tempfile
import warnings
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from slrl_sumo.api.summary import RunSummary
from slrl_sumo.errors import DefectError, InputError, SlrlError
from slrl_sumo.extras import require
from slrl_sumo.formats.fcd.trace import trace_files
from slrl_sumo.formats.output_files import Output, claimed
from slrl_sumo.formats.trajectories import Trajectories
from slrl_sumo.models.bundle_folder import find_bundle
from slrl_sumo.report.recorder import RunRecord
from slrl_sumo.simulation.settings import RunSettings
from slrl_sumo.sumo.scenario.options import named_files

REPORT_FILES = ("*.html", "*.png")
"""What a report writes into its folder."""


@dataclass(frozen=True)
class InlineReplay:
    """A replay page that a notebook shows in a frame of its own."""

    page: str = field(repr=False)
    """The page, HTML."""
    height: int
    """px."""

    def _repr_html_(self) -> str:
        frame = f'<iframe srcdoc="{escape(self.page)}" width="100%" height="{self.height}" style="border: 0"'
        return f'{frame} sandbox="allow-scripts allow-downloads" title="replay"></iframe>'


@dataclass(frozen=True, eq=False)
class RunResult:
    """Result of a run; shown as a table in a notebook."""

    settings: RunSettings
    summary: RunSummary
    record: RunRecord | None = field(default=None, repr=False)
    """Record from which trajectories, report and replay are made; None if the run was not asked to keep it."""
    fcd: Path | None = None
    """Path of the written trace."""
    failures: tuple[SlrlError, ...] = ()
    """Errors that ended the run early, and outputs that could not be written."""
    interrupted_by: int = 0
    """Number of the signal that ended the run; 0 without one."""

    @property
    def trajectories(self) -> Trajectories:
        """All road users of the run every 0.4 s; of a long run the first million positions, with a warning.

        Raises InputError where the run kept none.
        """
        record = self._kept()
        if record.cut:
            warnings.warn(
                f"the run was long: trajectories hold its first {record.seconds:.0f} s; for all of it write a trace "
                "with fcd=FILE and read that with slrl_sumo.read_fcd",
                stacklevel=2,
            )
        return record.tracks

    def report(self, folder: str | Path, recording: Trajectories | None = None) -> Path:
        """Write report.html and its figures into `folder`; returns the page.

        `recording`: trajectories to compare the learned road users with; None: SUMO's own road users in the same run.
        Raises InputError where the run kept no trajectories, and where the folder cannot be written.
        """
        require("matplotlib", "a report")
        folder = Path(folder)
        with claimed([Output("folder", folder, REPORT_FILES)], self._inputs()):
            return self.write_report(folder, recording)

    def write_report(self, folder: Path, recording: Trajectories | None = None) -> Path:
        """Like `report`, into a folder that is already claimed."""
        from slrl_sumo.report.report import write_report  # matplotlib takes its time

        write_report(self._kept(), folder, self.summary.to_dict(), recording)
        return folder / "report.html"

    def replay(self, file: str | Path) -> Path:
        """Write the page that plays the run over its network: of its trace where one was written, with all SUMO steps,
        else of its trajectories. Returns `file`.

        Raises InputError where the run wrote no trace and kept no trajectories, and where the page cannot be written.
        """
        file = Path(file)
        with claimed([Output("file", file)], self._inputs()):
            from slrl_sumo.replay.page import write_replay, write_trajectories_replay

            if self.fcd is not None and self.fcd.is_file():
                write_replay(self.fcd, self.settings.where, file)
            else:
                tracks, signals = self.trajectories, self._kept().signals
                write_trajectories_replay(
                    tracks, self.settings.where, file, title=self.summary.scenario, signals=signals
                )
        return file

    def show(self, height: int = 560) -> "InlineReplay":
        """The replay inside a notebook, `height` px high. Raises InputError as `replay` does."""
        with tempfile.TemporaryDirectory(prefix="slrl_sumo_") as folder:
            return InlineReplay(self.replay(Path(folder) / "replay.html").read_text(encoding="utf-8"), height)

    def raise_failures(self) -> None:
        """Raise what went wrong: the first failure, with the others behind it in its message; an interrupt."""
        if self.failures:
            message = "; ".join(map(str, self.failures))
            defects = [failure for failure in self.failures if isinstance(failure, DefectError)]
            raise DefectError(message, defects[0].details) if defects else type(self.failures[0])(message)
        if self.interrupted_by:
            raise KeyboardInterrupt(self.interrupted_by)

    def _inputs(self) -> list[Path]:
        """Files that no page may replace."""
        trace = [] if self.fcd is None else trace_files(self.fcd)
        return [*named_files(self.settings.found()), find_bundle(self.settings.bundle), *trace]

    def _kept(self) -> RunRecord:
        if self.record is None:
            raise InputError("the run kept no trajectories; call run with keep_trajectories=True")
        return self.record

    def _repr_html_(self) -> str:
        return self.summary._repr_html_()
