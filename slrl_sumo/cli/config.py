"""Options from a file: `run --config`, a TOML file or the summary of a run that is to be repeated."""

import difflib
import inspect
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

import typer

from slrl_sumo.errors import InputError
from slrl_sumo.input_files import read_json, read_toml

OUTPUTS = ("fcd", "summary", "report")
"""Options of a summary that are not repeated: they would overwrite the outputs of the first run."""
NOT_IN_A_FILE = ("config", "verbose")
EXPECTED = {bool: "true or false", int: "a whole number", float: "a number", list: "a list of texts"}


def use_config(context: typer.Context, file: Path | None) -> Path | None:
    """Callback of --config: the options in `file` become the defaults of the command. Raises InputError."""
    if file is None or context.resilient_parsing or context.command.callback is None:
        return file
    signature = inspect.signature(context.command.callback, eval_str=True)
    kinds = {name: _kind(it.annotation) for name, it in signature.parameters.items() if name not in NOT_IN_A_FILE}
    defaults = {}
    for key, value in read_options(file).items():
        name = key.replace("-", "_")
        if name not in kinds:
            near = difflib.get_close_matches(name, kinds, n=1)
            known = f"is it {near[0]}?" if near else f"known are {', '.join(kinds)}"
            raise InputError(f"{file}: there is no option '{key}'; {known}")
        defaults[name] = _converted(value, kinds[name], f"{file}: {key}")
    context.default_map = defaults
    return file


def read_options(file: Path) -> dict[str, Any]:
    """The options in a TOML file or in the summary (.json) of a run. Raises InputError."""
    summary = file.suffix == ".json"
    try:
        if not summary:
            return read_toml(file)
        options = read_json(file)["options"]
        return {key: value for key, value in options.items() if value is not None and key not in OUTPUTS}
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror or error}); name another `config`") from None
    except ValueError as error:
        raise InputError(f"{file}: is no {'JSON' if summary else 'TOML'} ({error})") from None
    except (KeyError, TypeError, AttributeError):
        raise InputError(f"{file}: is no summary of a run with its options; give one, or a TOML file") from None


def _kind(annotation: Any) -> type:
    """bool, int, float, list or str (paths, too) of Annotated[int | None, …]."""
    options = get_args(get_args(annotation)[0]) or (get_args(annotation)[0],)
    kind = next(option for option in options if option is not type(None))
    kind = get_origin(kind) or kind
    return kind if kind in (bool, int, float, list) else str


def _converted(value: Any, kind: type, where: str) -> Any:
    """The value as the command line takes it: shares, which may be a table, as text. Raises InputError."""
    if kind is str and isinstance(value, Mapping):
        value = ",".join(f"{name}={share}" for name, share in value.items())
    fits = type(value) in (int, float) if kind is float else type(value) is kind
    if not fits or (kind is list and not all(isinstance(item, str) for item in value)):
        text = json.dumps(value, default=str)
        raise InputError(f"{where} is {text}: give {EXPECTED.get(kind, 'a text in quotes')}")
    return value
