"""The log of a study: one line for each finished job, from which an interrupted study continues."""

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from slrl_sumo.errors import InputError
from slrl_sumo.input_files import open_input, parse_json
from slrl_sumo.models.bundle import ModelBundle
from slrl_sumo.sumo.scenario import Scenario
from slrl_sumo.sumo.scenario.options import input_files
from slrl_sumo.version import __version__

Entry = TypeVar("Entry")

LINE = 64 << 20
"""Bytes: longest line that is read; one of 10,000 road users has less than 10 MB."""
TAIL_BLOCK = 65536
"""Bytes read at once from the end of the file."""


def inputs_header(scenario: Scenario, bundle: ModelBundle) -> dict[str, Any]:
    """Version, scenario and bundle on which the results of a study depend: names, and hashes of the contents."""
    named = {"version": __version__, "scenario": scenario.name, "scenario_sha256": _scenario_hash(scenario)}
    return named | bundle_header(bundle)


def bundle_header(bundle: ModelBundle) -> dict[str, Any]:
    """Version and bundle on which the results of a study depend: its name, and a hash of its contents."""
    return {"version": __version__, "bundle": bundle.name, "bundle_sha256": _bundle_hash(bundle)}


class StudyLog:
    """A file of JSON lines: a header, then one line for each finished job. No line is kept in memory.

    `header`: all settings on which the results depend besides the jobs themselves; `jobs`: what the jobs are called in
    messages, a plural. An incomplete last line, left by a killed process, is removed. Raises InputError where the file
    cannot be used, or belongs to a study with another header.
    """

    def __init__(self, file: Path, header: dict[str, Any], jobs: str) -> None:
        self.file = file
        try:
            if file.exists():
                open_input(file).close()
            if not file.exists() or self._remove_incomplete_line() == 0:
                file.write_text(json.dumps(header) + "\n", encoding="utf-8")
            with open(file, "rb") as stream:
                found = self._parsed(stream.readline(LINE))
        except OSError as error:
            raise InputError(f"{file}: cannot be used ({error.strerror}); name another --out") from None
        other = next((name for name in header if found.get(name) != header[name]), None)
        if other is not None:
            raise InputError(
                f"{file}: its {jobs} are of other settings ({other.removesuffix('_sha256')} "
                f"{str(found.get(other))[:30]}, not {str(header[other])[:30]}); name another --out, or delete it"
            )

    def read(self, parse: Callable[[dict[str, Any]], Entry]) -> Iterator[Entry]:
        """`parse` of each finished job in the file, in order; its ValueErrors, TypeErrors and KeyErrors say that the
        file is damaged."""
        with open(self.file, "rb") as stream:
            stream.readline(LINE)
            while line := stream.readline(LINE):
                values = self._parsed(line)
                try:
                    entry = parse(values)
                except (ValueError, TypeError, KeyError, AttributeError, ArithmeticError, IndexError):
                    raise self._damaged() from None
                yield entry

    def add(self, values: dict[str, Any]) -> None:
        """Append a finished job at once."""
        try:
            with open(self.file, "a", encoding="utf-8") as stream:
                stream.write(json.dumps(values) + "\n")
        except OSError as error:
            raise InputError(f"{self.file}: cannot be written ({error.strerror}); make room and go on") from None

    def _remove_incomplete_line(self) -> int:
        """Cut off an incomplete last line; returns the size of the rest."""
        size = self.file.stat().st_size
        with open(self.file, "rb") as stream:
            end = size
            while end:
                if size - end > LINE:
                    raise self._damaged()
                begin = max(0, end - TAIL_BLOCK)
                stream.seek(begin)
                newline = stream.read(end - begin).rfind(b"\n")
                end = begin + newline + 1 if newline >= 0 else begin
                if newline >= 0:
                    break
        if end < size:
            os.truncate(self.file, end)
        return end

    def _parsed(self, line: bytes) -> dict[str, Any]:
        try:
            values = parse_json(line.decode("utf-8"))
        except ValueError:
            raise self._damaged() from None
        if not isinstance(values, dict):
            raise self._damaged()
        return values

    def _damaged(self) -> InputError:
        return InputError(f"{self.file}: is damaged or something else; name another --out, or delete it")


def _scenario_hash(scenario: Scenario) -> str:
    digest = hashlib.sha256()
    files = [scenario.config]
    for option in ("net-file", "route-files", "additional-files"):
        files += input_files(scenario, option)
    for file in files:
        if file.is_file():  # SUMO reports files that are missing
            with open_input(file) as stream:
                while block := stream.read(1 << 20):
                    digest.update(block)
    return digest.hexdigest()


def _bundle_hash(bundle: ModelBundle) -> str:
    digest = hashlib.sha256(bundle.mode_centres.tobytes())
    for module in (bundle.displacement, bundle.prior, bundle.policy):
        for tensor in module.state_dict().values() if module is not None else ():
            digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()
