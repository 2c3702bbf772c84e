"""Large tables are read by Arrow: to the same numbers as cell by cell, and with the same words where something is wrong."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from whiskjax.files import fast_csv
from whiskjax.files.sheet import open_sheet
from whiskjax.files.tables import Column
from whiskjax.rules import FlightError

ROWS = 400
COLUMNS = [Column("time_s"), Column("name", text=True), Column("height_m", blank=True, low=-2e4, high=1e8)]


def table(folder, rows, header="time_s,name,height_m", end="\n", lead=""):
    text = lead + end.join([header, *rows]) + end
    (folder / "t.csv").write_bytes(text.encode())
    return open_sheet(folder, "t.csv", "a test")


def plain(n=ROWS):
    return [f"{0.005 * i!r},n{i},{1e3 + i / 7!r}" for i in range(n)]


@pytest.fixture(params=["by Arrow", "cell by cell"])
def reader(request, monkeypatch):
    """Both ways: the size from which Arrow reads is moved below, or above, the tables of these tests."""
    monkeypatch.setattr(fast_csv, "WORTH_BYTES", 0 if request.param == "by Arrow" else 1 << 40)
    return request.param


def textbook(path):
    """Python's csv and float."""
    rows = list(csv.reader(io.StringIO(path.read_text("utf-8-sig"), newline="")))[1:]
    return [row for row in rows if row]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("lead", ["", "\ufeff"])
def test_numbers_are_those_of_the_textbook_to_the_last_bit(reader, end, lead, tmp_path):
    rows = plain()
    rows[7], rows[9] = f'{rows[7].split(",")[0]},"a, ""b""\nc",', ""  # quoted, a line break inside, a blank cell; a blank line
    read = table(tmp_path, rows, end=end, lead=lead).parse(COLUMNS)
    expected = textbook(tmp_path / "t.csv")
    assert len(read) == len(expected) == ROWS - 1
    np.testing.assert_array_equal(read["time_s"], [float(row[0]) for row in expected])
    np.testing.assert_array_equal(read["height_m"], [float(row[2] or "nan") for row in expected])
    assert read["name"] == [row[1].strip() for row in expected]
    assert read.lines[6] == 8 and read.lines[-1] == ROWS + 2  # counted as an editor does: one line more inside the quoted cell


@settings(max_examples=25)
@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=50))
def test_any_float_is_read_back(tmp_path_factory, numbers):
    folder = tmp_path_factory.mktemp("any")
    sheet = table(folder, [repr(v) for v in numbers], header="time_s")
    columns = fast_csv.read_columns(folder / "t.csv", sheet.header, ["time_s"], [])
    np.testing.assert_array_equal(columns["time_s"], numbers)


SPOILED = {
    "a stray quotation mark": (lambda row: row.replace("n", 'n"'), "t.csv, line 202: a quotation mark opens here and is never"),
    "two of them": (lambda row: row.replace("n", 'n""'), "t.csv, line 202: cell 2 holds a stray quotation mark"),
    "a cell of 200,000 characters": (lambda row: "9" * 200_000 + row, r"t.csv, line 202: cell 1 holds 200\d* characters"),
    "one that is never closed": (lambda row: '"' + row, r"t.csv, line 202: a quotation mark opens here and is never closed"),
    "an underscore": (lambda row: "0_3" + row[3:], r"t.csv, line 202, column time_s: '0_3.*' is not a number"),
    "full-width digits": (
        lambda row: "\uff11\uff12," + row.split(",", 1)[1],
        r"line 202, column time_s: '\uff11\uff12' is not a number",
    ),
    "nan": (lambda row: "nan," + row.split(",", 1)[1], r"line 202, column time_s: 'nan' is not a finite number"),
    "infinity": (lambda row: "inf," + row.split(",", 1)[1], r"line 202, column time_s: 'inf' is not a finite number"),
    "hexadecimal": (lambda row: "0x1p3," + row.split(",", 1)[1], r"line 202, column time_s: '0x1p3' is not a number"),
    "too large": (lambda row: "1e999," + row.split(",", 1)[1], r"line 202, column time_s: '1e999' is not a finite number"),
    "blank": (lambda row: "," + row.split(",", 1)[1], r"line 202, column time_s: is blank"),
    "outside": (lambda row: row.rsplit(",", 1)[0] + ",1e9", r"line 202, column height_m: '1e9' lies outside -20000 to 1e\+08"),
    "a cell too many": (lambda row: row + ",1", r"t.csv, line 202: 4 cells, but the header names 3 columns"),
    "a cell too few": (lambda row: row.rsplit(",", 1)[0], r"t.csv, line 202: 2 cells, but the header names 3 columns"),
    "a NUL": (lambda row: row + "\0", r"t.csv, line 202: holds a NUL character"),
}


@pytest.mark.parametrize("what", SPOILED)
def test_what_is_wrong_is_named_alike_however_large_the_table(reader, what, tmp_path):
    spoil, said = SPOILED[what]
    rows = plain()
    rows[200] = spoil(rows[200])
    with pytest.raises(FlightError, match=said):
        table(tmp_path, rows).parse(COLUMNS)


def test_bytes_that_are_no_utf8_are_placed(reader, tmp_path):
    sheet = table(tmp_path, plain())
    data = bytearray((tmp_path / "t.csv").read_bytes())
    data[data.index(b"n200")] = 0xFF
    (tmp_path / "t.csv").write_bytes(bytes(data))
    with pytest.raises(FlightError, match=r"t\.csv, line 202: not a UTF-8 text file"):
        sheet.parse(COLUMNS)
