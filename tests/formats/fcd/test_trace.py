"""What a run writes beside its trace: the learned road users, and what signals show."""

from pathlib import Path

import numpy as np
import pytest
import sumo
from builders import make_world
from lxml import etree

from slrl_sumo.errors import InputError
from slrl_sumo.formats.fcd.columns import Places
from slrl_sumo.formats.fcd.table import FcdTable, read_table
from slrl_sumo.formats.fcd.trace import TraceWriter, add_learned, learned_file, signals_file
from slrl_sumo.formats.signal_states import SignalState, read_signals

HOME = Path(sumo.SUMO_HOME)
GREEN, RED = SignalState("a<b", "0", 0, "GGrr"), SignalState("a<b", "0", 2, "rrGG")


def table_of(path: Path) -> FcdTable:
    table, flaw = read_table(path)
    assert flaw is None
    return table


def write(path: Path) -> None:
    """A vehicle and a person that are both called 0; both are learned in the first step, the person in the second."""
    places = Places(("passenger", "pedestrian"), ("e_0", "e"), np.zeros(2), np.array([False, True]))
    with TraceWriter(path) as writer:
        world = make_world(np.array([1.0, 2.0]), 0.0, 0.0, 1.0, type=[0, 2], learned=[True, True], ids=["0", "0"])
        writer.write(0.0, world, places)
        writer.write_signals(0.0, [GREEN])
        world = make_world(np.array([1.0, 2.0]), 0.0, 0.0, 1.0, type=[0, 2], learned=[False, True], ids=["0", "0"])
        writer.write(0.4, world, places, np.array([7]))
        writer.write_signals(0.4, [])
        writer.write_signals(0.8, [RED])


@pytest.mark.parametrize("suffix", [".xml", ".xml.gz"])
def test_xml_has_a_table_of_learned_road_users_beside_it(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write(path)
    table = table_of(path)
    beside = learned_file(path)
    assert beside == tmp_path / "a.learned.csv"
    assert beside.read_text().splitlines() == [
        "timestep_time;vehicle_id;person_id;mode",
        *("0.00;0;;", "0.00;;0;", "0.40;;0;7"),
    ]
    assert not table.marks_learned
    add_learned(table, beside)
    assert table.marks_learned
    assert (table.learned.tolist(), table.mode.tolist()) == ([1, 1, 0, 1], [0, 0, 0, 8])


def test_other_formats_and_runs_without_signals_have_nothing_beside_them(tmp_path: Path) -> None:
    write(tmp_path / "a.csv")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.csv", "a.signals.xml"]
    with TraceWriter(tmp_path / "a.csv"):
        pass
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.40;;0;7", "0.80;;0;7", r"1 of its 3 rows are not in the trace; is it another run's\?"),
        ("0.40;;0;7", "0.40;1;;7", r"1 of its 3 rows are not in the trace"),
        ("0.40;;0;7", "0.40;0", "line 4: not enough values"),
        ("0.40;;0;7", "0.40;;0;x", "line 4: invalid literal"),
        ("0.40;;0;7", "0.40;;0;300", "line 4: there is no mode 300"),
        ("timestep_time", "time", "line 1: the columns are not timestep_time;"),
    ],
)
def test_tables_that_do_not_fit_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    write(tmp_path / "a.xml")
    table = table_of(tmp_path / "a.xml")
    beside = tmp_path / "a.learned.csv"
    beside.write_text(beside.read_text().replace(old, new))
    with pytest.raises(InputError, match=rf"a\.learned\.csv.*{message}"):
        add_learned(table, beside)
    assert not table.marks_learned


def test_signals_are_in_sumos_format(tmp_path: Path) -> None:
    write(tmp_path / "a.csv")
    file = signals_file(tmp_path / "a.csv")
    schema = etree.XMLSchema(file=str(HOME / "data" / "xsd" / "tlsstates_file.xsd"))
    schema.assertValid(etree.parse(str(file)))
    assert read_signals(file) == {"a<b": ([0, 800], ["GGrr", "rrGG"])}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<tlsStates></tlsStates>", "holds no <tlsState>"),
        ("<tlsStates><tlsState", "line 1: is not well-formed XML"),
        ("<tlsStates><tlsState time='0' id='a'/></tlsStates>", "line 1: <tlsState> needs the attributes"),
        (
            "<tlsStates><tlsState time='1' id='a' state='G'/>\n<tlsState time='0' id='a' state='r'/></tlsStates>",
            "line 2: the time 0 s comes before the last one",
        ),
    ],
)
def test_what_holds_no_signals_gets_one_line(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "s.xml").write_text(text)
    with pytest.raises(InputError, match=rf"s\.xml.*{message}"):
        read_signals(tmp_path / "s.xml")


def test_the_program_that_takes_over_counts(tmp_path: Path) -> None:
    (tmp_path / "s.xml").write_text(
        "<tlsStates>"
        + "".join(f"<tlsState time='{t}' id='a' state='{s}'/>" for t, s in ((0, "G"), (0, "y"), (1, "y"), (2, "r")))
        + "</tlsStates>"
    )
    assert read_signals(tmp_path / "s.xml") == {"a": ([0, 2000], ["y", "r"])}
