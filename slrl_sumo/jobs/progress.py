"""Progress bars on a terminal; no output otherwise."""

import sys

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn


def progress(*columns: str, quiet: bool = False) -> Progress:
    """A progress bar on stderr with extra text columns (formats over task fields); disabled if stderr is no
    terminal."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        *(TextColumn(column) for column in columns),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=quiet or sys.stderr is None or not sys.stderr.isatty(),
    )
