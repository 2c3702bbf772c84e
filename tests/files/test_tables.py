"""Tables against Python's csv and float: every number bit by bit, every spoiled cell by its line, read slowly and by Arrow."""

import csv
import io
import itertools
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import whiskjax as wj
from whiskjax.files import fast_csv
from whiskjax.files.cells import CsvFile, numbers_of, texts_of
from whiskjax.files.sheet import open_sheet
from whiskjax.files.tables import Column

COLUMNS = (Column("n"), Column("m", blank=True), Column("t", text=True))
HEADER = ("n", "m", "t")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder for all tables of this file; each is called t.csv."""
    return tmp_path_factory.mktemp("tables")


def read(folder, data, columns=COLUMNS):
    """A table from bytes or text."""
    (folder / "t.csv").write_bytes(data if isinstance(data, bytes) else data.encode())
    return open_sheet(folder, "t.csv", "the test").parse(columns)


@pytest.fixture(params=[0, 10**9], ids=["by Arrow", "cell by cell"])
def worth(request, monkeypatch):
    """Every table, small as it is, is read by Arrow first, or by nobody but us."""
    monkeypatch.setattr(fast_csv, "WORTH_BYTES", request.param)


decimals = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.tuples(st.floats(-1e9, 1e9), st.integers(0, 20)).map(lambda v: f"{v[0]:.{v[1]}f}"),
    st.tuples(st.integers(-(10**30), 10**30), st.integers(-40, 10)).map(lambda v: f"{v[0]}e{v[1]}"),
    st.sampled_from(["-0", "1E5", "1e+05", ".5", "5.", "  7\t", "0.1000000000000000055511151231257827"]),
)
words = st.text(st.characters(blacklist_categories=("Cs", "Cc")), min_size=1, max_size=6).filter(str.strip)
rows = st.lists(st.tuples(decimals, st.one_of(decimals, st.just("")), st.one_of(words, st.just("two\nlines"))), max_size=6)


@given(rows, st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]), st.sampled_from(["\n", "\r\n"]), st.booleans(), st.booleans())
def test_numbers_and_texts_are_those_of_csv_and_float(folder, table, quoting, end, mark, blank_lines):
    out = io.StringIO()
    writer = csv.writer(out, quoting=quoting, lineterminator=end * 2 if blank_lines else end)
    writer.writerows([HEADER, *table])
    data = (b"\xef\xbb\xbf" if mark else b"") + out.getvalue().encode()
    found = read(folder, data)
    reader = csv.reader(io.StringIO(out.getvalue(), newline=""))
    expected = [(row, reader.line_num) for row in reader if row][1:]
    for name, k in (("n", 0), ("m", 1)):
        numbers = np.array([float(row[k] or "nan") for row, _ in expected])
        np.testing.assert_array_equal(found[name].view(np.int64), numbers.view(np.int64))
    assert found["t"] == [row[2].strip() for row, _ in expected]
    assert list(found.lines) == [line for _, line in expected]
    fast = fast_csv.read_columns(folder / "t.csv", HEADER, ["n", "m"], ["t"])
    if fast is not None:
        np.testing.assert_array_equal(fast["n"].view(np.int64), found["n"].view(np.int64))
        np.testing.assert_array_equal(np.nan_to_num(fast["m"], nan=7), np.nan_to_num(found["m"], nan=7))
        assert fast["t"] == found["t"]


def test_arrow_reads_what_exporters_write(folder):
    """No plain table is left to the slow reader: with quotation marks, line breaks in cells, CRLF, a byte order mark, blanks."""
    for data in ("n,m,t\n1,2,a\n", '"n","m","t"\r\n"1","","a"\r\n', 'n,m,t\n1,2,"a\nb"\n\n', "\ufeffn,m,t\n1,2,ä", "n,m,t\n"):
        (folder / "t.csv").write_bytes(data.encode())
        assert fast_csv.read_columns(folder / "t.csv", HEADER, ["n", "m"], ["t"]) is not None


GOOD = ["1", "2.5", "a"]
SPOILED = {
    "underscore": ("0_3", "n"),
    "full-width digits": ("１２", "n"),
    "other digits": ("٣", "n"),
    "hexadecimal": ("0x10", "n"),
    "two numbers": ("1 2", "n"),
    "two signs": ("--1", "n"),
    "a letter": ("1.5O", "m"),
    "an exponent alone": ("1e", "n"),
    "not a number": ("NaN", "m"),
    "infinite": ("-Infinity", "n"),
    "beyond float64": ("1e400", "n"),
    "a word": ("null", "m"),
    "blank": ("", "n"),
    "spaces": ("  ", "n"),
    "no name": ("", "t"),
}


@pytest.mark.parametrize("case", SPOILED)
@pytest.mark.parametrize("above", [[], ["\n\n"], ['1,2,"two\nlines"\n'], ['1,2,"a ""b"""\r\n', "\r\n"]], ids=len)
def test_a_spoiled_cell_is_named_by_the_line_that_csv_counts(folder, worth, case, above):
    cell, column = SPOILED[case]
    bad = [cell if name == column else good for name, good in zip(HEADER, GOOD, strict=True)]
    text = "n,m,t\n1,2,a\n" + "".join(above) + ",".join(bad) + "\n3,4,b\n"
    reader = csv.reader(io.StringIO(text, newline=""))
    line = next(reader.line_num for row in reader if row == bad)
    with pytest.raises(wj.FlightError, match=rf"^t\.csv, line {line}, column {column}: ") as caught:
        read(folder, text)
    assert repr(cell) in str(caught.value) or not cell.strip()


LONG = "x" * 200_000
BROKEN = {
    "stray quotation mark": ('n,m,t\n1,2,a\n3",4,b\n5,6,c\n', 3, "quotation mark"),
    "one that opens a cell": ('n,m,t\n1,2,a\n3,4,"b\n5,6,c\n', 3, "never closed"),
    "two that are far apart": ('n,m,t\n1,2,"a\n3,4,b"x\n', 2, "stray quotation mark"),
    "text behind quotation marks": ('n,m,t\n1,2,"a"b\n', 2, "stray quotation mark"),
    "a long name": (f"n,m,t\n1,2,a\n1,2,{LONG}\n", 3, "200000 characters"),
    "a long number": (f"n,m,t\n1,2,a\n0.{'0' * 200_000}1,2,b\n", 3, "200003 characters"),
    "a long number between quotation marks": (f'n,m,t\n"0.{"0" * 200_000}1",2,b\n', 2, "200003 characters"),
    "NUL": ("n,m,t\n1,2,a\n3,4,b\0\n", 3, "NUL"),
    "not UTF-8": (b"n,m,t\n1,2,a\n3,4,\xe4\n", 3, "UTF-8"),
    "cut off": ("n,m,t\n1,2,a\n3,4", 3, "2 cells, but the header names 3"),
    "decimal comma": ("n,m,t\n1,2,a\n0,5,1,b\n", 3, "4 cells"),
    "spaces for a line": ("n,m,t\n1,2,a\n \n", 3, "1 cells"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_table_is_refused_with_the_line(folder, worth, case):
    data, line, what = BROKEN[case]
    with pytest.raises(wj.FlightError, match=rf"^t\.csv, line {line}: .*{what}"):
        read(folder, data)


def test_a_quotation_mark_in_a_large_table(folder):
    """Larger than what is read cell by cell, and than the csv module lets a cell be."""
    lines = ["n,m,t", *itertools.repeat("12.25,-3.5,name", 80_000)]
    lines[60_000] = '12.25,"-3.5,name'
    with pytest.raises(wj.FlightError, match=r"^t\.csv, line 60001: a quotation mark opens here and is never closed"):
        read(folder, "\n".join(lines))
    lines[60_000] = "12.25,-3.5,name"
    lines[70_000] = "12.25,0_3,name"
    with pytest.raises(wj.FlightError, match=r"^t\.csv, line 70001, column m: '0_3' is not a number"):
        read(folder, "\n".join(lines))
    lines[70_000] = "12.25,,"
    with pytest.raises(wj.FlightError, match=r"^t\.csv, line 70001, column t: is blank"):
        read(folder, "\n".join(lines))


HEADERS = {
    "nothing": ("", "header"),
    "a blank line first": ("\nn,m,t\n1,2,a\n", "header"),
    "a column twice": ("n,m,n\n", "'n' is there twice"),
    "semicolons": ("n;m;t\n1;2;a\n", "separated by commas"),
    "missing": ("n,m\n1,2\n", "the column t is missing"),
    "unknown": ("n,m,t,tt\n1,2,a,b\n", r"no column 'tt' is known here \(did you mean 't'\?\)"),
}


@pytest.mark.parametrize("case", HEADERS)
def test_headers(folder, worth, case):
    text, what = HEADERS[case]
    with pytest.raises(wj.FlightError, match=rf"^t\.csv, line 1: .*{what}"):
        read(folder, text)


def test_a_long_cell_is_not_repeated_in_full(folder):
    with pytest.raises(wj.FlightError) as caught:
        read(folder, f"n,m,t\n{'1' * 50_000}x,2,a\n")
    assert len(str(caught.value)) < 300 and "50003 characters in all" in str(caught.value)


pieces = st.sampled_from(
    [
        *"1,,,\n\n\"'x_ \r\t\0",
        "2.5",
        "\r\n",
        '"a"',
        '""',
        '"a\nb"',
        "nan",
        "+3",
        "1e400",
        "\ufeff",
        "１",
        "\x1c",
        "\u2028",
        "\xa0",
    ]
)


@given(st.lists(pieces, max_size=24), st.integers(0, 3))
def test_arrow_never_reads_what_we_would_not(folder, spoiled, cut):
    """Any text: Arrow's columns are ours to the bit, or it leaves the table to us."""
    data = ("n,m,t\n1,2,a\n" + "".join(spoiled)).encode()
    (folder / "t.csv").write_bytes(data[: len(data) - cut])
    fast = fast_csv.read_columns(folder / "t.csv", HEADER, ["n", "m"], ["t"])
    if fast is None:
        return
    cells = texts_of(CsvFile(folder / "t.csv", "t.csv"), HEADER, list(HEADER))
    for name in ("n", "m"):
        blank = np.array([not cell for cell in cells[name]])
        values, is_number = numbers_of(cells[name])
        assert (is_number | blank).all() and (np.isnan(fast[name]) == blank).all()
        np.testing.assert_array_equal(fast[name][~blank].view(np.int64), values[~blank].view(np.int64))
    assert fast["t"] == cells["t"]
    assert not any(re.search("nan|inf", cell, re.IGNORECASE) for cell in cells["n"])
