"""The summary of a run as a table on stdout."""

import errno
import os
import sys
from dataclasses import replace

from rich.table import Table

from slrl_sumo.api.result import RunResult
from slrl_sumo.errors import InputError
from slrl_sumo.jobs.tables import table_text


def print_summary(result: RunResult) -> RunResult:
    """Print the table. Returns the result, with a failure more where the table could not be printed."""
    headings, rows = result.summary.rows()
    table = Table(title=result.summary.title, title_justify="left")
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="right" if number else "left")
    for row in rows:
        table.add_row(*row)
    # Rendered first: rich itself would end the process where the reader of a pipe is gone.
    lines = filter(None, (result.summary.left_line, result.summary.refusal_line))
    text = table_text(table) + "".join(f"{line}\n" for line in lines)
    try:
        if sys.stdout is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        # The rest in the buffer would make Python complain once more when it ends.
        sys.stdout = None
        failure = InputError(f"standard output: the table could not be printed ({error.strerror}); --quiet prints none")
        return replace(result, failures=(*result.failures, failure))
    return result
