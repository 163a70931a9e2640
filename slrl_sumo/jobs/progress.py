"""Progress bars on a terminal; no output otherwise."""

import sys

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn


def bar_console(*, quiet: bool = False) -> Console:
    """stderr for progress bars; its `quiet` says that there is none, because stderr is no terminal.

    A disabled bar needs a quiet console: before 14.3, rich ends it by an empty line.
    """
    return Console(stderr=True, quiet=quiet or sys.stderr is None or not sys.stderr.isatty())


def progress(*columns: str, quiet: bool = False) -> Progress:
    """A progress bar on stderr with extra text columns (formats over task fields); disabled if stderr is no
    terminal."""
    console = bar_console(quiet=quiet)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        *(TextColumn(column) for column in columns),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=console.quiet,
    )
