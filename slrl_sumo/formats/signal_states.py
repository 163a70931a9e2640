"""States of traffic lights over time, in the format of SUMO's output SaveTLSStates
(https://sumo.dlr.de/docs/Simulation/Output/Traffic_Lights.html)."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.formats.growing_file import GrowingFile
from slrl_sumo.formats.sumo_time import parse_time
from slrl_sumo.formats.xml_text import escaped
from slrl_sumo.input_files import open_input, plain_xml

_HEAD, _TAIL = '<?xml version="1.0" encoding="UTF-8"?>\n\n<tlsStates>\n', "</tlsStates>\n"
_STATE = '    <tlsState time="%.2f" id="%s" programID="%s" phase="%d" state="%s"/>\n'


class SignalState(NamedTuple):
    """The state of a traffic light."""

    signal: str
    """Id of the traffic light."""
    program: str
    phase: int
    """Number of the phase in the program."""
    state: str
    """One letter for each of its links."""


Shown = dict[str, tuple[list[int], list[str]]]
"""For each traffic light, the times (ms) from which it shows its states, and these states."""


class SignalsWriter:
    """Writes the states of traffic lights as they change; the file exists from the first one on.

    Raises InputError where it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: GrowingFile | None = None

    def write(self, time: float, states: Iterable[SignalState]) -> None:
        """Add `states`, which are shown from `time` (s) on."""
        lines = [_STATE % (time, *escaped([each.signal, each.program]), each.phase, each.state) for each in states]
        if lines:
            self._file = self._file or GrowingFile(self._path, _HEAD, _TAIL)
            self._file.put("".join(lines))

    def close(self) -> None:
        """Finish the file. May be called twice."""
        if self._file is not None:
            self._file.close()


def read_signals(path: str | os.PathLike[str]) -> Shown:
    """The states of all traffic lights of a file, ours or SUMO's; what is shown again is left out.

    Raises InputError, with file and line, where it is missing, malformed, or not in the order of time.
    """
    name = os.fspath(path)
    shown: Shown = {}
    try:
        with open_input(name) as raw:
            for _, element in etree.iterparse(plain_xml(raw), tag="tlsState", resolve_entities=False):
                _add(name, element, shown)
                element.clear()
    except etree.XMLSyntaxError as error:
        raise InputError(f"{name}, line {error.lineno}: is not well-formed XML; give a file of signal states") from None
    except OSError as error:
        raise InputError(f"cannot read {name}: {error.strerror or error}") from None
    if not shown:
        raise InputError(f"{name} holds no <tlsState>; give a file of signal states, as SUMO's SaveTLSStates writes it")
    return shown


def _add(name: str, element: etree._Element, shown: Shown) -> None:
    signal, state, seconds = element.get("id"), element.get("state"), parse_time(element.get("time"))
    if signal is None or state is None or seconds is None or not abs(seconds) <= 1e10:
        raise InputError(f"{name}, line {element.sourceline}: <tlsState> needs the attributes time, id and state")
    now = round(1000 * seconds)
    if signal in shown and now < shown[signal][0][-1]:
        raise InputError(f"{name}, line {element.sourceline}: the time {seconds:g} s comes before the last one")
    add_state(shown, signal, now, state)


def add_state(shown: Shown, signal: str, time: int, state: str) -> None:
    """Add what a traffic light shows from `time` (ms) on; of two in the same step the later one counts."""
    times, states = shown.setdefault(signal, ([], []))
    if times and time == times[-1]:
        times.pop()
        states.pop()
    if not states or states[-1] != state:
        times.append(time)
        states.append(state)
