"""Tables of numbers and words in text files, read at once; errors name line and column."""

import csv
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slrl_sumo.errors import InputError
from slrl_sumo.formats.trajectories import Integers
from slrl_sumo.input_files import check_lines, open_input
from slrl_sumo.scene.geometry import Floats

HIGHEST_NUMBER = 1e15
"""Highest whole number; all are exact up to there."""
_WORD = 32
"""Longest word kept, characters."""


@dataclass(frozen=True, eq=False)
class Table:
    """N rows of a file, by column."""

    path: Path
    delimiter: str | None
    header: bool
    columns: dict[str, NDArray[np.generic]]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def numbers(self, column: str) -> Floats:
        """(N,) finite numbers; NaN where an optional one is not given."""
        return self.columns[column].astype(np.float64, casting="safe")

    def integers(self, column: str) -> Integers:
        """(N,) whole numbers. Raises InputError where one is not whole."""
        values = self.numbers(column)
        if (odd := values != np.round(values)).any():
            row = int(np.flatnonzero(odd)[0])
            raise InputError(f"{self.where(row)}: column {column!r} needs whole numbers, it is {values[row]:g}")
        if (odd := np.abs(values) > HIGHEST_NUMBER).any():
            row = int(np.flatnonzero(odd)[0])
            raise InputError(
                f"{self.where(row)}: column {column!r} is {values[row]:g}: at most {HIGHEST_NUMBER:g} is possible"
            )
        return values.astype(np.int64)

    def words(self, column: str) -> NDArray[np.str_]:
        """(N,) words, without blanks around them."""
        return np.char.strip(self.columns[column].astype(np.str_))

    def where(self, row: int) -> str:
        """Name of the file and line of a row, for messages."""
        lines = _lines(self.path, self.delimiter)
        for _ in range(row + self.header):
            next(lines)
        return f"{self.path}, line {next(lines)[0]}"


class EmptyTableError(InputError):
    """A table without rows."""


def read_table(
    path: Path,
    numbers: Sequence[str],
    words: Sequence[str] = (),
    names: Sequence[str] = (),
    delimiter: str | None = ",",
    optional: Sequence[str] = (),
) -> Table:
    """Read the columns `numbers` and `words` of a text file; others are ignored.

    Without `names` the first line names the columns; with them there is no such line, and the file has just those
    columns. `delimiter` None means blanks; instead of commas the first line may have semicolons or tabs. Cells of the
    columns `optional`, some of `numbers`, may be empty. Raises InputError, with line and column, where the file cannot
    be read or is cut off, lacks a column, or has something else where a finite number is needed, and EmptyTableError
    where it has no rows.
    """
    header = not names
    try:
        check_lines(path)
        delimiter = _delimiter(path) if delimiter == "," else delimiter
        lines = _lines(path, delimiter)
        if header:
            names = [name.strip() for name in next(lines, (0, []))[1]]
        first = next(lines, (0, []))[1]
        if not first:
            raise EmptyTableError(f"{path} is empty: it holds no rows; give it whole")
        for column in (*numbers, *words):
            if column not in names:
                raise InputError(f"{path} lacks the column {column!r}; it has {', '.join(names) or 'none'}")
        dtype = [(c, np.float64) for c in numbers] + [(c, f"U{_WORD}") for c in words]
        try:
            if len(_last_line(path, delimiter)) != len(names) or len(first) != len(names):
                raise ValueError
            columns = [names.index(c) for c in (*numbers, *words)]

            def rows_by(converters: dict[int | str, Callable[[str], float]] | None) -> NDArray[np.void]:
                loaded: NDArray[np.void] = np.loadtxt(
                    path,
                    dtype,
                    comments=None,
                    delimiter=delimiter,
                    converters=converters,
                    skiprows=int(header),
                    usecols=columns,
                    ndmin=1,
                    encoding="utf-8-sig",
                    quotechar='"',
                )
                return loaded

            try:
                rows = rows_by(None)
            except UnicodeDecodeError:
                raise
            except ValueError:
                if not optional:
                    raise
                rows = rows_by({names.index(c): _number_or_nan for c in optional})  # seven times slower
        except UnicodeDecodeError:
            raise
        except ValueError as error:
            raise _complaint(path, numbers, optional, names, delimiter, header, error) from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(f"{path} is not a table in UTF-8 text") from None
    table = Table(path, delimiter, header, {name: rows[name] for name in (*numbers, *words)})
    for column in numbers:
        bad = np.isinf(rows[column]) if column in optional else ~np.isfinite(rows[column])
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise InputError(f"{table.where(row)}: column {column!r} needs a number, it is {rows[column][row]}")
    return table


def first_cells(path: Path) -> list[str]:
    """The cells of the first line of a text file, between commas, semicolons, tabs or blanks; none of an empty one.

    Raises InputError where the file cannot be read.
    """
    try:
        check_lines(path)
        delimiter = _delimiter(path)
        with open_input(path) as file:
            commas = delimiter.encode() in file.readline(65536)
        return [cell.strip() for cell in next(_lines(path, delimiter if commas else None), (0, []))[1] if cell.strip()]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error):
        raise InputError(f"{path} is not a table in UTF-8 text") from None


def codes(words: NDArray[np.generic]) -> tuple[NDArray[np.generic], Integers, Integers]:
    """The different values in order, the first row of each, and per row which one it is; quick where equals follow."""
    starts = np.flatnonzero(np.r_[True, words[1:] != words[:-1]])
    values, first, which = np.unique(words[starts], return_index=True, return_inverse=True)
    return values, starts[first], np.repeat(which, np.diff(np.r_[starts, len(words)])).astype(np.int64)


def _lines(path: Path, delimiter: str | None) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of each line that is not blank."""
    with open(path, encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file, delimiter=delimiter or " ", skipinitialspace=delimiter is None)
        for cells in reader:
            if cells:
                yield reader.line_num, cells


def _delimiter(path: Path) -> str:
    """What separates the cells of the first line."""
    with open_input(path) as file:
        line = file.readline(65536).decode("utf-8", errors="replace")
    return max(",;\t", key=line.count)


def _number_or_nan(cell: str) -> float:
    return float(cell) if cell.strip() else np.nan


def _last_line(path: Path, delimiter: str | None) -> list[str]:
    with open(path, "rb") as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - 4096))
        last = file.read().rstrip().splitlines()[-1].decode("utf-8-sig", errors="replace")
    return next(csv.reader([last], delimiter=delimiter or " ", skipinitialspace=delimiter is None))


def _complaint(
    path: Path,
    numbers: Sequence[str],
    optional: Sequence[str],
    names: Sequence[str],
    delimiter: str | None,
    header: bool,
    error: ValueError,
) -> InputError:
    """The error in the first unreadable line: a slow search, for the message only."""
    lines = _lines(path, delimiter)
    if header:
        next(lines)
    due = f"{len(names)}" if header else f"{len(names)} ({', '.join(names)})"
    short: InputError | None = None
    for line, cells in lines:
        if short is not None:
            return short
        if len(cells) < len(names):
            short = InputError(f"{path}, line {line}: {len(cells)} columns instead of {due}")
            cut = InputError(
                f"{path}, line {line}: the file is cut off, the last line has {len(cells)} of {len(names)} columns; "
                "get it whole"
            )
            continue
        if len(cells) > len(names):
            return InputError(f"{path}, line {line}: {len(cells)} columns instead of {due}")
        for column in numbers:
            cell = cells[names.index(column)]
            try:
                (_number_or_nan if column in optional else float)(cell)
            except ValueError:
                return InputError(f"{path}, line {line}: column {column!r} needs a number, it is {cell!r}")
    return cut if short is not None else InputError(f"{path} cannot be read as a table: {error}")
