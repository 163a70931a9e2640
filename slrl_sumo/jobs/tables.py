"""Tables on stdout: with lines and colours on a terminal, plain text without boxes where the output is piped."""

import io

from rich.console import Console
from rich.table import Table


def table_text(table: Table, width: int = 120) -> str:
    """The table as text for stdout; `width`: number of columns if stdout is not a terminal."""
    text = io.StringIO()
    if Console().is_terminal:
        Console(file=text, width=Console().width, force_terminal=True).print(table)
        return text.getvalue()
    table.box, table.pad_edge, table.padding = None, False, (0, 2, 0, 0)
    Console(file=text, width=width, force_terminal=False).print(table)
    return "".join(f"{line.rstrip()}\n" for line in text.getvalue().splitlines())


def print_table(table: Table, width: int = 120) -> None:
    """Print the table on stdout; see `table_text`."""
    print(table_text(table, width), end="")
