"""The file of finished episodes, from which an evaluation that was cut off goes on."""

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from slrl_sumo.errors import InputError
from slrl_sumo.metrics.outcomes import TypeOutcome
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.studies.episodes.episode import WARM_UP, Episode, EpisodeSettings
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.options import input_files
from slrl_sumo.version import __version__

Outcome = tuple[TypeOutcome, ...]


def log_header(settings: EpisodeSettings, scenario: Scenario, bundle: ModelBundle) -> dict[str, Any]:
    """All that the outcome of an episode depends on beside the Episode itself: the first line of the file."""
    return {
        "version": __version__,
        "scenario": scenario.name,
        "scenario_sha256": _scenario_hash(scenario),
        "bundle": bundle.name,
        "bundle_sha256": _bundle_hash(bundle),
        "steps": settings.steps,
        "warm_up_s": WARM_UP,
    }


class EpisodeLog:
    """`episodes.jsonl`: a header, then one line for each finished episode, none of which is kept in memory.

    Half a line at the end, left by a process that was killed, is cut off. Raises InputError where the file cannot be
    used, or belongs to an evaluation with another header.
    """

    def __init__(self, file: Path, header: dict[str, Any]) -> None:
        self.file = file
        try:
            if not file.exists() or self._cut() == 0:
                file.write_text(json.dumps(header) + "\n", encoding="utf-8")
            with open(file, "rb") as stream:
                found = _parsed(file, stream.readline())
        except OSError as error:
            raise InputError(f"{file}: cannot be written ({error.strerror}); name another --out") from None
        other = [name for name in header if found.get(name) != header[name]]
        if other:
            name = other[0]
            raise InputError(
                f"{file}: its episodes are of other settings ({name.removesuffix('_sha256')} "
                f"{_short(found.get(name))}, not {_short(header[name])}); name another --out, or delete it"
            )

    def read(self) -> Iterator[tuple[Episode, Outcome]]:
        """The episodes that are in the file, one after the other."""
        with open(self.file, "rb") as stream:
            stream.readline()
            for line in stream:
                values = _parsed(self.file, line)
                try:
                    parts = tuple(
                        TypeOutcome(
                            **{**part, "present": tuple(part["present"]), "survived": tuple(part["survived"])},
                        )
                        for part in values.pop("outcome")
                    )
                    episode = Episode(**values)
                except (ValueError, TypeError, KeyError, AttributeError):
                    raise _damaged(self.file) from None
                yield episode, parts

    def add(self, episode: Episode, outcome: Outcome) -> None:
        """Append a finished episode, at once."""
        line = json.dumps(asdict(episode) | {"outcome": [asdict(part) for part in outcome]})
        try:
            with open(self.file, "a", encoding="utf-8") as stream:
                stream.write(line + "\n")
        except OSError as error:
            raise InputError(f"{self.file}: cannot be written ({error.strerror}); make room and go on") from None

    def _cut(self) -> int:
        """Cut off half a line at the end; returns the size of what is left."""
        size = self.file.stat().st_size
        with open(self.file, "rb") as stream:
            end = size
            while end:
                begin = max(0, end - 65536)
                stream.seek(begin)
                newline = stream.read(end - begin).rfind(b"\n")
                end = begin + newline + 1 if newline >= 0 else begin
                if newline >= 0:
                    break
        if end < size:
            os.truncate(self.file, end)
        return end


def _parsed(file: Path, line: bytes) -> dict[str, Any]:
    try:
        values = json.loads(line.decode("utf-8"))
    except ValueError:
        raise _damaged(file) from None
    if not isinstance(values, dict):
        raise _damaged(file)
    return values


def _damaged(file: Path) -> InputError:
    return InputError(f"{file}: is damaged or something else; name another --out, or delete it")


def _short(value: Any) -> str:
    return f"{value}"[:12]


def _scenario_hash(scenario: Scenario) -> str:
    digest = hashlib.sha256()
    files = [scenario.config]
    for option in ("net-file", "route-files", "additional-files"):
        files += input_files(scenario, option)
    for file in files:
        if file.is_file():  # if not, SUMO will say so
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _bundle_hash(bundle: ModelBundle) -> str:
    digest = hashlib.sha256(bundle.mode_centres.tobytes())
    for module in (bundle.displacement, bundle.prior, bundle.policy):
        for tensor in module.state_dict().values() if module is not None else ():
            digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()
