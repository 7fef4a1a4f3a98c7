"""Damage: a file or a tree of values, and another one that is wrong somewhere."""

from __future__ import annotations

import copy
import csv
import io
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

Tree = dict[str, Any]
Path = tuple[str, ...]

NUMBERS: tuple[Any, ...] = (
    0, 1, -1, 2, 3, 7, -0.0, 0.5, 1e-320, 1e-9, -1e300, 1e300, math.inf, -math.inf, math.nan,
    2**31, 2**63, 10**30, True, False,
)  # fmt: skip
TEXTS = (
    "", " ", "nan", "1", "load", "softness", "lod", "normal", "gamma", "log", "1 + load", "C(load)",
    "{softness}", "{", "}", "softness.mean", "a" * 300, "a" * 5000, "é", "\u2028", "\ud800", "\x00",
    "\n", "'", '"', "=1+1", "> 3", "1,5", "1_0", "٣", "0x10", "1e400", "-1e400", "1e-400", "inf",
    "model.py", "model.py:length", "springs.csv", ".", "nowhere/at/all",
)  # fmt: skip
TREES: tuple[Any, ...] = (
    [], {}, [[]], [1], ["load"], [0, 1], [1, 0], [0.9, 1.1], {"lower": 0.5}, {"": 1},
    {"lower": 0.8, "upper": 1.2}, {"lower": 1.2, "upper": 0.8}, {"column": "load"},
)  # fmt: skip
BYTES = (
    b"",
    b"\x00",
    b"\xff",
    b"\xef\xbb\xbf",
    b"\xff\xfe",
    b"\r",
    b"\n\n",
    b"[" * 2000,
    b'"',
    b",",
)


class Damage:
    """Damage by a generator of random numbers: the same one does the same."""

    def __init__(self, chance: np.random.Generator) -> None:
        self._chance = chance

    def choose(self, among: Sequence[Any]) -> Any:
        """One of several."""
        return among[int(self._chance.integers(len(among)))]

    def value(self) -> Any:
        """Something that does not belong where it is put."""
        return copy.deepcopy(self.choose(self.choose((NUMBERS, TEXTS, TREES))))

    def tree(self, tree: Tree, times: int) -> Tree:
        """A tree with so many places changed: other values, other names, less and more."""
        changed = copy.deepcopy(tree)
        for _ in range(times):
            places = list(_places(changed))
            if not places:
                break
            self.choose((self._replace, self._replace, self._scale, self._remove, self._rename,
                         self._add, self._swap))(places)  # fmt: skip
        return changed

    def varied(self, tree: Tree, options: Sequence[tuple[Path, Sequence[Any]]], times: int) -> Tree:
        """A tree with so many values changed within their kind: other options, nearby numbers."""
        changed = copy.deepcopy(tree)
        for _ in range(times):
            if self._chance.random() < 0.4:
                numbers = [(h, k) for h, k in _places(changed) if type(h[k]) is float]
                if numbers:
                    holder, key = self.choose(numbers)
                    holder[key] *= self.choose((0.9, 0.95, 1.02, 1.05, 1.1))
                continue
            (*path, last), values = self.choose(options)
            at: Any = changed
            for key in path:
                at = self.choose([*at.values()]) if key == "*" else at.setdefault(key, {})
            at[last] = copy.deepcopy(self.choose(values))
        return changed

    def nearby(self, tree: Tree, times: int) -> Tree:
        """A tree with so many numbers changed as a result may have them: nearby, of the other sign,
        0, or null, which stands for NaN. Every branch is as likely as the next one."""
        changed = copy.deepcopy(tree)
        for _ in range(times):
            at: Any = changed
            while True:
                key = self.choose([*at] if isinstance(at, dict) else range(len(at)))
                if not (isinstance(at[key], (dict, list)) and at[key]):
                    break
                at = at[key]
            if type(at[key]) is float:
                at[key] = self.choose((0.9 * at[key], 1.1 * at[key], -at[key], 0.0, None))
        return changed

    def bytes(self, raw: bytes, times: int) -> bytes:
        """Bytes with so many places changed: overwritten, inserted, removed, cut off."""
        found = bytearray(raw)
        for _ in range(times):
            at = int(self._chance.integers(len(found) + 1))
            long = int(self._chance.integers(1, 40))
            kind = self._chance.integers(5)
            if kind == 0:
                found[at : at + 1] = bytes([int(self._chance.integers(256))])
            elif kind == 1:
                found[at:at] = self.choose(BYTES)
            elif kind == 2:
                del found[at : at + long]
            elif kind == 3:
                found[at:at] = found[at : at + long]
            elif self._chance.random() < 0.2:
                del found[at:]
        return bytes(found)

    def text(self, text: str, times: int) -> str:
        """A text with so many lines or words changed."""
        lines = text.split("\n")
        for _ in range(times):
            at, other = (int(self._chance.integers(len(lines))) for _ in range(2))
            kind = self._chance.integers(4)
            if kind == 0 and len(lines) > 1:
                del lines[at]
            elif kind == 1:
                lines.insert(at, lines[other])
            elif kind == 2:
                lines[at], lines[other] = lines[other], lines[at]
            else:
                words = lines[at].split(" ")
                words[int(self._chance.integers(len(words)))] = str(self.value())
                lines[at] = " ".join(words)
        return "\n".join(lines)

    def cells(self, text: str, times: int, near: bool = False) -> str:
        """A table as CSV with so many cells, rows or columns changed; `near`: mostly numbers."""
        rows = [row for row in csv.reader(io.StringIO(text)) if row]
        for _ in range(times):
            if not rows or not rows[0]:
                break
            if near and self._chance.random() < 0.9:
                self._number(rows)
            else:
                self.choose((self._cell,) * 3 + (self._row, self._column))(rows)
        written = io.StringIO()
        delimiter = "," if near else self.choose((",",) * 9 + (";", "\t"))
        csv.writer(written, delimiter=delimiter, lineterminator="\n").writerows(rows)
        return written.getvalue()

    # ------------------------------------------------------------------------ places of a tree

    def _replace(self, places: list[tuple[Any, Any]]) -> None:
        holder, key = self.choose(places)
        holder[key] = self.value()

    def _scale(self, places: list[tuple[Any, Any]]) -> None:
        numbers = [(h, k) for h, k in places if type(h[k]) in (int, float)]
        if numbers:
            holder, key = self.choose(numbers)
            holder[key] = holder[key] * self.choose((-1, 0, 0.1, 10.0, 1e-6, 1e6, 1e200))

    def _remove(self, places: list[tuple[Any, Any]]) -> None:
        holder, key = self.choose(places)
        del holder[key]

    def _rename(self, places: list[tuple[Any, Any]]) -> None:
        holder, key = self.choose(places)
        if isinstance(holder, dict):
            holder[self.choose((key[:-1] or "x", key + "s", *TEXTS))] = holder.pop(key)

    def _add(self, places: list[tuple[Any, Any]]) -> None:
        holder, _ = self.choose(places)
        if isinstance(holder, dict):
            known = [key for other, key in places if isinstance(other, dict)]
            holder[self.choose((*known, *TEXTS))] = self.value()
        else:
            holder.append(self.value())

    def _swap(self, places: list[tuple[Any, Any]]) -> None:
        (first, a), (second, b) = self.choose(places), self.choose(places)
        # copies, as one of the two may lie inside the other
        first[a], second[b] = copy.deepcopy(second[b]), copy.deepcopy(first[a])

    # ------------------------------------------------------------------------- parts of a table

    def _cell(self, rows: list[list[str]]) -> None:
        row = self.choose(rows)
        if row:
            row[int(self._chance.integers(len(row)))] = str(
                self.choose(self.choose((NUMBERS, TEXTS)))
            )

    def _number(self, rows: list[list[str]]) -> None:
        """Another number in the place of one."""
        row = self.choose(rows[1:] or rows)
        numbers = [k for k, cell in enumerate(row) if cell.replace(".", "", 1).isdigit()]
        if numbers:
            at = self.choose(numbers)
            row[at] = f"{float(row[at]) * self.choose((0.9, 0.98, 1.05, 1.2)):g}"

    def _row(self, rows: list[list[str]]) -> None:
        at = int(self._chance.integers(len(rows)))
        change: Callable[[], Any] = self.choose((
            lambda: rows.pop(at),
            lambda: rows.insert(at, [*rows[at]]),
            lambda: rows[at].append(str(self.value())),
            lambda: rows.__setitem__(slice(at, None), []),
            lambda: rows.append([*rows[0]]),
        ))  # fmt: skip
        change()

    def _column(self, rows: list[list[str]]) -> None:
        at, name = int(self._chance.integers(len(rows[0]))), str(self.choose(TEXTS))
        kind = self._chance.integers(4)
        for row in rows:
            cell = row[at] if at < len(row) else ""
            if kind == 0:
                del row[at : at + 1]
            elif kind == 1:
                row.append(cell)
            elif kind == 2:
                row[at : at + 1] = [name]
            else:
                row.insert(at, "")


def _places(tree: Any) -> Any:
    """Every value below, as what holds it and its key there."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in items:
        yield tree, key
        if isinstance(value, (dict, list)):
            yield from _places(value)
