"""How every task is asked: a simulator, the conditions that it runs under, and the defaults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

import pandas as pd

from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.observations.experiments import Conditions, Experiments
from aleator.search import GradientMultistart
from aleator.simulators import Runner, Simulator, as_runner
from aleator.surrogates import ResponseSurface

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation

AnySimulator = Callable[..., Any] | Simulator | Runner
"""A function, another simulator, or a Runner, which has conditions, store and workers already."""
AnyTable = Experiments | Conditions | pd.DataFrame
"""Conditions with or without outcomes; a simulator is given the columns that it asks for."""

DEFAULT_PROPAGATION = ResponseSurface()
DEFAULT_SEARCH = GradientMultistart()


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


def require_enough(table: Experiments, hyperparameters: Sequence[Hyperparameter]) -> None:
    """Raise InputsError where there are fewer observations than hyperparameters to identify."""
    free, count = sum(h.free for h in hyperparameters), len(table.observations)
    if count < free:
        raise InputsError(
            f"{count} observations of {len(table.ids)} experiments cannot identify {free} "
            "hyperparameters",
            "fix some hyperparameters, or add experiments (ten for each is a start)",
        )


def surfaces_alone(
    propagation: ResponseSurface | Collocation, density: Density | None
) -> ResponseSurface:
    """The choice of surfaces of a likelihood over individual parameters.

    Raises InputsError for what only the density of an exact outcome has: the density itself,
    collocation, a surface of all experiments, and nodes of the law.
    """
    if density is not None:
        raise _of_exact_outcomes(f"the density ({density.name})", "[density]")
    if not isinstance(propagation, ResponseSurface):
        raise _of_exact_outcomes('method = "collocation"', "[propagation] method")
    if propagation.surfaces == "shared":
        raise _of_exact_outcomes('surfaces = "shared"', "[propagation] surfaces")
    if propagation.nodes is not None:
        raise _of_exact_outcomes("`nodes` of the law", "[propagation] nodes")
    return propagation


def _of_exact_outcomes(what: str, key: str) -> InputsError:
    return InputsError(
        f"{what} is for one exact outcome an experiment, without measurement noise",
        f"leave {key} out: with noise the likelihood is an integral over each experiment's own "
        "parameters",
    )
