"""Files in the folder of a training from which it is resumed: the checkpoint, and records in JSON."""

import json
import os
import zipfile
from pathlib import Path
from typing import Any

import torch

from slrl_sumo.errors import InputError
from slrl_sumo.input_files import open_input, read_json
from slrl_sumo.learning.rl.actor import Agent

STATES = ("policy", "begin", "optimizer")
"""Parts of an Agent in a checkpoint, in addition to the number of updates."""


def save_checkpoint(folder: Path, agent: Agent, iteration: int) -> None:
    """Write a checkpoint atomically: a training killed while it writes resumes from the previous checkpoint."""
    state = {"iteration": iteration} | {name: getattr(agent, name).state_dict() for name in STATES}
    torch.save(state, folder / "checkpoint.new")
    os.replace(folder / "checkpoint.new", folder / "checkpoint.pt")


def read_checkpoint(file: Path) -> dict[str, Any]:
    """The state in a checkpoint: tensors and numbers, never other objects."""
    try:
        with open_input(file) as stream:
            # PyTorch does not compress: a declared size above the file's size would be allocated.
            with zipfile.ZipFile(stream) as archive:
                if sum(info.file_size for info in archive.infolist()) > os.fstat(stream.fileno()).st_size:
                    raise ValueError("it unpacks to more than its size")
            stream.seek(0)
            state = torch.load(stream, weights_only=True)
        return {"iteration": int(state["iteration"])} | {key: dict(state[key]) for key in STATES}
    except Exception as error:
        # zipfile and PyTorch raise many kinds of errors for damaged files.
        reason = " ".join(str(getattr(error, "strerror", None) or error).split())[:200]
        raise InputError(f"{file}: is damaged ({reason}); delete it to start again") from None


def restore(agent: Agent, state: dict[str, Any], checkpoint: Path) -> None:
    """Set the agent to the state of `checkpoint`. Raises InputError if the state does not fit."""
    try:
        for name in STATES:
            getattr(agent, name).load_state_dict(state[name])
    except (RuntimeError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{checkpoint}: is damaged ({reason}); delete it to start again") from None


def read_record(file: Path) -> dict[str, Any]:
    """A JSON object in the folder of a training."""
    try:
        values = read_json(file)
        if not isinstance(values, dict):
            raise ValueError("no JSON object")
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise InputError(f"{file}: is damaged ({reason}); delete {file.parent} to start again") from None
    return values


def write_record(file: Path, values: Any) -> None:
    """Write JSON."""
    file.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
