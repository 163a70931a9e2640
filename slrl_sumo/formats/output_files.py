"""Files that are written for the user: checks before long work, and one clear line where writing fails.

A command claims all its outputs at once, before it starts anything that takes time: see `claimed`.
"""

import hashlib
import json
import os
import socket
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from fnmatch import fnmatch
from itertools import combinations
from pathlib import Path
from typing import Any

from slrl_sumo.errors import InputError

MAX_NAME = 200
"""Greatest length (bytes) of a name: file systems allow 255, and temporary names are longer than the name."""
REPLACED = ("*",)
"""`holds` of a folder that is replaced as a whole."""


@dataclass(frozen=True)
class Output:
    """A file, or a folder with results, that a command writes."""

    argument: str
    """Name for the user: `fcd` is --fcd on the command line."""
    path: Path
    holds: tuple[str, ...] = ()
    """Patterns of the names that are written into a folder; empty for a file."""

    @property
    def where(self) -> Path:
        """The path without links."""
        return Path(os.path.realpath(self.path))

    def __str__(self) -> str:
        return f"`{self.argument}={self.path}`"


@contextmanager
def claimed(outputs: Sequence[Output], inputs: Iterable[Path] = ()) -> Iterator[None]:
    """Check that `outputs` can be written, and keep other processes of this package from writing them meanwhile.

    Raises InputError where one cannot be written (see `check_writable`), where two are the same or one lies in a folder
    that the other replaces, where one overwrites one of the files `inputs` (of a folder: its files), and where another
    process has claimed it. Nothing is created, and the claim ends with the process, however it dies. Links are
    followed.
    """
    for output in outputs:
        check_writable(output.path, folder=bool(output.holds))
    for one, other in combinations(outputs, 2):
        if _overwrites(one, other.path) or _overwrites(other, one.path):
            raise InputError(f"{one} and {other} would overwrite each other; give them different names")
    for path in _files(inputs):
        for output in outputs:
            if _overwrites(output, path):
                raise InputError(f"{output} would overwrite the input {path}; give it another name")
    with ExitStack() as stack:
        for output in outputs:
            stack.enter_context(_locked(output))
        yield


def check_writable(path: Path, *, folder: bool = False) -> None:
    """Raise InputError where `path` cannot become a file, or with `folder` a folder with results."""
    try:
        place = Path(os.path.realpath(path))
        name, parent = place.name, place.parent
        if len(os.fsencode(name)) > MAX_NAME:
            raise InputError(f"{path}: the name is too long; give one of at most {MAX_NAME} bytes")
        if place.is_symlink():
            raise InputError(f"{path}: is a link to itself; name another place")
        if not parent.is_dir():
            raise InputError(f"{path}: the folder {parent} does not exist; create it or name another")
        exists = place.exists()
        if exists and place.is_dir() != folder:
            raise InputError(f"{path}: is {'a file; name a folder' if folder else 'a folder; name a file'}")
        if exists and not folder and not place.is_file():
            raise InputError(f"{path}: is a device or a pipe; name a file")
        if exists and not os.access(place, os.W_OK):
            raise PermissionError(None, "Permission denied")
        # Some locations refuse files despite sufficient rights, even for root: /proc, full and damaged disks.
        tempfile.TemporaryFile(dir=place if exists and folder else parent).close()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be written ({reason}); name a place where you may write") from None


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError into an InputError that names `path`, a file or a folder."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); name a place where you may write") from None


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name beside `path` to write to: at the end that file takes the place of `path`, which thus is whole at any
    time; where writing fails, nothing is left of it. Raises InputError."""
    place = Path(os.path.realpath(path))
    part = place.with_name(f".{place.name}.{os.getpid()}.part")
    with writing(path):
        try:
            yield part
            os.replace(part, place)
        finally:
            part.unlink(missing_ok=True)


def write_file(path: Path, content: str | bytes) -> None:
    """Write a whole file, text in UTF-8, or none: see `replacing`."""
    with replacing(path) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Write `values` as indented JSON; see `write_file`."""
    write_file(path, json.dumps(values, indent=2) + "\n")


def _files(paths: Iterable[Path]) -> Iterator[Path]:
    """`paths`, with the files of a folder in its place."""
    for path in paths:
        try:
            yield from sorted(path.iterdir())
        except OSError:
            yield path


def _overwrites(output: Output, path: Path) -> bool:
    """Whether writing `output` overwrites `path`, or files in the folder `path`."""
    where = Path(os.path.realpath(path))
    if output.where == where or (not output.holds and _same_file(output.path, path)):
        return True
    if output.where not in where.parents:
        return False
    return any(fnmatch(where.relative_to(output.where).parts[0], pattern) for pattern in output.holds)


def _same_file(one: Path, other: Path) -> bool:
    """Whether two names are links to one file."""
    try:
        return one.samefile(other)
    except OSError:
        return False


@contextmanager
def _locked(output: Output) -> Iterator[None]:
    """Hold the name of the output in Linux's abstract socket namespace: no file is left behind, and the kernel frees
    the name when the process ends. Other systems have none, and other machines and containers do not see it."""
    if sys.platform != "linux":
        yield
        return
    name = hashlib.sha256(os.fsencode(output.where)).hexdigest()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as claim:
        try:
            claim.bind(f"\0slrl_sumo/{name}")
        except OSError:
            raise InputError(f"{output}: another run writes it; wait for its end, or give another name") from None
        yield
