"""The time steps of FCD files in XML and CSV, one after the other, as text."""

import csv
import gzip
import re
import zlib
from collections.abc import Iterator
from typing import IO, NamedTuple

from lxml import etree

from slrl_sumo.errors import InputError

_CSV_FIELDS = ("id", "type", "x", "y", "angle", "lane", "edge", "speed", "mode", "learned")

LEARNED_NOTE = "slrl_sumo"
"""The processing instruction that says who is learned in a time step of an XML file, because SUMO's schema has no
attribute for it: <?slrl_sumo vehicles="3 . -" persons="7"?> has a word for each of the first vehicles and persons of
the step: the mode, "-" for a learned one without modes, "." for one that is not learned, as are all further ones."""


class FcdRow(NamedTuple):
    """One road user in one time step, as text."""

    id: str
    vtype: str
    person: bool
    x: str
    y: str
    angle: str
    line: int
    speed: str = ""
    mode: str = ""
    learned: bool = False


class FcdStep(NamedTuple):
    time: str
    line: int
    rows: list[FcdRow]


def xml_steps(name: str, file: IO[bytes] | gzip.GzipFile) -> Iterator[FcdStep]:
    """The time steps of the XML text of `file`, called `name` in messages; memory holds one step at a time.

    Containers and persons marked as riding in a vehicle are left out. Raises InputError at the first flaw.
    """
    complete = 0
    try:
        _check_root(name, next(iter(etree.iterparse(file, events=("start",))))[1])
        file.seek(0)
        for _, element in etree.iterparse(file, tag="timestep", resolve_entities=False, huge_tree=True):
            rows = []
            modes = _noted_modes(element)
            for user in element.iterchildren("vehicle", "person"):
                word = next(modes[user.tag], ".") if modes else "."
                get, line = user.attrib.get, user.sourceline or 0
                identity, x, y, angle = get("id"), get("x"), get("y"), get("angle")
                if identity is None or x is None or y is None or angle is None:
                    raise InputError(f"{name}, line {line}: <{user.tag}> needs the attributes id, x, y and angle")
                person = user.tag == "person"
                if not (person and get("vehicle")):
                    motion = (x, y, angle, line, get("speed", ""))
                    mode = word if word not in ".-" else ""
                    rows.append(FcdRow(identity, get("type", ""), person, *motion, mode, word != "."))
            yield FcdStep(element.get("time", ""), element.sourceline or 0, rows)
            complete += 1
            element.clear()
            parent = element.getparent()
            while parent is not None and element.getprevious() is not None:
                del parent[0]
    except etree.XMLSyntaxError as e:
        what = "is cut off" if _is_cut_off(name) else f"is not well-formed XML ({(e.msg or '').split(', line')[0]})"
        raise InputError(f"{name}, line {e.lineno}: {what}; {complete} complete time steps could be read") from e
    except (EOFError, gzip.BadGzipFile, zlib.error) as e:
        what = "is cut off" if isinstance(e, EOFError) else f"is not a sound gzip file ({e})"
        raise InputError(f"{name} {what}; {complete} complete time steps could be read") from e


def _noted_modes(step: etree._Element) -> dict[str, Iterator[str]]:
    """By tag, the words of a step's LEARNED_NOTE, in the order of its road users; nothing where it has none."""
    note = next(step.iterchildren(etree.ProcessingInstruction), None)
    if not isinstance(note, etree._ProcessingInstruction) or note.target != LEARNED_NOTE:
        return {}
    return {tag: iter((note.get(f"{tag}s") or "").split()) for tag in ("vehicle", "person")}


def _check_root(name: str, root: etree._Element) -> None:
    if root.tag != "fcd-export":
        raise InputError(f"{name}, line {root.sourceline}: <{root.tag}> where an FCD file has <fcd-export>")
    comment = root.getprevious()  # SUMO writes its configuration here
    if comment is not None and re.search(r'fcd-output\.geo value="(true|1)"', comment.text or ""):
        raise InputError(f"{name} has geographic coordinates; write it without --fcd-output.geo")


def _is_cut_off(name: str) -> bool:
    """Whether the text ends before its root element does (looked at only once reading has failed)."""
    end = b""
    try:
        with gzip.open(name) if name.lower().endswith(".gz") else open(name, "rb") as file:
            while chunk := file.read(1 << 20):
                end = (end + chunk)[-64:]
    except EOFError:
        return True
    return not end.rstrip().endswith(b"</fcd-export>")


def csv_steps(name: str, file: IO[bytes] | gzip.GzipFile) -> Iterator[FcdStep]:
    """The time steps of the CSV text of `file`, called `name` in messages; memory holds one step at a time.

    `person` of a row is certain only where the file is of xml2csv.py; else it is whether there is an edge and no lane.
    Raises InputError at the first flaw.
    """
    lines = csv.reader((line.decode() for line in file), delimiter=";", strict=True)
    complete = 0
    try:
        columns = {column: i for i, column in enumerate(next(lines, []))}
        # SUMO names the columns of all rows after the first row's element, its xml2csv.py those of each element apart.
        kinds = [kind for kind in ("vehicle", "person") if f"{kind}_id" in columns]
        needed = ["timestep_time", *(f"{kind}_{c}" for kind in kinds for c in ("x", "y", "angle"))]
        if not kinds or not all(c in columns for c in needed):
            wanted = "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_angle"
            raise InputError(f"{name}, line 1: an FCD file in CSV has at least the columns {wanted}, this one has not")
        empty = len(columns)  # an absent column is read as an empty field behind the others
        at = {kind: [columns.get(f"{kind}_{c}", empty) for c in _CSV_FIELDS] for kind in kinds}
        step = FcdStep("", 0, [])
        for fields in lines:
            if not fields:
                continue
            if len(fields) != empty:
                what = f"has {len(fields)} fields, not {empty}"
                raise InputError(
                    f"{name}, line {lines.line_num}: {what}; is the file cut off? {complete} complete time steps "
                    "could be read"
                )
            fields.append("")
            time = fields[columns["timestep_time"]]
            if time != step.time:
                if step.line:
                    yield step
                    complete += 1
                step = FcdStep(time, lines.line_num, [])
            kind = kinds[0] if len(kinds) == 1 or fields[columns["vehicle_id"]] else "person"
            identity, vtype, x, y, angle, lane, edge, speed, mode, learned = (fields[i] for i in at[kind])
            if identity:  # a time step without road users
                person = kind == "person" if len(kinds) == 2 else bool(edge) and not lane
                motion = (x, y, angle, lines.line_num, speed)
                step.rows.append(FcdRow(identity, vtype, person, *motion, mode, learned in ("1", "true", "True")))
        if step.line:
            yield step
    except (csv.Error, UnicodeDecodeError) as e:
        raise InputError(
            f"{name}, line {lines.line_num + 1}: not CSV text ({e}); {complete} complete time steps could be read"
        ) from e
