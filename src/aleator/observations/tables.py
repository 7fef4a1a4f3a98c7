"""Tables whose cells know their row and column, and the reading of files and data frames."""

from __future__ import annotations

import csv
import importlib.util
import io
import math
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aleator.core.types import Array, Flags
from aleator.errors import ExperimentsError, installing, nearest

if TYPE_CHECKING:
    import pandas as pd


_MISSING_TYPES = ("NoneType", "NAType", "NaTType")
"""Names of the types of a missing value: None, and those that pandas uses."""


def real_numbers(values: Any) -> Array:
    """Numbers of any type as float64, in the same shape; NaN where one is masked or missing.

    Objects that are numbers (Decimal, Fraction, columns of a data frame) are accepted. Raises
    TypeError for texts, truth values, complex numbers and dates: none of them is an outcome.

    >>> real_numbers(np.ma.masked_array([1, 2], mask=[True, False])).tolist()
    [nan, 2.0]
    >>> real_numbers(["1.5"])
    Traceback (most recent call last):
        ...
    TypeError: values of type <U3
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    array = np.asarray(values)
    if array.dtype.kind == "O":
        array = np.array([_real(value) for value in array.ravel()], np.float64).reshape(array.shape)
    elif array.dtype.kind not in "fiu":
        raise TypeError(f"values of type {array.dtype}")
    numbers = array.astype(np.float64)
    if isinstance(values, np.ma.MaskedArray):
        numbers[np.ma.getmaskarray(values)] = np.nan
    return numbers


def _real(value: Any) -> float:
    kind = type(value)
    if kind.__name__ in _MISSING_TYPES or value is np.ma.masked:
        return np.nan
    no_number = isinstance(value, (bool, np.bool_, complex, np.complexfloating))
    if no_number or not hasattr(kind, "__float__"):
        raise TypeError(f"values of type {kind.__name__}")
    try:
        return float(value)
    except OverflowError:
        return np.inf


_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_BOUND = re.compile(r"(?P<side>[<>≤≥])\s*=?\s*(?P<number>[+-]?\.?\d.*)")
UNMEASURED = (
    "write a finite number there; where only a bound is known, write that and say so by the key "
    "censored; delete the row only if nothing was measured"
)
"""The advice, in error messages, for a cell of the outcome that holds no number."""


def _number(cell: object, decimal: str) -> tuple[float, str]:
    """The number in a cell and an empty text, or NaN and a text that says what is wrong."""
    if isinstance(cell, Real) and not isinstance(cell, (bool, np.bool_)):
        number = float(cell)
    else:
        text = _text(cell)
        if not text:
            return math.nan, "the cell is blank, a number is needed"
        try:
            # float() would also accept 1_000, which is a typing error in a table.
            number = float(text.replace("_", "?").replace(decimal, "."))
        except ValueError:
            return math.nan, f"'{_short(text)}' is not a number"
    if not math.isfinite(number):
        return math.nan, f"'{_short(str(cell))}' is not a finite number"
    return number, ""


def _text(cell: object) -> str:
    """A cell as text without surrounding spaces; empty for a missing value."""
    return "" if type(cell).__name__ in _MISSING_TYPES else str(cell).strip()


def _blank(cell: object) -> bool:
    """Whether a cell holds nothing: a blank, a missing value, or a NaN."""
    return (isinstance(cell, Real) and cell != cell) or not _text(cell)


def _missing(cell: object) -> bool:
    """Whether a cell of numbers has none: it is blank, or says NA or N/A, as R and others write."""
    return _blank(cell) or _text(cell).upper() in ("NA", "N/A")


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


def _has_decimal_comma(cell: object) -> bool:
    return _DECIMAL_COMMA.fullmatch(_text(cell)) is not None


def _remedy(cell: object) -> str:
    """The advice, in error messages, for a cell of a condition that is no number."""
    if _has_decimal_comma(cell):
        return 'write a decimal point, or say so with the key decimal = ","'
    return "write a finite number there, or delete the row of an experiment that has none"


def _outcome_remedy(cell: object) -> str:
    """The advice, in error messages, for a cell of the outcome that is no number.

    A value known only by a bound is to be written as one: a deleted row would bias the law.
    """
    if _BOUND.fullmatch(_text(cell)):
        return (
            "say that cells with such a sign are bounds: censored = {signs = true}; without the "
            "row the law would be biased"
        )
    return _remedy(cell) if _has_decimal_comma(cell) else UNMEASURED


@dataclass(frozen=True)
class Table:
    """A table of N rows, whose cells are texts or Python values.

    `source` names the file or data frame. `columns` has a list of N cells for each column name.
    `places` (N,) says in words where each row stands. `decimal` is the decimal sign of numbers in
    texts. `ids` (N,) are the ids of the rows' experiments, or empty before they are read. `units`
    has the units that the headings of columns state, by column name.

    >>> table = Table("a.csv", {"ratio": ["0.95", "0.9"]}, ("row 2", "row 3"))
    >>> table.numbers("ratio").tolist()
    [0.95, 0.9]
    """

    source: str
    columns: Mapping[str, Sequence[object] | NDArray[Any]]
    places: Sequence[str]
    decimal: str = "."
    ids: Sequence[str] = ()
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.places)

    def require(self, name: str, role: str) -> None:
        """Raise ExperimentsError unless the column `name` is there; `role` says what it is for."""
        if name not in self.columns:
            known = ", ".join(f"'{column}'" for column in self.columns)
            lower = {column.lower(): column for column in self.columns}
            raise ExperimentsError(
                f"{self.source}: {role} '{name}' is not a column"
                f"{nearest(lower.get(name.lower(), name), self.columns)}",
                f"the columns are {known}",
            )

    def where(self, row: int, column: str) -> str:
        """The place of a cell in words, for messages: file, row, column, and experiment."""
        of = f" of experiment '{self.ids[row]}'" if self.ids else ""
        return f"{self.source}: {self.places[row]}, column '{column}'{of}"

    @property
    def rows(self) -> Sequence[str]:
        """The place of each row in words, for messages: file and row."""
        return _Worded(len(self.places), lambda row: f"{self.source}: {self.places[row]}")

    def is_number(self, column: str) -> Flags:
        """Whether each cell (N,) of a column is a finite number, or one with a decimal comma."""
        cells = self.columns[column]
        if _at_once(cells, self.decimal) is not None:
            return np.ones(len(self), dtype=bool)
        return np.array(
            [_number(cell, self.decimal)[1] == "" or _has_decimal_comma(cell) for cell in cells]
        )

    def texts(self, column: str) -> list[str]:
        """The N cells of a column as stripped texts, "" where a cell holds nothing."""
        return ["" if _blank(cell) else _text(cell) for cell in self.columns[column]]

    def numbers(self, column: str) -> Array:
        """The N numbers of a column, all finite.

        Raises ExperimentsError with the place of the first cell that is not a finite number.
        """
        return self._read(column, _remedy, blank=False)[0]

    def numbers_or_blank(self, column: str) -> Array:
        """The N numbers of a column, NaN where the cell is blank or says NA.

        Raises ExperimentsError for any other cell that is not a finite number.
        """
        return self._read(column, _outcome_remedy)[0]

    def bounds(self, column: str) -> tuple[Array, NDArray[np.int_]]:
        """The N numbers of a column and their signs: 1 for "> 20", -1 for "<= 0.5", else 0.

        The number is NaN where the cell is blank or says NA. Raises ExperimentsError for any other
        cell.

        >>> Table("a", {"y": ["> 20", "<=0,5", "3"]}, ["1", "2", "3"], ",").bounds("y")
        (array([20. ,  0.5,  3. ]), array([ 1, -1,  0]))
        """
        return self._read(column, _remedy, signed=True)

    def _read(
        self, column: str, remedy: Callable[[object], str], blank: bool = True, signed: bool = False
    ) -> tuple[Array, NDArray[np.int_]]:
        cells, signs = self.columns[column], np.zeros(len(self), dtype=int)
        if (found := _at_once(cells, self.decimal)) is not None:
            return found, signs
        numbers = np.full(len(self), np.nan)
        for row, cell in enumerate(cells):
            if blank and _missing(cell):
                continue
            bound = _BOUND.fullmatch(_text(cell)) if signed else None
            if bound:
                signs[row] = 1 if bound["side"] in ">≥" else -1
            numbers[row], fault = _number(bound["number"] if bound else cell, self.decimal)
            if fault:
                raise ExperimentsError(f"{self.where(row, column)}: {fault}", remedy(cell))
        return numbers, signs


class _Worded(Sequence[str]):
    """The places of rows in words, made only when they are asked for, as there may be millions."""

    def __init__(self, count: int, word: Callable[[int], str]) -> None:
        self._count, self._word = count, word

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[str]:
        return map(self._word, range(self._count))

    def __getitem__(self, row: int) -> str:  # type: ignore[override]
        return self._word(row)


def _at_once(cells: Sequence[object] | NDArray[Any], decimal: str) -> Array | None:
    """The numbers of a column with only finite numbers, read in one fast step; otherwise None."""
    if not isinstance(cells, np.ndarray):
        plain = decimal == "." and all(type(cell) is str and "_" not in cell for cell in cells)
        if not plain:
            return None
    try:
        numbers = np.array(cells, dtype=np.float64)
    except ValueError:
        return None
    return numbers if np.all(np.isfinite(numbers)) else None


def from_frame(frame: pd.DataFrame) -> Table:
    """The table of a data frame; the place of a row is its number from 1 and its index label.

    Raises ExperimentsError for no rows, no columns or a column name that appears twice.

    >>> import pandas as pd
    >>> from_frame(pd.DataFrame({"v": [1.0]}, index=["first"])).places[0]
    "row 1 (index 'first')"
    """
    source = "the data frame"
    names = [str(name) for name in frame.columns]
    _check_header(names, source)
    if frame.empty:
        raise ExperimentsError(f"{source} has no rows", "give one row for each experiment")
    label = frame.index
    places = _Worded(
        len(frame), lambda row: f"row {row + 1} (index {label[row : row + 1].tolist()[0]!r})"
    )
    return Table(source, {n: _cells(frame.iloc[:, k]) for k, n in enumerate(names)}, places)


def _cells(column: pd.Series) -> list[object] | NDArray[Any]:
    """The cells of a column: an array if all are plain numbers, which is fast, else a list."""
    plain = isinstance(column.dtype, np.dtype) and column.dtype.kind in "fiu"
    return column.to_numpy() if plain else column.tolist()


def _check_header(header: Sequence[str], source: str) -> None:
    """Raise ExperimentsError for no columns, a column without a name, and a name used twice."""
    if not header:
        raise ExperimentsError(f"{source} has no columns", "name the columns in the first row")
    for k, name in enumerate(header):
        if not name:
            raise ExperimentsError(
                f"{source}: row 1: column {k + 1} has no name",
                "name it in the header, or delete it",
            )
        if name in header[:k]:
            raise ExperimentsError(
                f"{source}: row 1: the column name '{name}' appears twice "
                f"(columns {header.index(name) + 1} and {k + 1})",
                "give each column its own name",
            )


_DELIMITERS = {",": "a comma", ";": "a semicolon", "\t": "a tab", "|": "a vertical bar"}
_UNIT = re.compile(r"^(?P<name>.*\S)\s*(\[(?P<unit>[^\[\]]+)\]|\((?P<symbols>[^()]+)\))$")
_SYMBOL = re.compile(
    r"[pnµμumcdhkMG]?(m|g|s|N|Pa|J|W|V|A|K|Hz|mol|M|l|L|bar|Ω|ohm|C|F|T|H|eV|Nm|rad)|"
    r"°C|°F|degC|°|deg|%|h|min|d|rpm|in|ft|psi|ksi|lbf|lb|mmHg"
)


def is_unit(text: str) -> bool:
    """Whether a text is a unit: symbols such as mm, kN and °C, with powers, products and quotients.

    >>> is_unit("N/mm^2"), is_unit("1/s"), is_unit("max"), is_unit("left")
    (True, True, False, False)
    """
    symbols = [part for part in re.split(r"[\s/*·^.²³\d-]+", text) if part]
    return bool(symbols) and all(map(_SYMBOL.fullmatch, symbols))


_ENDINGS = {".xlsx": "excel", ".xlsm": "excel", ".parquet": "parquet"}
"""Endings of tables that are no text, with the extra of Aleator that reads them."""
_READERS = {"excel": "openpyxl", "parquet": "pyarrow"}


def is_text(path: str | Path) -> bool:
    """Whether a table is a delimited text file, and no workbook and no Parquet file."""
    return Path(path).suffix.lower() not in _ENDINGS


def read(path: str | Path, delimiter: str = ",", decimal: str = ".") -> Table:
    """Read a delimited text file (UTF-8 or UTF-16, with or without a byte order mark).

    `delimiter` is one character, and `decimal` is "." or ",". Rows without any text are skipped,
    but counted in row numbers. Columns at the end with neither a name nor a text are skipped.
    By its ending a file may also be the first sheet of a workbook (.xlsx, needs openpyxl), or a
    Parquet file (.parquet, needs pyarrow); `delimiter` then has no meaning.

    Raises ExperimentsError for a file that is absent, empty or in another encoding, for a
    delimiter that is not the file's, rows of unequal length and a column name that appears twice.
    """
    if not is_text(path):
        return _of_cells(str(path), _cells_of(Path(path)), "", decimal)
    if len(delimiter) != 1 or decimal not in (".", ",") or delimiter == decimal:
        raise ExperimentsError(
            f"{path}: delimiter {delimiter!r} with decimal {decimal!r} cannot be read",
            'the delimiter is one character, the decimal sign "." or ",", and they differ',
        )
    source = str(path)
    return _of_cells(source, _rows(_decoded(Path(path)), delimiter, source), delimiter, decimal)


def _of_cells(
    source: str, numbered: list[tuple[int, list[Any]]], delimiter: str, decimal: str
) -> Table:
    """The table of rows of cells with their numbers; the first row has the column names.

    The numbers are those of lines in a text file, which has a `delimiter`, and else those of rows.
    """
    place = "line" if delimiter else "row"
    if not numbered:
        raise ExperimentsError(
            f"{source}: the file is empty", "write a header and a row per experiment"
        )
    (_, header), *numbered = numbered
    while (
        header
        and _blank(header[-1])
        and all(_blank(cell) for _, row in numbered for cell in row[len(header) - 1 :])
    ):
        header.pop()
        numbered = [(number, row[: len(header)]) for number, row in numbered]
    header = ["" if _blank(name) else _text(name) for name in header]
    _check_delimiter(header, delimiter, source)
    header, units = _without_units(header)
    _check_header(header, source)
    for number, row in numbered:
        if len(row) != len(header):
            raise ExperimentsError(
                f"{source}: {place} {number} has {len(row)} cells, the header has {len(header)}",
                "fill in or delete cells so that the row fits the header"
                + ("; a decimal comma splits a number in two" if delimiter == "," else ""),
            )
    if not numbered:
        raise ExperimentsError(
            f"{source}: there is a header but no rows", "write one row for each experiment"
        )
    columns = {name: [row[k] for _, row in numbered] for k, name in enumerate(header)}
    places = [f"{place} {number}" for number, _ in numbered]
    return Table(source, columns, places, decimal, units=units)


def stated_units(path: str | Path, delimiter: str = ",") -> dict[str, str]:
    """The units that the headings of a file's columns state, by the column names without units."""
    if not is_text(path):
        return dict(read(path).units)
    rows = csv.reader(io.StringIO(_decoded(Path(path)), newline=""), delimiter=delimiter)
    header = next((row for row in rows if any(cell.strip() for cell in row)), [])
    return _without_units([name.strip() for name in header])[1]


def _without_units(header: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Column headings without their units, and the units by name.

    A unit stands in square brackets, or in round ones if it has the symbols of a unit. Headings
    that differ only in what is in brackets keep it.

    >>> _without_units(["travel [mm]", "force [N]", "force [kN]", "id", "wear (µm)", "x (max)"])
    (['travel', 'force [N]', 'force [kN]', 'id', 'wear', 'x (max)'], {'travel': 'mm', 'wear': 'µm'})
    """
    found = [_UNIT.match(head) for head in header]
    bare = [match["name"] if match else head for match, head in zip(found, header, strict=True)]
    units = {
        name: (match["unit"] or match["symbols"]).strip()
        for name, match in zip(bare, found, strict=True)
        if match and bare.count(name) == 1 and (match["unit"] or is_unit(match["symbols"]))
    }
    return [n if n in units else h for n, h in zip(bare, header, strict=True)], units


def _cells_of(path: Path) -> list[tuple[int, list[Any]]]:
    """The rows of the first sheet of a workbook, or of a Parquet file, with their row numbers.

    Raises ExperimentsError for a file that is absent or cannot be read, and without its reader.
    """
    import pandas as pd

    _require_file(path)
    kind = _ENDINGS[path.suffix.lower()]
    reader = _READERS[kind]
    if importlib.util.find_spec(reader) is None:
        raise ExperimentsError(
            f"{path}: this file needs {reader}, which is not installed",
            f"{installing(kind)}, or save it as CSV UTF-8 and name that file",
        )
    try:
        if kind == "excel":
            frame = pd.read_excel(
                path, header=None, dtype=object, engine="openpyxl", keep_default_na=False
            )
            rows = frame.to_numpy().tolist()
        else:
            frame = pd.read_parquet(path)
            rows = [list(map(str, frame.columns)), *frame.astype(object).to_numpy().tolist()]
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise ExperimentsError(
            f"{path}: the file cannot be read: {error}", "save it as CSV UTF-8 and name that file"
        ) from None
    return [(number, row) for number, row in enumerate(rows, 1) if not all(map(_blank, row))]


def _require_file(path: Path) -> None:
    """Raise ExperimentsError if there is no such file."""
    if not path.exists():
        beside = sorted(entry.name for entry in path.parent.glob("*"))
        raise ExperimentsError(
            f"{path}: there is no such file{nearest(path.name, beside)}",
            "check the name; it is relative to the study file",
        )


def _decoded(path: Path) -> str:
    """The text of a file. Raises ExperimentsError if it is absent, unreadable or no text file."""
    _require_file(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ExperimentsError(
            f"{path}: the file cannot be read: {error.strerror}", "name a text file (CSV)"
        ) from None
    if raw.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise ExperimentsError(
            f"{path}: this is a workbook, not a text file",
            "end its name in .xlsx if it is one, or save it as CSV UTF-8 and name that file",
        )
    encoding = "utf-16" if raw.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError as error:
        row = raw[: error.start].count(b"\n") + 1
        raise ExperimentsError(
            f"{path}: line {row} is not UTF-8 text (byte 0x{raw[error.start]:02x})",
            "save the file with the encoding UTF-8 (in a spreadsheet: 'CSV UTF-8')",
        ) from None
    if "\0" in text:
        row = text[: text.index("\0")].count("\n") + 1
        raise ExperimentsError(
            f"{path}: line {row} has a null character: this is not a text file",
            "save it as CSV UTF-8",
        )
    return text


def _rows(text: str, delimiter: str, source: str) -> list[tuple[int, list[str]]]:
    """The rows that hold any text, each with the number of its first line and its cells."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        first, rows = 1, []
        for row in reader:
            rows.append((first, [cell.strip() for cell in row]))
            first = reader.line_num + 1
    except csv.Error as error:
        raise ExperimentsError(
            f"{source}: line {reader.line_num}: {error}", "check the quotation marks from there on"
        ) from None
    return [(number, row) for number, row in rows if any(row)]


def _check_delimiter(header: Sequence[str], delimiter: str, source: str) -> None:
    """Raise ExperimentsError if there is one column whose heading contains another delimiter."""
    for other, words in _DELIMITERS.items() if delimiter and len(header) == 1 else ():
        if other != delimiter and other in header[0]:
            written = other.replace("\t", r"\t")
            raise ExperimentsError(
                f"{source}: row 1: the columns are separated by {words}, not by "
                f"{_DELIMITERS.get(delimiter, repr(delimiter))}: '{_short(header[0])}'",
                f'say so with the key delimiter = "{written}"'
                + (' (and decimal = "," if numbers look like 0,95)' if other != "," else ""),
            )
