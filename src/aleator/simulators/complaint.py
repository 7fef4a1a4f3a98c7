"""What a user is told about runs without an outcome: which, why, and what to narrow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.errors import SimulatorError
from aleator.simulators.failure import NoOutcome
from aleator.simulators.workers.work import Failure
from aleator.types import Array, Indices


@dataclass(frozen=True, eq=False)
class Tried:
    """Runs of experiments `index` (R,) at `x` (R, n): `outcome` (R,) and `failures` by row."""

    index: Indices
    x: Array
    outcome: Array
    failures: Mapping[int, Failure]

    @property
    def good(self) -> NDArray[np.bool_]:
        """(R,) which have an outcome."""
        return ~np.isin(np.arange(len(self.index)), list(self.failures))


@dataclass(frozen=True, eq=False)
class Complaint:
    """Messages in the words of the user: names, ids and values instead of positions."""

    simulator: str
    vectorized: bool
    ids: Sequence[str]
    parameters: Sequence[str]
    conditions: Mapping[str, NDArray[Any]]

    def first(self, tried: Tried) -> SimulatorError:
        """The first failure, for whoever needs every run."""
        row = min(tried.failures)
        failure = tried.failures[row]
        at, x = int(tried.index[row]), tried.x[row]
        if failure.kind == "NotFinite":
            return self._not_finite(tried, row)
        if failure.kind == "TypeError" and self.vectorized:
            return SimulatorError(
                f"simulator '{self.simulator}' is called with arrays, because vectorized is "
                f"true, and raised for any number of runs: {failure.message}",
                "set vectorized = false if it computes one run at a time (as float() and the "
                "functions of math do); else let it take arrays, with the functions of numpy",
            )
        what, who = (
            ("failed", "simulator") if failure.kind == "RunFailed" else ("raised", "function")
        )
        return NoOutcome(
            f"simulator '{self.simulator}' {what} for experiment '{self.ids[at]}' with "
            f"{self.at(x)}: {_told(failure)}",
            f"mend the {who} for the conditions {self.values(at)}{self._texts()}",
            x[None, :],
            tried.index[[row]],
        )

    def too_many(self, tried: Tried, failed: int, asked: int) -> SimulatorError:
        """Too large a share of all runs failed for a surface through the others."""
        row = min(tried.failures)
        failure, at = tried.failures[row], int(tried.index[row])
        mine = tried.index == at
        hint = self.separating(tried.x[mine], tried.good[mine])
        if failed == asked:
            hint = "mend the simulator: no run of it worked"
        return NoOutcome(
            f"simulator '{self.simulator}': {failed:,} of {asked:,} runs failed, too many to go "
            f"on; the first for experiment '{self.ids[at]}' with {self.at(tried.x[row])}: "
            f"{_told(failure)}",
            (hint or f"narrow the box or the bounds of {' or '.join(self.parameters)}")
            + f"; or check the conditions of the experiment: {self.values(at)}{self._texts()}",
            tried.x[~tried.good],
            tried.index[~tried.good],
        )

    def at(self, x: Array) -> str:
        """Parameters by name."""
        return ", ".join(f"{name}={v:.6g}" for name, v in zip(self.parameters, x, strict=True))

    def values(self, at: int) -> str:
        """Conditions of an experiment by name."""
        cells = {name: column[at] for name, column in self.conditions.items()}
        return ", ".join(
            f"{name}={v:.6g}" if isinstance(v, float) else f"{name}={v!r}"
            for name, v in cells.items()
        )

    def separating(self, x: Array, good: NDArray[np.bool_]) -> str:
        """Words for a parameter whose one end fails throughout, if there is one."""
        for k, name in enumerate(self.parameters):
            fails, works = x[~good, k], x[good, k]
            if len(works) and fails.min() > works.max():
                return f"narrow the box or the bounds of {name} from above, to {works.max():.6g}"
            if len(works) and fails.max() < works.min():
                return f"narrow the box or the bounds of {name} from below, to {works.min():.6g}"
        return ""

    def _not_finite(self, tried: Tried, row: int) -> SimulatorError:
        raw, at, good = tried.outcome[row], int(tried.index[row]), tried.good
        what = f"{raw:g}" + (", which has no logarithm," if np.isfinite(raw) else "")
        mine = tried.index == at
        hint = self.separating(tried.x[mine], good[mine])
        return NoOutcome(
            f"simulator '{self.simulator}' returned {what} for experiment '{self.ids[at]}' "
            f"with {self.at(tried.x[row])}: {np.sum(~good)} of {len(good)} runs failed so, "
            f"in {len(set(tried.index[~good].tolist()))} of {len(self.ids)} experiments",
            (hint or f"narrow the box or the bounds of {' or '.join(self.parameters)}")
            + f"; or check the conditions of the experiment: {self.values(at)}",
            tried.x[~good],
            tried.index[~good],
        )

    def _texts(self) -> str:
        text = [name for name, column in self.conditions.items() if column.dtype == object]
        return f"; {', '.join(text)} is text in the table" if text else ""


def _told(failure: Failure) -> str:
    last = " ".join((failure.log or "").split())[-300:]
    return f"{failure.message}; its log ends: {last}" if last else failure.message
