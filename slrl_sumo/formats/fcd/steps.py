"""The time steps of FCD files in XML and CSV, and of tables like the CSV, one after the other."""

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import CSV_COLUMNS, OWN_COLUMNS
from slrl_sumo.input_files import BLOCK, open_xml, text_lines

if TYPE_CHECKING:
    import _csv

_FIELDS = ("id", "type", "x", "y", "angle", "lane", "edge", "speed", *OWN_COLUMNS)


class FcdRow(NamedTuple):
    """One road user in one time step; numbers as text or, from binary formats, as numbers."""

    id: str
    vtype: str
    person: bool
    x: str | float
    y: str | float
    angle: str | float
    line: int
    speed: str | float = ""
    """'' where the file has none; the same for `mode`."""
    mode: str | float = ""
    learned: bool | None = None
    """None if the file has no such column."""


class FcdStep(NamedTuple):
    time: str
    line: int
    rows: list[FcdRow]


def xml_steps(name: str, file: IO[bytes]) -> Iterator[FcdStep]:
    """The time steps of the XML text of `file`, called `name` in messages; memory holds one step at a time.

    Containers and persons marked as riding in a vehicle are left out. Raises InputError at the first error.
    """
    complete = 0
    try:
        _check_root(name, next(iter(etree.iterparse(file, events=("start",))))[1])
        file.seek(0)
        for _, element in etree.iterparse(file, tag="timestep", resolve_entities=False, huge_tree=True):
            rows = []
            for user in element.iterchildren("vehicle", "person"):
                get, line = user.attrib.get, user.sourceline or 0
                identity, x, y, angle = get("id"), get("x"), get("y"), get("angle")
                if identity is None or x is None or y is None or angle is None:
                    raise InputError(f"{name}, line {line}: <{user.tag}> needs the attributes id, x, y and angle")
                person = user.tag == "person"
                if not (person and get("vehicle")):
                    rows.append(FcdRow(identity, get("type", ""), person, x, y, angle, line, get("speed", "")))
            yield FcdStep(element.get("time", ""), element.sourceline or 0, rows)
            complete += 1
            element.clear()
            parent = element.getparent()
            while parent is not None and element.getprevious() is not None:
                del parent[0]
    except etree.XMLSyntaxError as e:
        what = "is cut off" if _is_cut_off(name) else f"is not well-formed XML ({(e.msg or '').split(', line')[0]})"
        raise InputError(f"{name}, line {e.lineno}: {what}; {complete} complete time steps could be read") from e
    except OSError as e:
        raise InputError(f"{name}: {e.strerror or e}; {complete} complete time steps could be read") from e


def _check_root(name: str, root: etree._Element) -> None:
    if root.tag != "fcd-export":
        raise InputError(f"{name}, line {root.sourceline}: <{root.tag}> where an FCD file has <fcd-export>")
    comment = root.getprevious()  # SUMO writes its configuration here
    if comment is not None and re.search(r'fcd-output\.geo value="(true|1)"', comment.text or ""):
        raise InputError(f"{name} has geographic coordinates; write it without --fcd-output.geo")


def _is_cut_off(name: str) -> bool:
    """Whether the text ends before its root element does (checked only after reading has failed)."""
    end = b""
    try:
        with open_xml(name) as file:
            while chunk := file.read(BLOCK):
                end = (end + chunk)[-64:]
    except OSError:
        return True
    return not end.rstrip().endswith(b"</fcd-export>")


class _RaggedError(ValueError):
    """A line of CSV with too many or too few fields."""


def csv_steps(name: str, file: IO[bytes]) -> Iterator[FcdStep]:
    """The time steps of the CSV text of `file`, called `name` in messages; memory holds one step at a time.

    `person` of a row is certain only in files of xml2csv.py; in others, rows with an edge and no lane are persons.
    Raises InputError at the first error.
    """
    lines = csv.reader(text_lines(file), delimiter=";", strict=True)
    complete = 0
    try:
        columns = next(lines, [])
        if len(columns) == 1 and (other := next((c for c in ",\t" if c in columns[0]), None)):
            raise InputError(
                f"{name}, line 1: its columns are separated by {other!r}; write it with semicolons, as SUMO"
            )
        if missing := missing_columns(columns):
            wanted = ";".join(CSV_COLUMNS[:5])
            raise InputError(
                f"{name}, line 1: an FCD file in CSV has at least the columns {wanted}, "
                f"this one lacks {', '.join(missing)}"
            )
        for step in steps_of_rows(columns, _whole_lines(lines, len(columns))):
            yield step
            complete += 1
    except _RaggedError as e:
        raise InputError(
            f"{name}, line {lines.line_num}: {e}; is the file cut off? {complete} complete time steps could be read"
        ) from None
    except (csv.Error, UnicodeDecodeError, OSError) as e:
        reason = e.strerror if isinstance(e, OSError) else e
        raise InputError(
            f"{name}, line {lines.line_num + 1}: not CSV text ({reason}); {complete} complete time steps could be read"
        ) from e


def _whole_lines(lines: "_csv.Reader", width: int) -> Iterator[tuple[int, list[str]]]:
    """Line number and fields of each line that is not empty."""
    for fields in lines:
        if not fields:
            continue
        if len(fields) != width:
            raise _RaggedError(f"has {len(fields)} fields, not {width}")
        yield lines.line_num, fields


def _kinds(columns: Sequence[str]) -> list[str]:
    """Kinds of columns: SUMO names all after the element of the first row, xml2csv.py has columns for each element."""
    return [kind for kind in ("vehicle", "person") if f"{kind}_id" in columns]


def missing_columns(columns: Sequence[str]) -> list[str]:
    """The columns that a table with these ones lacks to be FCD."""
    kinds = _kinds(columns) or ["vehicle"]
    needed = ["timestep_time", *(f"{kind}_{c}" for kind in kinds for c in ("id", "x", "y", "angle"))]
    return [column for column in needed if column not in columns]


def steps_of_rows(columns: Sequence[str], rows: Iterable[tuple[int, list[Any]]]) -> Iterator[FcdStep]:
    """The time steps of a table without `missing_columns`: `rows` are line numbers and fields, '' for empty ones."""
    kinds, empty = _kinds(columns), len(columns)  # an absent column is read as an empty field behind the others
    place = {column: i for i, column in enumerate(columns)}
    at = {kind: [place.get(c if c in OWN_COLUMNS else f"{kind}_{c}", empty) for c in _FIELDS] for kind in kinds}
    when, vehicle = place["timestep_time"], place.get("vehicle_id", empty)
    step, now = FcdStep("", 0, []), None
    for line, fields in rows:
        fields.append("")
        if fields[when] != now:
            if now is not None:
                yield step
            now = fields[when]
            step = FcdStep(str(now), line, [])
        kind = kinds[0] if len(kinds) == 1 or fields[vehicle] else "person"
        identity, vtype, x, y, angle, lane, edge, speed, mode, learned = [fields[i] for i in at[kind]]
        if identity:  # else a time step without road users
            person = kind == "person" if len(kinds) == 2 else bool(edge) and not lane
            known = None if learned == "" else learned in (True, "1", "true", "True")
            step.rows.append(FcdRow(identity, vtype, person, x, y, angle, line, speed, mode, known))
    if now is not None:
        yield step
