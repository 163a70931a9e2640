"""The summary of a run as a table on stdout."""

import errno
import io
import os
import sys
from dataclasses import replace

from rich.console import Console
from rich.table import Table

from slrl_sumo.api.result import RunResult
from slrl_sumo.errors import InputError


def print_summary(result: RunResult) -> RunResult:
    """Print the table. Returns the result, with a failure more where the table could not be printed."""
    headings, rows = result.summary.rows()
    table = Table(title=result.summary.title, title_justify="left")
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="right" if number else "left")
    for row in rows:
        table.add_row(*row)
    # Rendered first: rich itself would end the process where the reader of a pipe is gone.
    terminal = Console().is_terminal
    text = io.StringIO()
    # Without a terminal the table need not fit into rich's 80 columns.
    Console(file=text, width=Console().width if terminal else 120, force_terminal=terminal).print(table)
    for line in filter(None, (result.summary.left_line, result.summary.refusal_line)):
        text.write(f"{line}\n")
    try:
        if sys.stdout is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        sys.stdout.write(text.getvalue())
        sys.stdout.flush()
    except OSError as error:
        # The rest in the buffer would make Python complain once more when it ends.
        sys.stdout = None
        failure = InputError(f"standard output: the table could not be printed ({error.strerror}); --quiet prints none")
        return replace(result, failures=(*result.failures, failure))
    return result
