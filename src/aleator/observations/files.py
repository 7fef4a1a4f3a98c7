"""A delimited file as a table.

The place of a row is told as a spreadsheet counts it: the header is row 1, blank rows count. A unit
in brackets at the end of a head, `travel [mm]`, is no part of the column's name.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from aleator.errors import ExperimentsError, nearest
from aleator.observations.tables import Table, check_header, short

DELIMITERS = {",": "a comma", ";": "a semicolon", "\t": "a tab", "|": "a vertical bar"}
_KEY = {"\t": r"\t"}
_UNIT = re.compile(r"^(?P<name>.*\S)\s*\[(?P<unit>[^\[\]]+)\]$")


def read(path: str | Path, delimiter: str = ",", decimal: str = ".") -> Table:
    """Read a delimited text file (UTF-8 or UTF-16, with or without a byte order mark).

    `delimiter` is one character, `decimal` is "." or ",". Rows without any text are skipped but
    counted, and so are columns at the end that have neither a name nor a text.

    Raises ExperimentsError for a file that is absent, empty, in another encoding or a workbook, for
    a delimiter that is not the file's, rows of unequal length and a column name that appears twice.
    """
    if len(delimiter) != 1 or decimal not in (".", ",") or delimiter == decimal:
        raise ExperimentsError(
            f"{path}: delimiter {delimiter!r} with decimal {decimal!r} cannot be read",
            'the delimiter is one character, the decimal sign "." or ",", and they differ',
        )
    source = str(path)
    rows = _rows(_decoded(Path(path)), delimiter, source)
    if not rows:
        raise ExperimentsError(
            f"{source}: the file is empty", "write a header and a row per experiment"
        )
    header = [name.strip() for name in rows[0][1]]
    rows = rows[1:]
    while header and not header[-1] and not any(_beyond(row, len(header)) for _, row in rows):
        header.pop()
        rows = [(number, row[: len(header)]) for number, row in rows]
    _check_delimiter(header, delimiter, source)
    header, units = _parted(header)
    check_header(header, source)
    _check_lengths(header, rows, delimiter, source)
    if not rows:
        raise ExperimentsError(
            f"{source}: there is a header but no rows", "write one row for each experiment"
        )
    columns: dict[str, list[object]] = {
        name: [row[k].strip() for _, row in rows] for k, name in enumerate(header)
    }
    places = tuple(f"row {number}" for number, _ in rows)
    return Table(source, columns, places, decimal, units=units)


def stated_units(path: str | Path, delimiter: str = ",") -> dict[str, str]:
    """The units in the heads of a file's columns, by the names without them."""
    rows = csv.reader(io.StringIO(_decoded(Path(path)), newline=""), delimiter=delimiter)
    header = next((row for row in rows if any(cell.strip() for cell in row)), [])
    return _parted([name.strip() for name in header])[1]


def _parted(header: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Heads without their units, and these; heads that differ by their units only keep them.

    >>> _parted(["travel [mm]", "force [N]", "force [kN]", "id"])
    (['travel', 'force [N]', 'force [kN]', 'id'], {'travel': 'mm'})
    """
    found = [_UNIT.match(head) for head in header]
    bare = [match["name"] if match else head for match, head in zip(found, header, strict=True)]
    units = {
        name: match["unit"].strip()
        for name, match in zip(bare, found, strict=True)
        if match and bare.count(name) == 1
    }
    return [n if n in units else h for n, h in zip(bare, header, strict=True)], units


def _beyond(row: Sequence[str], width: int) -> str:
    """What a row holds from its last column on."""
    return "".join(row[width - 1 :]).strip()


def _decoded(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        near = nearest(path.name, _names_beside(path))
        raise ExperimentsError(
            f"{path}: there is no such file{near}",
            "check the name; it is relative to the study file",
        ) from None
    except OSError as error:
        raise ExperimentsError(
            f"{path}: the file cannot be read: {error.strerror}", "name a text file (CSV)"
        ) from None
    if raw.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise ExperimentsError(
            f"{path}: this is a workbook, not a text file",
            "save it as CSV UTF-8 and name that file",
        )
    encoding = "utf-16" if raw.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError as error:
        row = raw[: error.start].count(b"\n") + 1
        raise ExperimentsError(
            f"{path}: row {row} is not UTF-8 text (byte 0x{raw[error.start]:02x})",
            "save the file with the encoding UTF-8 (in a spreadsheet: 'CSV UTF-8')",
        ) from None
    if "\0" in text:
        row = text[: text.index("\0")].count("\n") + 1
        raise ExperimentsError(
            f"{path}: row {row} has a null character: this is not a text file",
            "save it as CSV UTF-8",
        )
    return text


def _names_beside(path: Path) -> Iterable[str]:
    folder = path.parent
    return sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else ()


def _rows(text: str, delimiter: str, source: str) -> list[tuple[int, list[str]]]:
    """The rows that hold any text, each with its number in a spreadsheet."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    rows = []
    try:
        for number, row in enumerate(reader, start=1):
            if any(cell.strip() for cell in row):
                rows.append((number, row))
    except csv.Error as error:
        raise ExperimentsError(
            f"{source}: line {reader.line_num}: {error}", "check the quotation marks from there on"
        ) from None
    return rows


def _check_delimiter(header: Sequence[str], delimiter: str, source: str) -> None:
    if len(header) != 1:
        return
    for other, words in DELIMITERS.items():
        if other != delimiter and other in header[0]:
            raise ExperimentsError(
                f"{source}: row 1: the columns are separated by {words}, not by "
                f"{DELIMITERS.get(delimiter, repr(delimiter))}: '{short(header[0])}'",
                f'say so with the key delimiter = "{_KEY.get(other, other)}"'
                + (' (and decimal = "," if numbers look like 0,95)' if other != "," else ""),
            )


def _check_lengths(
    header: Sequence[str], rows: Sequence[tuple[int, list[str]]], delimiter: str, source: str
) -> None:
    for number, row in rows:
        if len(row) != len(header):
            raise ExperimentsError(
                f"{source}: row {number} has {len(row)} cells, the header has {len(header)}",
                "fill in or delete cells so that the row fits the header"
                + ("; a decimal comma splits a number in two" if delimiter == "," else ""),
            )
