"""How every task is asked: a simulator, the conditions that it runs under, and the defaults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import Any

import pandas as pd

from aleator.observations.experiments import Conditions, Experiments
from aleator.simulators import Runner, Simulator, as_runner

AnySimulator = Callable[..., Any] | Simulator | Runner
"""A function, another simulator, or a Runner, which has conditions, store and workers already."""
AnyTable = Experiments | Conditions | pd.DataFrame
"""Conditions with or without outcomes; a simulator is given the columns that it asks for."""


def runner_on(
    simulator: AnySimulator,
    table: AnyTable,
    parameters: Sequence[str],
    vectorized: bool = False,
    executor: Executor | None = None,
) -> Runner:
    """The runs of a simulator under the conditions of a table; a Runner as it is.

    >>> table = pd.DataFrame({"load": [1.0], "length": [2.1]})
    >>> runner_on(lambda load, x: load * x, table, ["x"])([0], [[2.0]])
    array([2.])
    """
    if isinstance(table, pd.DataFrame):
        table = Conditions.from_frame(table)
    return as_runner(simulator, table, parameters, vectorized, executor)
