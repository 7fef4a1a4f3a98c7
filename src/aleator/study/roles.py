"""The possible roles of the columns of a table: outcome, condition, id, error, covariate, bound."""

from __future__ import annotations

import csv
import io
import keyword
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from aleator.core.types import Array, Flags
from aleator.errors import ExperimentsError
from aleator.observations import tables
from aleator.observations.experiments import DEFAULT_ID
from aleator.observations.outcomes import Censoring
from aleator.observations.tables import Table


@dataclass(frozen=True)
class RoleRules:
    """Settings that recognize roles of columns. tests/test_cli_new.py chose the values.

    That test uses published tables. levels: the largest number of different texts in a covariate.
    each: the number of experiments that each proposed covariate needs. words: the largest number of
    different words in a column that marks censored values. naming: the smallest number of different
    values by which a column identifies experiments if its name does not say so; a column with fewer
    values rather names suppliers or test benches. groups: the smallest number of groups of a level:
    with two of them nobody can tell how much groups differ.
    """

    levels: int = 6
    each: int = 10
    words: int = 8
    naming: int = 5
    groups: int = 3


RULES = RoleRules()


def numbers_of(table: Table, name: str) -> Array | None:
    """The numbers of a column: NaN for a blank cell, 20 for "> 20".

    The result is None if the column has other texts, or no number at all.
    """
    try:
        numbers, _ = table.bounds(name)
    except ExperimentsError:
        return None
    return numbers if np.any(np.isfinite(numbers)) else None


def unread_cells(table: Table, name: str) -> str:
    """How many cells of a column are no numbers, and the first of them with their rows.

    Bounds such as "> 20" and blank cells are not among them. The text is empty if there are none.

    >>> unread_cells(Table("a.csv", {"life": ["1", "20+"]}, ("row 2", "row 3")), "life")
    "1 of 2 cells ('20+' in row 3); write a value known only by a bound as >20"
    """
    faulty = [] if _is_read(table, name) else [
        row for row, cell in enumerate(table.columns[name])
        if not _is_read(replace(table, columns={name: [cell]}, places=[""], ids=()), name)
    ]  # fmt: skip
    if not faulty:
        return ""
    texts = table.texts(name)
    named = ", ".join(f"'{texts[row]}' in {table.places[row]}" for row in faulty[:3])
    more = ", ..." if len(faulty) > 3 else ""
    return (
        f"{len(faulty)} of {len(table)} cells ({named}{more}); write a value known only by a bound "
        f"as >{re.sub(r'[^0-9.,]', '', texts[faulty[0]]) or 20}"
    )


def _is_read(table: Table, name: str) -> bool:
    """Whether all cells of a column are numbers, bounds or blank."""
    try:
        table.bounds(name)
    except ExperimentsError:
        return False
    return True


def varies_within(table: Table, name: str, id: str | None) -> bool:
    """Whether a column has different values in the rows of the same experiment."""
    if id is None:
        return False
    texts = table.texts(name)
    return len({*zip(table.texts(id), texts, strict=True)}) > len({*table.texts(id)})


def covariates_in(table: Table, names: Sequence[str], id: str | None) -> dict[str, str]:
    """The columns that may be covariates of a law, each with its term in a formula.

    A covariate has no blank cell, and one value for each experiment. A column of texts needs few
    different texts, each in two experiments or more. A column of numbers must vary and must not
    merely count the rows. There is at most one covariate for every ten experiments, but one may
    always be proposed.

    >>> cells = {"by": ["a", "a", "b", "b"], "t": ["20", "25", "20", "30"]}
    >>> covariates_in(Table("a.csv", cells, ["row"] * 4), ["by", "t"], None)
    {'by': 'C(by)'}
    """
    first = _first_rows(table, id)
    found = {name: _term(table, name, first) for name in names if _can_be_named(name)}
    known = [
        (name, term) for name, term in found.items() if term and not varies_within(table, name, id)
    ]
    return dict(known[: max(len(first) // RULES.each, 1)])


def levels_in(table: Table, names: Sequence[str], id: str | None) -> tuple[str, ...]:
    """The columns whose groups of experiments may share a draw of a parameter, such as batches.

    Such a column has a name like "batch", or texts. It has no blank cell, one value for each
    experiment, three different values or more, and on average two experiments or more for each.

    >>> cells = {"lot": ["1", "1", "2", "2", "3", "3"], "warm": ["1", "1", "2", "2", "3", "3"]}
    >>> levels_in(Table("a.csv", cells, ["row"] * 6), ["lot", "warm"], None)
    ('lot',)
    """
    first = _first_rows(table, id)
    found = []
    for name in names:
        texts = [table.texts(name)[row] for row in first]
        groups = len({*texts})
        told = _GROUPING.search(name) or numbers_of(table, name) is None
        if told and "" not in texts and RULES.groups <= groups <= len(first) // 2:
            found.append(name)
    return tuple(name for name in found if not varies_within(table, name, id))


def _first_rows(table: Table, id: str | None) -> list[int]:
    """The index of the first row of each experiment."""
    if id is None:
        return [*range(len(table))]
    return [*{text: row for row, text in reversed([*enumerate(table.texts(id))])}.values()]


def _term(table: Table, name: str, rows: Sequence[int]) -> str:
    """The term of a column in a formula; empty if the column cannot be a covariate."""
    texts = [table.texts(name)[row] for row in rows]
    numbers = numbers_of(table, name)
    if "" in texts or len({*texts}) < 2:
        return ""
    if numbers is None:
        fit = len({*texts}) <= RULES.levels and min(map(texts.count, {*texts})) > 1
        return f"C({name})" if fit else ""
    steps = np.diff(numbers[sorted(rows)])
    return "" if np.all(steps == 1.0) else f"center({name})"


def _can_be_named(name: str) -> bool:
    """Whether a formula can contain the name of the column."""
    return name.isidentifier() and not keyword.iskeyword(name)


_RIGHT = re.compile(
    r"run-?outs?|(right-?)?censored|right|suspen(ded|sion)|surviv(ed|or|al)|no-?failure|intact|"
    r"(not|un)-?(failed|broken)|stopped|(still-)?(running|working|alive)|(on-?going|in-service|"
    r"withdrawn|removed)|above|>.*"
)
_LEFT = re.compile(
    r"left(-?censored)?|below(-?(lod|loq|limit))?|bdl|nd|(not|un)-?detected|lod|loq|<.*"
)
_FLAG = re.compile(r"(right-?)?censored|cens|run-?out|suspended")
_EVENT = re.compile(r"event|fail(ed|ure)|broken|died")
_NO, _YES = ("0", "no", "false", "n"), ("1", "yes", "true", "y")
_LETTERS = ({"f", "s"}, {"f", "c"})
"""Letters that programs for reliability use: f for failed, s for suspended, c for censored."""
_UPPER = re.compile(r"(?:(?P<stem>.+)_)?(upper|upper_end|high|max|to|until|latest)", re.IGNORECASE)
_LOWER = re.compile(r"(?:(?P<stem>.+)_)?(lower|lower_end|low|min|from|since|earliest)",
                    re.IGNORECASE)  # fmt: skip


def censoring_of(table: Table, outcome: str, columns: Iterable[str]) -> Censoring | None:
    """How a table marks censored values of an outcome: by signs in its cells, or by a column.

    A column of words marks censored values if some but not all of its words are like "run-out" or
    "<LOD", or if its name is like "censored" or "event" and its values are like yes and no. A
    column of numbers does if its name is like "upper" and it is never below the outcome. The result
    is None if nothing marks censored values.

    >>> table = Table("a.csv", {"y": ["1", "2"], "s": ["", "Run-out"]}, ("line 2", "line 3"))
    >>> censoring_of(table, "y", ["s"]).right
    ('Run-out',)
    """
    if shows_bounds(table, outcome):
        return Censoring(signs=True)
    for name in columns:
        if is_upper_end(table, outcome, name):
            return Censoring(upper=name)
        if told := _by_words(table, name):
            return told
    return None


def shows_bounds(table: Table, name: str) -> bool:
    """Whether a column has cells that state a bound, such as "> 20"."""
    return any(text.startswith((">", "<", "≥", "≤")) for text in table.texts(name))


def tells_bounds(table: Table, name: str, among: Sequence[str]) -> bool:
    """Whether a column marks censored values, or is the upper end of one of the columns `among`."""
    return _by_words(table, name) is not None or any(
        is_upper_end(table, other, name) for other in among if other != name
    )


def is_upper_end(table: Table, outcome: str, name: str) -> bool:
    """Whether a column is the upper end of intervals that begin at the outcome.

    Its name must be like "upper" or "max", and its numbers never below the outcome's.
    """
    upper = _UPPER.fullmatch(name)
    lower = _LOWER.fullmatch(outcome)
    if upper is None:
        return False
    stem = (upper["stem"] or "").lower()
    if stem not in ("", outcome.lower(), (lower["stem"] or "").lower() if lower else ""):
        return False
    low, high = numbers_of(table, outcome), numbers_of(table, name)
    if low is None or high is None:
        return False
    with np.errstate(invalid="ignore"):
        return bool(np.any(high > low) and not np.any(high < low))


def _by_words(table: Table, name: str) -> Censoring | None:
    words = [word for word in dict.fromkeys(table.texts(name)) if word]
    if not 1 <= len(words) <= RULES.words:
        return None
    plain = {word: re.sub(r"[\s_-]+", "-", word.lower()) for word in words}
    called = re.sub(r"[\s_-]+", "-", name.lower())
    right = [word for word in words if _RIGHT.fullmatch(plain[word])]
    left = [word for word in words if _LEFT.fullmatch(plain[word])]
    for pattern, meant in ((_FLAG, _YES), (_EVENT, _NO)):
        if pattern.fullmatch(called) and set(plain.values()) <= {*_NO, *_YES}:
            right = [word for word in words if plain[word] in meant]
    if set(plain.values()) in _LETTERS:
        right = [word for word in words if plain[word] != "f"]
    measured = [word for word in words if word not in (*right, *left)]
    blank = "" in table.texts(name)
    if not (right or left) or not (measured or blank):
        return None
    several = tuple(measured) if len(measured) > 1 else ()
    return Censoring(name, tuple(right), tuple(left), measured=several)


DELIMITERS = (",", ";", "\t", "|")
TIMES = ("time", "Time", "t", "Zeit")
"""Names of a column that mark it as times; T is missing, for it often is a temperature."""
_COMMA = re.compile(r"^[<>≤≥]?=?\s*-?\d+,\d+$")
_ERROR = re.compile(
    r"(^|_)(sd|std|se|sem|std_?err|sigma|error|uncertainty|noise)($|_)", re.IGNORECASE
)
_NAMING = re.compile(
    r"(^|[_ ])(id|no|nr|number|name|experiment|test|run|unit|specimen|sample|part|serial|subject|"
    r"person|patient|tank|device|cell|versuch|prüfling|probe|bauteil|gerät|proband)($|[_ ])",
    re.IGNORECASE,
)
_GROUPING = re.compile(
    r"(^|[_ ])(batch|lot|heat|melt|cast|supplier|maker|vendor|day|date|week|shift|operator|machine|"
    r"rig|bench|lab|site|plant|plate|cask|"
    r"charge|los|schmelze|lieferant|hersteller|tag|datum|schicht|prüfer|maschine|labor|werk)"
    r"($|[_ ])",
    re.IGNORECASE,
)
"""Names of columns whose values are groups of experiments, in English and German."""


@dataclass(frozen=True)
class Sheet:
    """A table that was read from a file, with the delimiter and the decimal sign of the file.

    The delimiter is empty for a workbook or a Parquet file.
    """

    table: Table
    delimiter: str
    decimal: str

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the columns of the table."""
        return tuple(self.table.columns)


@dataclass(frozen=True)
class Roles:
    """The possible roles of the columns of a table, for a simulator with known inputs.

    `conditions` are inputs of the simulator. `outcomes` are other columns of numbers that vary; if
    some vary within experiments, only these. `errors` are columns with the name of a measurement
    error. `id` is the column that identifies the experiments, or None; `repeated` says that several
    rows share an id. `constant` columns have one value, and `others` are all remaining columns.
    """

    conditions: tuple[str, ...]
    outcomes: tuple[str, ...]
    errors: tuple[str, ...]
    id: str | None
    repeated: bool
    constant: tuple[str, ...]
    others: tuple[str, ...]


def sheet_of(path: Path, head: int = 10_000) -> Sheet:
    """Read a table from a file, and recognize its delimiter and its decimal sign.

    The delimiter is the most frequent one in the first line, which lies within the first `head`
    bytes. Raises ExperimentsError if the file cannot be read as a table.
    """
    try:
        header = path.read_bytes()[:head].decode("utf-8", "replace").partition("\n")[0]
    except OSError:
        header = ""  # `tables.read` raises the error of a file that cannot be read.
    delimiter = max(DELIMITERS, key=header.count) if tables.is_text(path) else ""
    table = tables.read(path, delimiter)
    cells = [str(cell) for column in table.columns.values() for cell in column]
    comma = delimiter != "," and any(_COMMA.match(cell) for cell in cells)
    return Sheet(tables.read(path, delimiter, ","), delimiter, ",") if comma else Sheet(
        table, delimiter, "."
    )  # fmt: skip


def is_measured(table: Table, outcomes: Sequence[str]) -> Flags:
    """Whether each outcome (R, m) was measured in each row: its cell is not blank, and not NA.

    A column with cells that are no numbers counts as measured.
    """
    numbers = [numbers_of(table, name) for name in outcomes]
    flags = [np.ones(len(table), bool) if of is None else np.isfinite(of) for of in numbers]
    return np.stack(flags, axis=1)


def measured_rows(sheet: Sheet, outcomes: Sequence[str]) -> tuple[str, tuple[str, ...]] | None:
    """A CSV text of the rows in which something was measured, and the places of the others.

    None if something was measured in every row.

    >>> cells = {"force": ["1", "2"], "travel": ["0.5", "NA"]}
    >>> table = Table("a.csv", cells, ["line 2", "line 3"], units={"force": "N"})
    >>> measured_rows(Sheet(table, ",", "."), ["travel"])
    ('force [N],travel\\n1,0.5\\n', ('line 3',))
    """
    table, kept = sheet.table, np.any(is_measured(sheet.table, outcomes), axis=1).tolist()
    if all(kept):
        return None
    units = table.units
    head = [f"{name} [{units[name]}]" if name in units else name for name in sheet.names]
    rows = zip(*(table.texts(name) for name in sheet.names), strict=True)
    text = io.StringIO()
    writer = csv.writer(text, delimiter=sheet.delimiter or ";", lineterminator="\n")
    writer.writerows([head, *(row for row, there in zip(rows, kept, strict=True) if there)])
    return text.getvalue(), tuple(table.places[row] for row, there in enumerate(kept) if not there)


def roles_in(table: Table, taken: Collection[str], outcome: Sequence[str] = ()) -> Roles:
    """The roles of the columns of a table; `taken` are the inputs of the simulator.

    A column in `outcome` has no other role. The id is the column "id", or else a column of texts or
    whole numbers that is no condition. Such a column is the id if it has a name like "specimen", a
    different text in each row, consecutive numbers, or values that distinguish rows with equal
    conditions or repeat with them. A column with a name like "batch" is it only where times vary
    within its groups. Of several such columns the one with the most different values is the id; a
    column that counts the rows comes last.
    """
    numbers = {name: numbers_of(table, name) for name in table.columns}
    distinct = {name: len({*table.texts(name)}) for name in table.columns}
    conditions = tuple(name for name in table.columns if name in taken and name not in outcome)
    left = [name for name in table.columns if name not in conditions and name not in outcome]
    naming = [name for name in left if _names_experiments(table, name, conditions, distinct)]

    def told(name: str) -> tuple[bool, bool, int]:
        counts = distinct[name] == len(table) and numbers[name] is not None
        return name == DEFAULT_ID, not counts, distinct[name]

    chosen = max(naming, key=told, default="")
    errors = tuple(n for n in left if _ERROR.search(n) and _positive(numbers[n]) and n != chosen)
    constant = tuple(name for name in left if distinct[name] == 1 and name != chosen)
    rest = [name for name in left if name not in (chosen, *errors, *constant)]
    measured = _measured(table, [name for name in rest if numbers[name] is not None], chosen)
    return Roles(
        conditions,
        tuple(outcome) or measured,
        errors,
        chosen or None,
        bool(chosen) and distinct[chosen] < len(table),
        constant,
        tuple(name for name in rest if outcome or name not in measured),
    )


def _measured(table: Table, numbers: list[str], id: str) -> tuple[str, ...]:
    """The columns of numbers that may be outcomes: those that vary within experiments, or else all.

    Columns that mark censored values are left out.
    """
    values = [name for name in numbers if not tells_bounds(table, name, numbers)]
    varying = [name for name in values if varies_within(table, name, id or None)]
    return tuple(varying or values)


def spread_of(table: Table, column: str, *, log: bool = False) -> float:
    """The standard deviation of the numbers of a column, or of their logarithms.

    The result is NaN if the column has fewer than two numbers.
    """
    known = _known(table, column)
    if known.size < 2:
        return np.nan
    return float(np.std(np.log(known) if log else known, ddof=1))


def count_of(table: Table, id: str | None) -> int:
    """The number of experiments in a table."""
    return len(table) if id is None else len({*table.texts(id)})


def conditions_each(table: Table, conditions: Sequence[str], id: str | None) -> int:
    """The largest number of different conditions under which one experiment was measured."""
    if id is None:
        return 1
    rows = {*zip(*(table.texts(name) for name in (id, *conditions)), strict=True)}
    names = [name for name, *_ in rows]
    return max(map(names.count, {*names}))


def decades_of(table: Table, column: str) -> float:
    """The decades from the smallest to the largest number of a column; 0 if one is not positive."""
    known = _known(table, column)
    if known.size < 2 or known.min() <= 0.0:
        return 0.0
    return float(np.log10(known.max() / known.min()))


def _known(table: Table, column: str) -> Array:
    numbers = numbers_of(table, column)
    return np.array([]) if numbers is None else numbers[np.isfinite(numbers)]


def _positive(numbers: Array | None) -> bool:
    return numbers is not None and bool(np.all(numbers > 0.0))


def _names_experiments(
    table: Table, name: str, conditions: Sequence[str], distinct: dict[str, int]
) -> bool:
    texts = table.texts(name)
    if distinct[name] == 1 or "" in texts or not _whole_or_text(table, name):
        return False
    if _GROUPING.search(name) and distinct[name] < len(table):
        times = [one for one in conditions if one in TIMES]
        return any(varies_within(table, one, name) for one in times)
    each_its_own = distinct[name] == len(table) and _counts_or_text(table, name)
    if name == DEFAULT_ID or _NAMING.search(name) or each_its_own:
        return True
    rows = [*zip(*(table.texts(condition) for condition in conditions), strict=True)]
    told_apart = len({*zip(texts, rows, strict=True)}) if rows else 0
    repeated = bool(rows) and len({*rows}) < len(rows)
    some = RULES.naming <= distinct[name] <= len(table) // 2
    same = not any(varies_within(table, condition, name) for condition in conditions)
    again = same and _labels(table, name)
    return some and repeated and (told_apart == len(table) or again)


def _labels(table: Table, name: str) -> bool:
    """Whether a column has texts, or the whole numbers from 1 on."""
    numbers = numbers_of(table, name)
    values = np.unique([] if numbers is None else numbers)
    return numbers is None or np.array_equal(values, np.arange(1.0, values.size + 1.0))


def _counts_or_text(table: Table, name: str) -> bool:
    """Whether a column has texts, or numbers that count the rows."""
    numbers = numbers_of(table, name)
    return numbers is None or bool(np.all(np.diff(numbers) == 1.0))


def _whole_or_text(table: Table, name: str) -> bool:
    numbers = numbers_of(table, name)
    return numbers is None or bool(np.all(numbers == np.round(numbers)))
