"""What in a table says that measured values are bounds only."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

from aleator.observations.outcomes import Censoring
from aleator.observations.tables import Table
from aleator.study.roles import numbers_of

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
"""Failed and suspended, failed and censored, as tables of reliability programs have them."""
_UPPER = re.compile(r"(?:(?P<stem>.+)_)?(upper|upper_end|high|max|to|until|latest)", re.IGNORECASE)
_LOWER = re.compile(r"(?:(?P<stem>.+)_)?(lower|lower_end|low|min|from|since|earliest)",
                    re.IGNORECASE)  # fmt: skip
WORDS = 8
"""A column of more words does not tell what is censored."""


def censoring_of(table: Table, outcome: str, columns: Iterable[str]) -> Censoring | None:
    """How bounds of an outcome are told: by signs in its cells, or by one of the columns.

    A column of words tells it where some but not all of its words are such as "run-out" or "<LOD",
    or where it is called "censored" or "event" and has two values; a column of numbers where its
    name is that of an upper end and it is never below the outcome. None where nothing tells it.

    >>> table = Table("a.csv", {"y": ["1", "2"], "s": ["", "Run-out"]}, ("row 2", "row 3"))
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
    """Whether cells of a column say themselves that they are bounds: "> 20"."""
    return any(text.startswith((">", "<", "≥", "≤")) for text in table.texts(name))


def tells_bounds(table: Table, name: str, among: Sequence[str]) -> bool:
    """Whether a column of numbers is the upper end of another one, or a flag of bounds."""
    return _by_words(table, name) is not None or any(
        is_upper_end(table, other, name) for other in among if other != name
    )


def is_upper_end(table: Table, outcome: str, name: str) -> bool:
    """Whether a column is called as the upper end of another one, and is never below it."""
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
    if not 1 <= len(words) <= WORDS:
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
