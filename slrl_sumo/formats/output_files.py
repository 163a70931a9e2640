"""Files that are written for the user: checks before long work, and one clear line where writing fails."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from slrl_sumo.errors import InputError


def check_parent(path: Path) -> None:
    """Raise InputError where the folder that shall hold `path` does not exist."""
    parent = path.resolve().parent
    if not parent.is_dir():
        raise InputError(f"{path}: the folder {parent} does not exist; create it or name another")


def check_writable(path: Path, *, folder: bool = False) -> None:
    """Raise InputError where `path` cannot become a file, or with `folder` a folder with results."""
    check_parent(path)
    if path.exists() and path.is_dir() != folder:
        raise InputError(f"{path}: is a {'file; name a folder' if folder else 'folder; name a file'}")
    if not os.access(path if path.exists() else path.resolve().parent, os.W_OK):
        raise InputError(f"{path}: cannot be written; name a place where you may write")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn an OSError into an InputError that names `path`, a file or a folder."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); name a place where you may write") from None


def write_file(path: Path, content: str | bytes) -> None:
    """Write a whole file, text in UTF-8; where that fails, no half of it is left and InputError is raised."""
    with writing(path):
        try:
            path.write_bytes(content.encode() if isinstance(content, str) else content)
        except OSError:
            with suppress(OSError):
                if path.is_file():
                    path.unlink()
            raise


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Write `values` as indented JSON; see `write_file`."""
    write_file(path, json.dumps(values, indent=2) + "\n")
