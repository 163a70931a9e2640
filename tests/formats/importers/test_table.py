import os
from pathlib import Path

import numpy as np
import pytest

from slrl_sumo.errors import InputError
from slrl_sumo.formats.importers.table import codes, read_table


def test_reads_numbers_and_words_whatever_the_order_of_columns(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text('\ufeffkind, b ,a\n"big, one",2,1.5\r\n small ,4,-3e2', encoding="utf-8")  # no newline at the end
    table = read_table(path, ["a", "b"], ["kind"])
    assert table.numbers("a").tolist() == [1.5, -300.0]
    assert table.integers("b").tolist() == [2, 4]
    assert table.words("kind").tolist() == ["big, one", "small"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "t.csv is empty"),
        ("a,b\n", "t.csv is empty: it holds no rows"),
        ("a,c\n1,2\n", "lacks the column 'b'; it has a, c"),
        ("a,b\n1,2\n3,x\n", "line 3: column 'b' needs a number, it is 'x'"),
        ("a,b\n1,2\n3,\n4,5\n", "line 3: column 'b' needs a number, it is ''"),
        ("a,b\n1,2\n3,nan\n", "line 3: column 'b' needs a number, it is nan"),
        ("a,b\n1,2\n\n3,inf\n", "line 4: column 'b' needs a number, it is inf"),
        ("a,b\n1,2\n3", "line 3: the file is cut off, the last line has 1 of 2 columns"),
        ("a,b\n1,2\n3\n4,5\n", "line 3: 1 columns instead of 2"),
        ("a,b\n1,2,3\n4,5,6\n", "line 2: 3 columns instead of 2"),
    ],
)
def test_says_what_is_wrong_and_where(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_table(path, ["a", "b"])
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_cut_line_is_found_in_columns_that_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("a,b,c\n1,2,3\n1,2", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 3: the file is cut off, the last line has 2 of 3 columns"):
        read_table(path, ["a"])


def test_whole_numbers_must_be_whole(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("a\n1\n2.5\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"line 3: column 'a' needs whole numbers, it is 2.5"):
        read_table(path, ["a"]).integers("a")


def test_what_is_no_text_or_not_there(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes(b"a,b\n1,2\n\xff\xfe,3\n")
    with pytest.raises(InputError, match=r"t\.csv is not a table in UTF-8 text"):
        read_table(path, ["a", "b"])
    with pytest.raises(InputError, match=r"cannot read .*other\.csv: No such file"):
        read_table(tmp_path / "other.csv", ["a"])


def test_codes_number_values_in_their_order() -> None:
    values, first, which = codes(np.array([5, 5, 2, 2, 5, 9]))
    assert values.tolist() == [2, 5, 9]
    assert first.tolist() == [2, 0, 5]
    assert which.tolist() == [1, 1, 0, 0, 1, 2]


def test_pipes_and_endless_lines_are_no_tables(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match="it is a pipe"):
        read_table(tmp_path / "pipe.csv", ["a"])
    (tmp_path / "long.csv").write_text("a\n1\n")
    os.truncate(tmp_path / "long.csv", 3 << 20)
    with pytest.raises(InputError, match="a line of more than 1 MiB"):
        read_table(tmp_path / "long.csv", ["a"])
