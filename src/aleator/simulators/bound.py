"""A simulator and what its runs are asked by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.simulators.cases import Cases
from aleator.simulators.form import Form
from aleator.simulators.protocol import Columns, Simulator
from aleator.types import Array, Indices

ONE = Form()


@dataclass(frozen=True, eq=False)
class Bound:
    """A simulator with the cases of a table, and with names for the n columns of x.

    `form` is what one run of each case returns.

    >>> from aleator.simulators.function import FunctionSimulator
    >>> cases = Cases.of({"load": np.array([1.0, 2.0])}, 2)
    >>> bound = Bound(FunctionSimulator(lambda load, x: load * x), cases, ("x",))
    >>> bound.columns(np.array([1, 1]), np.array([[0.5], [0.7]]))
    ({'load': array([2., 2.])}, {'x': array([0.5, 0.7])})
    """

    simulator: Simulator
    cases: Cases
    parameters: tuple[str, ...]
    form: Form = ONE

    def columns(self, case: Indices, x: Array) -> tuple[Columns, Columns]:
        """Conditions and parameters of runs of `case` (R,) at x (R, n), by name."""
        columns = np.asarray(x, dtype=np.float64).T.copy()
        return self.cases.at(case), dict(zip(self.parameters, columns, strict=True))
