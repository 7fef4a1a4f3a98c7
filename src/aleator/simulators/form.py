"""From what a simulator returned to an array of values, checked against what was asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aleator.errors import SimulatorError, nearest
from aleator.observations.tables import real_numbers
from aleator.simulators.cases import Cases
from aleator.simulators.protocol import Simulator
from aleator.simulators.units import Units
from aleator.types import Array, Flags, Indices

Answer = float | Array | Mapping[str, Any]
"""What one run returned: a number, an array (m,) of a series, or one of them for each response."""


@dataclass(frozen=True, eq=False)
class Form:
    """The values (R, W) that R runs are to return: of each row one of each of the `responses`.

    `rows` (R,) says how many rows a run serves, `experiments` (R,) names them; None where every run
    is one row. `observed` (R, W) are the values that must be finite; None is all of them.
    """

    responses: tuple[str, ...] = ("",)
    width: int = 1
    rows: Indices | None = None
    observed: Flags | None = None
    experiments: NDArray[np.object_] | None = None

    @classmethod
    def of(cls, units: Units, cases: Cases, ids: Sequence[str]) -> Form:
        """The form of one run of each case, in their order."""
        observed = np.zeros((len(cases), units.width), dtype=np.bool_)
        observed[cases.condition[units.unit], units.column] = True
        experiments = np.array(ids, dtype=object)[units.experiment[cases.first]]
        return cls(
            units.names,
            units.width,
            units.rows[cases.first] if units.series else None,
            None if np.all(observed) else observed,
            experiments if units.series else None,
        )

    def some(self, rows: slice | Indices) -> Form:
        """The form of some of the runs."""
        if self.rows is None and self.observed is None:
            return self
        return replace(
            self,
            rows=None if self.rows is None else self.rows[rows],
            observed=None if self.observed is None else self.observed[rows],
            experiments=None if self.experiments is None else self.experiments[rows],
        )

    def missing(self, values: Array) -> Flags:
        """(R, W) which values are wanted and not finite."""
        wrong = ~np.isfinite(values)
        return wrong if self.observed is None else wrong & self.observed

    def fault(self, run: int, column: int, value: float) -> str:
        """What is said of a value that is not finite.

        >>> Form(("speed", "time"), 4, np.array([2])).fault(0, 3, np.nan)
        'it returned nan for time in row 2 of 2'
        """
        response = self.responses[column % len(self.responses)]
        named = f" for {response}" if len(self.responses) > 1 else ""
        row = column // len(self.responses) + 1
        placed = "" if self.rows is None else f" in row {row} of {self.rows[run]}"
        return f"it returned {value:g}{named}{placed}"

    def shaped(self, simulator: Simulator, returned: Any, count: int) -> Array:
        """Values (count, W) of the first `count` runs, NaN where a run has fewer.

        `returned` is an array (count,) of numbers, a mapping from responses to such arrays, or a
        list of answers. Raises SimulatorError for a wrong shape or type, a response that is not
        there, and a series of the wrong length.
        """
        if not count:
            return np.empty((0, self.width))
        if self.rows is not None and not isinstance(returned, Mapping):
            returned = [*returned]
        if isinstance(returned, list):
            return self._listed(simulator, returned)
        if isinstance(returned, Mapping):
            parts = [_numbers(simulator, part, count) for part in self._of(simulator, returned)]
            return np.stack(parts, axis=1)
        if len(self.responses) > 1 and np.shape(returned) == (count,):
            raise self._unnamed(simulator, "one number a run")
        return _numbers(simulator, returned, count)[:, None]

    def _listed(self, simulator: Simulator, answers: Sequence[Answer]) -> Array:
        values = np.full((len(answers), self.width), np.nan)
        for k, answer in enumerate(answers):
            if isinstance(answer, Mapping):
                parts = self._of(simulator, answer)
            elif len(self.responses) == 1:
                parts = [answer]
            else:
                raise self._unnamed(simulator, "an array" if np.ndim(answer) else "one number")
            size = len(self.responses)
            rows = 1 if self.rows is None else int(self.rows[k])
            for j, part in enumerate(parts):
                if np.ndim(part) and np.shape(part) != (rows,):
                    raise self._wrong_length(simulator, k, j, np.shape(part)[0], rows)
                number = part if isinstance(part, float) else _real(simulator, part)
                values[k, j : rows * size : size] = number
        return values

    def _of(self, simulator: Simulator, answer: Mapping[str, Any]) -> list[Any]:
        """The parts of an answer in the order of the responses."""
        for name in self.responses:
            if name not in answer:
                raise SimulatorError(
                    f"simulator '{simulator.name}' returned no "
                    f"'{name}'{nearest(name, [*answer])}; it returned "
                    + (", ".join(map(str, answer)) or "nothing"),
                    "let it return what the table measures, by the names of the responses",
                )
        return [answer[name] for name in self.responses]

    def _unnamed(self, simulator: Simulator, got: str) -> SimulatorError:
        return SimulatorError(
            f"simulator '{simulator.name}' returned {got}, but the table has the responses "
            + ", ".join(self.responses),
            "let it return a mapping: {"
            + ", ".join(f'"{name}": ...' for name in self.responses)
            + "}",
        )

    def _wrong_length(
        self, simulator: Simulator, run: int, response: int, got: int, rows: int
    ) -> SimulatorError:
        name = self.responses[response]
        named = f" of {name}" if len(self.responses) > 1 else ""
        where = f" for experiment '{self.experiments[run]}'" if self.experiments is not None else ""
        return SimulatorError(
            f"simulator '{simulator.name}' returned {got} values{named}{where}, which has {rows} "
            f"rows: expected an array of shape ({rows},)",
            "let it return one value for each row of the experiment, in their order, or one number "
            "for all of them",
        )


def is_named(returned: Any) -> bool:
    """Whether the values came with the names of their responses."""
    first = returned[0] if isinstance(returned, list) and returned else returned
    return isinstance(first, Mapping)


def _numbers(simulator: Simulator, returned: object, count: int) -> Array:
    shape = np.shape(np.asanyarray(returned))
    if shape != (count,):
        kind = type(returned).__name__
        got = f"{kind} of shape {shape}" if shape else f"a single {kind}"
        raise SimulatorError(
            f"simulator '{simulator.name}' returned {'None' if returned is None else got} "
            f"for {count} runs, expected an array of shape ({count},)",
            "set vectorized = false if it computes one run at a time (as float() and the "
            "functions of math do); else let it return one number a run",
        )
    return _real(simulator, returned)


def _real(simulator: Simulator, part: object) -> Array:
    try:
        return real_numbers(part)
    except TypeError as error:
        raise SimulatorError(
            f"simulator '{simulator.name}' returned {error}", "let it return real numbers"
        ) from None
