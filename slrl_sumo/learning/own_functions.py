"""Calls of users' functions for observations and rewards."""

import traceback
from collections.abc import Callable
from typing import TypeVar

from slrl_sumo.errors import InputError

Given = TypeVar("Given")
Returned = TypeVar("Returned")


def called(argument: str, function: Callable[[Given], Returned], given: Given) -> Returned:
    """The result of the user's function in this argument. Raises InputError with the place of the error if it fails."""
    try:
        return function(given)
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        where = f"line {last.lineno}, in {last.name}"
        if not last.filename.startswith("<"):  # since version 3.1.3 cloudpickle leaves out the file of a script's code
            where = f"{last.filename}, {where}"
        raise InputError(f"it raised {type(error).__name__} ({where}): {error}", argument=argument) from error
