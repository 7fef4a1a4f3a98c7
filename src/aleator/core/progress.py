"""The interface by which a long computation reports its progress."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from typing import Protocol


@dataclass(frozen=True)
class RunsAhead:
    """How many `runs` in all are expected until the error of the estimates is `error`.

    `error` is in standard errors; `seconds` is the time until then. Both are infinite or NaN where
    they are unknown.
    """

    error: float
    runs: float
    seconds: float


@dataclass(frozen=True)
class Standing:
    """Where a maximization of the likelihood stands after a number of runs.

    `error` is the error of the estimates that an emulator in place of the simulator causes, in
    standard errors; None where it has not been computed, or there is no emulator. `value_error` is
    that of the log-likelihood, where it is too large; else None. `most` are the conditions, if some
    do, that cause more than half of the error.

    >>> now = Standing(120, -31.42, {"v.mean": 1.0}, 0.35, (RunsAhead(0.2, 180, 50.0),))
    >>> print(now)
    120 runs, log-likelihood -31.42, error of the estimates 0.35 standard errors; expected: 180
    runs (50 s more) for 0.2
    """

    runs: int
    log_likelihood: float
    alpha: Mapping[str, float]
    error: float | None = None
    ahead: tuple[RunsAhead, ...] = ()
    value_error: float | None = None
    most: str | None = None

    def __str__(self) -> str:
        parts = [f"{self.runs:,} runs", f"log-likelihood {self.log_likelihood:.2f}"]
        return ", ".join([*parts, *([self.outlook] if self.outlook else [])])

    @property
    def outlook(self) -> str:
        """The error of the estimates, and the runs that are expected, as text; may be empty."""
        if self.error is None:
            return ""
        text = f"error of the estimates {self.error:.2g} standard errors"
        if self.value_error is not None:
            text += f", of the log-likelihood {self.value_error:.2g}"
        if self.most is not None:
            text += f", most of it at {self.most}"
        return f"{text}; expected: {self.forecast}" if self.forecast else text

    @property
    def forecast(self) -> str:
        """The runs that are expected for each error that is not reached, as text."""
        parts = []
        for goal in self.ahead:
            if self.runs < goal.runs < math.inf:
                more = f" ({duration(goal.seconds)} more)" if math.isfinite(goal.seconds) else ""
                parts.append(f"{goal.runs:,.0f} runs{more} for {goal.error:g}")
        return ", ".join(parts)


class Progress(Protocol):
    """Receives reports on the progress of a computation, which has one named stage after the other.

    The methods return at once and do not change the result. They raise no exception except, like
    any line of Python, KeyboardInterrupt.
    """

    def stage(self, name: str) -> None:
        """Begin the stage `name`, such as "search"; the stage before it is complete."""

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Report `text` about the present stage, with `done` of `total` steps made, if known."""

    def reached(self, standing: Standing) -> None:
        """Report where the maximization of the likelihood stands, after a round or a search."""


def duration(seconds: float) -> str:
    """A duration as a short text, in seconds, minutes or hours.

    >>> duration(50.0), duration(600.0), duration(9000.0)
    ('50 s', '10 min', '2.5 h')
    """
    minute, hour = (timedelta(**{unit: 1}).total_seconds() for unit in ("minutes", "hours"))
    if seconds < 1.5 * minute:
        return f"{seconds:.0f} s"
    return f"{seconds / minute:.0f} min" if seconds < 1.5 * hour else f"{seconds / hour:.1f} h"


class Silent:
    """A progress receiver that ignores all reports: the default of functions with this argument.

    >>> Silent().stage("search")
    >>> Silent().update("start 3 of 10", done=3, total=10)
    """

    def stage(self, name: str) -> None:
        """Ignore the beginning of a stage."""

    def update(self, text: str, done: float | None = None, total: float | None = None) -> None:
        """Ignore a report of progress."""

    def reached(self, standing: Standing) -> None:
        """Ignore where the maximization stands."""
