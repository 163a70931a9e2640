"""The errors that the package raises on purpose.

SlrlError
├── InputError      an input is wrong: one line says what, where and how to correct it (exit code 1)
├── SumoError       SUMO itself failed while a simulation was running (exit code 3)
└── DefectError     the package failed by a defect of its own (exit code 4)
"""

import difflib
import re
import traceback
from collections.abc import Collection
from typing import Any


class SlrlError(Exception):
    """Base of all errors of this package. The message is one line."""

    def as_options(self) -> str:
        """The message in the words of the command line."""
        return str(self)


class InputError(SlrlError):
    """An input is wrong. The message says what, where and how to correct it.

    `argument` and `value` name the argument that is wrong, where it is one. The message refers to other arguments
    between backticks, as `agents=64`. Both read as Python in `str(error)` and as options in `as_options()`:
    takeover={'car': 3} there is --takeover car=3 here.
    """

    def __init__(self, message: str, *, argument: str | None = None, value: Any = None) -> None:
        super().__init__(message)
        self.argument, self.value = argument, value

    def __str__(self) -> str:
        message = super().__str__()
        if self.argument is None:
            return message
        return f"{self.argument}{'' if self.value is None else f'={self.value!r}'}: {message}"

    def as_options(self) -> str:
        """The message in the words of the command line."""
        message = _REFERENCE.sub(lambda found: _option(found[1], found[2]), super().__str__())
        if self.argument is None:
            return message
        return f"{_option(self.argument, self.value)}: {message}"


class SumoError(SlrlError):
    """SUMO refused to continue, or died while a simulation was running."""


class DefectError(SlrlError):
    """A defect of this package: an exception for which it has no message.

    `details`: the traceback, perhaps of another process. Python prints it below the message.
    """

    def __init__(self, message: str, details: str = "") -> None:
        super().__init__(message, details)
        self.details = details
        self.add_note(details)

    def __str__(self) -> str:
        return str(self.args[0])

    @classmethod
    def of(cls, error: Exception) -> "DefectError":
        """The defect that `error` shows; a DefectError is one already."""
        if isinstance(error, cls):
            return error
        what = " ".join(f"{type(error).__name__}: {error}".split())[:200].rstrip(": ")
        return cls(f"a defect of slrl_sumo ({what})", "".join(traceback.format_exception(error)))


def check_whole_number(argument: str, value: int, least: int, most: int) -> None:
    """Raise InputError where `value` is no whole number from `least` to `most`."""
    if isinstance(value, bool) or not hasattr(value, "__index__") or not least <= value <= most:
        raise InputError(f"give a whole number from {least} to {most}", argument=argument, value=value)


def check_type(argument: str, value: Any, kinds: tuple[type, ...], expected: str) -> None:
    """Raise InputError where `value` is of none of the types; `expected` says in words what to give."""
    if not isinstance(value, kinds):
        raise InputError(f"give {expected}", argument=argument, value=value)


def suggestion(name: str, known: Collection[str]) -> str:
    """How a message about an unknown name ends: with the nearest one of the `known` names, or with all of them."""
    close = difflib.get_close_matches(name, known, 1)
    return f"; did you mean '{close[0]}'?" if close else f"; there are {', '.join(known)}"


_REFERENCE = re.compile(r"`([a-z_]+)(?:=([^`]*))?`")


def _option(name: str, value: Any) -> str:
    """'--takeover car=0.3' of the name and the value of an argument; '--guard' of a flag."""
    option = f"--{name.replace('_', '-')}"
    text = "" if value is None else f"{value:g}" if isinstance(value, float) else str(value).strip("'\"")
    return option if text in ("", "True") else f"{option} {text}"
