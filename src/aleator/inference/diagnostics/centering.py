"""Two parameters that hardly differ because a condition lies far from zero, as in a + b T."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np
import pandas as pd

from aleator.inference.information import Inference
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.problem import Problem
from aleator.results.values import Diagnostic
from aleator.types import Array

CLOSE = 0.95
"""Correlation of two estimates from where on the advice is worth a warning."""
FAR = 3.0
"""Mean of a condition over its standard deviation from where on it lies far from zero."""
PROPORTIONAL = 0.01
"""Relative deviation of the ratio of two effects from a condition that still counts as one."""


def centering_warnings(
    problem: Problem, alpha: Array, inference: Inference, conditions: pd.DataFrame
) -> list[Diagnostic]:
    """Advice for pairs of parameters of which one acts as the other times a condition.

    `conditions` has a row for each of the N experiments. Slopes are those of the surfaces, or of a
    simulator that takes arrays, at the middle of the law. Nothing is said for collocation, whose
    slopes would cost runs.
    """
    if not problem.free:
        return []
    inputs = problem.model.inputs
    middle = inputs.marginal(alpha, np.full((1, len(inputs.names)), 0.5))
    slope = problem.response.evaluate_with_gradient(middle)[1][problem.condition, 0]
    return centering_advice(slope, inputs, problem.model.hyperparameters, inference, conditions)


def centering_advice(
    slope: Array,
    inputs: Inputs,
    hyperparameters: Sequence[Hyperparameter],
    inference: Inference,
    conditions: pd.DataFrame,
) -> list[Diagnostic]:
    """The same of slopes (M, n) of M simulated values by the parameters; a condition row each.

    In y = a + b T with T far from zero, a and b take each other's place; in a' + b (T - T0) with
    T0 in the middle they do not. None where laws follow covariates: their values are not in alpha.
    """
    if inputs.regressed:
        return []
    far = {
        str(name): column.to_numpy()
        for name, column in conditions.items()
        if pd.api.types.is_float_dtype(column) and _far(column.to_numpy())
    }
    found = []
    for i, j in _close(inputs, hyperparameters, inference):
        for a, b in ((i, j), (j, i)):
            for name, values in far.items():
                if _times(slope[:, b], slope[:, a], values):
                    found.append(_advice(inputs.names[a], inputs.names[b], name, values))
    return found


def _far(values: Array) -> bool:
    spread = float(values.std())
    return bool(np.all(np.isfinite(values)) and 0.0 < FAR * spread < abs(values.mean()))


def _times(effect: Array, other: Array, condition: Array) -> bool:
    """Whether one effect is the other times the condition and a constant, over all experiments."""
    wanted = other * condition
    size = float(wanted @ wanted)
    if size == 0.0:
        return False
    off = effect - (effect @ wanted) / size * wanted
    # as close as to the other alone would be no sign of the condition
    spread = float(condition.std() / abs(condition.mean()))
    closeness = min(PROPORTIONAL, 0.2 * spread)
    return bool(np.linalg.norm(off) < closeness * np.linalg.norm(effect))


def _close(
    inputs: Inputs, hyperparameters: Sequence[Hyperparameter], inference: Inference
) -> Iterator[tuple[int, int]]:
    """Pairs of parameters whose means or values are free, and hardly told apart."""
    where = {
        int(k): i
        for i, part in enumerate(inputs.slices)
        for k in inference.free
        if part.start <= k < part.stop and not hyperparameters[k].log
    }
    rows = [row for row, k in enumerate(inference.free) if int(k) in where]
    for p, q in combinations(rows, 2):
        i, j = where[int(inference.free[p])], where[int(inference.free[q])]
        if not inference.positive or abs(inference.correlation[p, q]) > CLOSE:
            yield i, j


def _advice(a: str, b: str, name: str, values: Array) -> Diagnostic:
    low, high = values.min(), values.max()
    middle = float(f"{0.5 * (low + high):.3g}")
    return Diagnostic(
        "identifiability",
        f"{b} acts as {a} times {name} does, and {name} ({low:.6g} to {high:.6g}) lies far from "
        f"zero, so that the experiments hardly tell {a} from {b}",
        f"count {name} from its middle: write ({name} - {middle:.6g}) for {name} in the simulator, "
        f"and set the limits of {a} anew, which then belongs to {name} = {middle:.6g}",
        (a, b, name),
    )
