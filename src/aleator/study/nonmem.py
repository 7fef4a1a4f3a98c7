"""A table of NONMEM's records (ID, TIME, DV, AMT, EVID, ...) as a table of experiments."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aleator.core.types import Array, Flags
from aleator.errors import ExperimentsError, count
from aleator.observations.tables import Table
from aleator.study.roles import Sheet

DOSES = "doses"
"""The condition that holds all doses of a subject, as a text in JSON."""
_NEEDED = ("ID", "TIME", "DV")
_RECORDS = ("AMT", "EVID", "MDV")
_CONTROL = (*_RECORDS, "RATE", "ADDL", "II", "SS", "C", "CMT", "DVID", "CENS", "LIMIT")
"""Columns that steer NONMEM: none of them is a column of the table of experiments."""
_BELOW = ("BLQ", "BQL", "BLOQ")
_LIMITS = ("LLOQ", "LOQ")
_DATES = ("DATE", "DAT1", "DAT2", "DAT3")

Dose = tuple[float, float, float, float]
"""Time, amount, rate and compartment of a dose."""


@dataclass(frozen=True)
class SubjectTable:
    """The observations of NONMEM's records, one row each, with the doses of their subject.

    `text` is the file of the table, `outcomes` and `id` are columns of it. `notes` say in words
    what became of the records.
    """

    text: str
    outcomes: tuple[str, ...]
    id: str
    notes: tuple[str, ...]


def has_records(table: Table) -> bool:
    """Whether the columns are those of NONMEM: ID, TIME, DV, and one of AMT, EVID and MDV.

    >>> has_records(Table("a.csv", {"id": ["1"], "time": ["0"], "dv": ["."], "amt": ["9"]}, ["r"]))
    True
    """
    names = {name.upper() for name in table.columns}
    joined = next(iter(names)).split() if len(names) == 1 else []
    if {*_NEEDED} <= {*joined}:
        raise ExperimentsError(
            f"{table.source}: row 1: the columns are separated by blanks",
            "separate the cells by commas",
        )
    return names >= {*_NEEDED} and bool(names & {*_RECORDS})


def subject_table(sheet: Sheet, names: Sequence[str]) -> SubjectTable:
    """The table of experiments of a table with NONMEM's records; a subject is an experiment.

    A record is a dose (EVID 1; without EVID an amount), an observation (EVID 0, MDV 0, a number in
    DV) or is left out. Of observations in several compartments (DVID, else CMT) each has a column.
    Doses become columns of the observations: `AMT` where each subject has one dose, with
    `AMT_TIME`, `AMT_RATE` and `AMT_CMT` where these say something; else `doses`, a list in JSON of
    the time and amount of each dose, with rate and compartment where these say something. Columns
    take the spelling of the simulator's `names`.

    Raises ExperimentsError, which names the row, for records that cannot be such a table: resets,
    steady states, modelled rates, dates, a subject in two places, and bounds without a limit.
    """
    records = _Records(sheet.table)
    doses = records.doses()
    alone = all(len(own) == 1 for own in doses.values())
    spelled = {name.lower(): name for name in names}
    if not alone and DOSES not in spelled:
        several = next(name for name, own in doses.items() if len(own) != 1)
        raise ExperimentsError(
            f"{sheet.table.source}: subject '{several}' has {len(doses[several])} doses, and the "
            f"simulator takes no condition '{DOSES}'",
            f"give it the argument {DOSES}: a text, of which json.loads makes a list of "
            "[time, amount]",
        )
    columns = records.columns(doses, alone, DOSES in spelled)
    called = {name: spelled.get(name.lower(), name) for name in columns}
    units = sheet.table.units
    heads = [f"{own} [{units[n]}]" if n in units else own for n, own in called.items()]
    kept = np.flatnonzero(records.measured)
    out = io.StringIO()
    writer = csv.writer(out, delimiter=sheet.delimiter, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows([cells[row] for cells in columns.values()] for row in kept)
    return SubjectTable(
        out.getvalue(),
        tuple(called[name] for name in records.outcomes),
        called[records.named["ID"]],
        tuple(records.notes(doses)),
    )


class _Records:
    """The records of a table: which are doses, which were measured, and what they say."""

    def __init__(self, table: Table) -> None:
        blank = {name: [t if t != "." else "" for t in table.texts(name)] for name in table.columns}
        self.table = replace(table, columns=blank)
        self.named = {name.upper(): name for name in table.columns}
        self.subject = self.table.texts(self.named["ID"])
        self.used = np.array([text.upper() != "C" for text in self._texts("C")])
        self.amount = self._numbers("AMT", 0.0)
        event = self._numbers("EVID", 0.0)
        without = "EVID" not in self.named
        self.dose: Flags = self.used & (self.amount != 0.0 if without else event == 1.0)
        value = self._numbers("DV", np.nan)
        seen = self.used & (event == 0.0) & (self._numbers("MDV", 0.0) == 0.0) & ~self.dose
        self._refuse(event)
        self.below = next((name for name in _BELOW if name in self.named), "")
        self.flagged: Flags = self._numbers(self.below, 0.0) == 1.0
        self.censored = self._numbers("CENS", 0.0)
        bounded = self.flagged | (self.censored != 0.0)
        self.measured: Flags = seen & (np.isfinite(value) | bounded)
        self.before = self._before_doses()
        self.unmeasured = int(np.sum(seen & ~self.measured))
        self.other = int(np.sum(self.used & ~seen & ~self.dose))
        self.cells, self.upper = self._cells(value)
        which = "DVID" if "DVID" in self.named else "CMT"
        self.response = self._texts(which)
        there = [*dict.fromkeys(np.array(self.response)[self.measured].tolist())]
        head = self.named["DV"]
        self.outcomes = tuple(f"{head}_{text}" for text in there) if len(there) > 1 else (head,)
        if not self.measured.any():
            raise ExperimentsError(
                f"{table.source}: no record is an observation",
                "an observation has EVID 0, MDV 0 and a number in DV",
            )

    def doses(self) -> dict[str, list[Dose]]:
        """The doses of each subject, in order, with the additional ones of ADDL and II."""
        time, rate = self._numbers("TIME", np.nan), self._numbers("RATE", 0.0)
        more, apart = self._numbers("ADDL", 0.0), self._numbers("II", 0.0)
        where = self._numbers("CMT", 1.0)
        found: dict[str, list[Dose]] = {
            self.subject[row]: [] for row in np.flatnonzero(self.measured)
        }
        for row in np.flatnonzero(self.dose):
            for k in range(1 + max(int(more[row]), 0)):
                one = (time[row] + k * apart[row], self.amount[row], rate[row], where[row])
                found.get(self.subject[row], []).append(one)
        return {name: sorted(own) for name, own in found.items()}

    def columns(
        self, doses: dict[str, list[Dose]], alone: bool, listed: bool
    ) -> dict[str, list[str]]:
        """The cells of each column of the table of experiments, for all records."""
        names = [self.named[name] for name in _NEEDED[:2]]
        columns = {name: self.table.texts(name) for name in names}
        for name in self.outcomes:
            own = [len(self.outcomes) == 1 or name == f"{self.named['DV']}_{text}"
                   for text in self.response]  # fmt: skip
            for head, cells in ((name, self.cells), (f"{name}_upper", self.upper)):
                if any(cells):
                    columns[head] = [t if mine else "" for t, mine in zip(cells, own, strict=True)]
        control = (*_NEEDED, *_CONTROL, *_BELOW, *_LIMITS)
        columns |= {
            name: self.table.texts(name)
            for upper, name in self.named.items()
            if upper not in control
        }
        every = [dose for own in doses.values() for dose in own]
        telling = {"AMT": True, "AMT_TIME": any(dose[0] != 0.0 for dose in every),
                   "AMT_RATE": any(dose[2] != 0.0 for dose in every),
                   "AMT_CMT": len({dose[3] for dose in every}) > 1}  # fmt: skip
        if alone:
            for head, part in (("AMT", 1), ("AMT_TIME", 0), ("AMT_RATE", 2), ("AMT_CMT", 3)):
                if telling[head]:
                    one = {name: f"{own[0][part]:.15g}" for name, own in doses.items()}
                    columns[head] = [one.get(subject, "") for subject in self.subject]
        if listed or not alone:
            most = 4 if telling["AMT_CMT"] else 3 if telling["AMT_RATE"] else 2
            text = {name: json.dumps([d[:most] for d in own]) for name, own in doses.items()}
            columns[DOSES] = [text.get(subject, "") for subject in self.subject]
        return columns

    def notes(self, doses: dict[str, list[Dose]]) -> Iterator[str]:
        """What became of the records, in words."""
        given = sum(map(len, doses.values()))
        yield (
            f"NONMEM records: {count(int(self.measured.sum()), 'observation')} and "
            f"{count(given, 'dose')} of {count(len(doses), 'subject')}"
        )
        rows = np.flatnonzero(self.measured)
        if bounds := sum(self.cells[row][0] in "<>" or self.upper[row] != "" for row in rows):
            yield f"censored observations: {bounds}"
        if self.before:
            yield (
                f"observations before a dose at the same time: {self.before}; the simulator must "
                "count a dose only after its time, t < time"
            )
        if left := self.unmeasured + self.other + int(np.sum(~self.used)):
            yield f"left out: {left} records without a measured value"

    def _before_doses(self) -> int:
        """The number of observations that a dose at the same time follows.

        Raises ExperimentsError if other observations follow a dose at the same time: the table of
        experiments has the times, and not the order of the records.
        """
        time = self._numbers("TIME", np.nan)
        given: dict[tuple[str, float], list[int]] = {}
        for row in np.flatnonzero(self.dose):
            given.setdefault((self.subject[row], time[row]), []).append(int(row))
        before, after = np.zeros(len(time), dtype=bool), np.zeros(len(time), dtype=bool)
        for row in np.flatnonzero(self.measured):
            doses = given.get((self.subject[row], time[row]), [])
            before[row] = any(dose > row for dose in doses)
            after[row] = any(dose < row for dose in doses)
        if after.any():
            self._none(
                before, "TIME",
                "is the time of a dose that follows, and other observations follow their dose",
                "write a time shortly before the dose",
            )  # fmt: skip
        return int(before.sum())

    def _cells(self, value: Array) -> tuple[list[str], list[str]]:
        """The cell of the outcome in each record, and the upper end of an interval or ""."""
        signs, bounds = self._bounds(value)
        measured, lower = self.table.texts(self.named["DV"]), self._texts("LIMIT")
        between = [sign == "<" and text != "" for sign, text in zip(signs, lower, strict=True)]
        cells = [
            low if inside else f"{sign}{bound or text}"
            for inside, low, sign, bound, text in zip(
                between, lower, signs, bounds, measured, strict=True
            )
        ]
        return cells, [t if inside else "" for inside, t in zip(between, measured, strict=True)]

    def _bounds(self, value: Array) -> tuple[list[str], list[str]]:
        """The sign of each censored observation ("<" or ">", else ""), and its bound if told."""
        signs = np.where(self.censored == 1.0, "<", np.where(self.censored == -1.0, ">", ""))
        signs = np.where(self.flagged, "<", signs)
        self._none(
            self.measured & ~np.isin(self.censored, [-1.0, 0.0, 1.0]), "CENS",
            "is none of -1, 0 and 1", "write 1 for a value below DV, -1 for one above it",
        )  # fmt: skip
        self._none(
            self.measured & np.isnan(value) & (self.censored != 0.0), "DV",
            "is blank, and CENS says that it is a bound", "write the limit",
        )  # fmt: skip
        limit = next((name for name in _LIMITS if name in self.named), "DV")
        numbers = self._numbers(limit, np.nan)
        self._none(
            self.measured & self.flagged & ~(np.isfinite(numbers) & (numbers != 0.0)), self.below,
            "is 1, and nothing says below which limit the value is",
            "add a column LLOQ with the limit of quantification",
        )  # fmt: skip
        limits = zip(self.flagged, self._texts(limit), strict=True)
        bound = [text if own else "" for own, text in limits]
        left = self.measured & (signs == "<")
        told = np.array([text != "" for text in self._texts("LIMIT")])
        self._none(
            left & ~told if (left & told).any() else left & False, "LIMIT",
            "is blank, and other records below a limit have one",
            "write a number into LIMIT of all records with CENS 1, or of none",
        )  # fmt: skip
        return signs.tolist(), bound

    def _refuse(self, event: Array) -> None:
        """Raise ExperimentsError for records that a table of experiments cannot say."""
        self._none(
            self.used & np.isin(event, [3.0, 4.0]), "EVID", "resets the subject",
            "give what follows the reset an ID of its own",
        )  # fmt: skip
        self._none(
            self.used & ~np.isin(event, [0.0, 1.0, 2.0]), "EVID", "is none of 0, 1 and 2",
            "write 1 for a dose, 0 for an observation, 2 for any other event",
        )  # fmt: skip
        self._none(
            self.used & ~self.dose & (self.amount != 0.0) & (event == 0.0), "EVID",
            "is 0, and the record has an amount", "write EVID 1 for a dose",
        )  # fmt: skip
        self._none(
            self.dose & (self._numbers("SS", 0.0) != 0.0), "SS", "asks for a steady state",
            "write the doses out that lead to it: ADDL and II",
        )  # fmt: skip
        self._none(
            self.dose & (self._numbers("RATE", 0.0) < 0.0), "RATE", "asks for a modelled rate",
            "let the simulator compute the infusion, and leave RATE out",
        )  # fmt: skip
        self._none(
            self.dose & (self._numbers("ADDL", 0.0) > 0.0) & ~(self._numbers("II", 0.0) > 0.0),
            "ADDL", "adds doses, and II does not say how far apart", "write the interval into II",
        )  # fmt: skip
        for name in _DATES:
            self._none(
                np.full(len(event), name in self.named), name, "is a date",
                "write into TIME what has passed, in hours or days, and delete the dates",
            )  # fmt: skip
        time = self._numbers("TIME", np.nan)
        self._none(self.used & np.isnan(time), "TIME", "is blank", "write a number")
        again, seen = np.zeros(len(event), dtype=bool), set[str]()
        for row, name in enumerate(self.subject):
            again[row] = name in seen and name != self.subject[row - 1]
            seen.add(name)
        self._none(
            again, "ID", "ended further up: NONMEM takes it for another subject",
            "give each subject an ID of its own, or put its records together",
        )  # fmt: skip

    def _none(self, rows: Flags, column: str, problem: str, remedy: str) -> None:
        """Raise ExperimentsError, which names the first of the rows, unless there is none."""
        if np.any(rows):
            place = self.table.where(int(np.argmax(rows)), self.named.get(column, column))
            raise ExperimentsError(f"{place} {problem}", remedy)

    def _texts(self, name: str) -> list[str]:
        return self.table.texts(self.named[name]) if name in self.named else [""] * len(self.table)

    def _numbers(self, name: str, blank: float) -> Array:
        """The numbers of a column; `blank` for blank cells, and everywhere if it is missing."""
        if name not in self.named:
            return np.full(len(self.table), blank)
        numbers = self.table.numbers_or_blank(self.named[name])
        return np.where(np.isnan(numbers), blank, numbers)
