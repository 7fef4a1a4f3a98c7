"""Design matrices: a formula of covariates as columns, one for each coefficient."""

from __future__ import annotations

import re
import warnings
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from aleator.errors import InputsError, nearest
from aleator.types import Array, Flags

if TYPE_CHECKING:
    from formulaic import ModelMatrix

Table = pd.DataFrame
"""Covariates: a row for each experiment, named by the index."""
LEVEL = re.compile(r"(?:C\((\w+)\)|\b(\w+))\[(?:T\.)?([^\]]*)\]")
"""A level as formulaic names its column: C(supplier)[T.b], supplier[T.b], C(supplier)[b]."""
DEPENDENT = 1e-9
"""A column is a sum of the ones before it where less than this share of it is left."""


@dataclass(frozen=True, eq=False)
class Design:
    """The columns (N, p) of a formula for N experiments, and the names of their coefficients.

    `state` is what the formula learned of the table that it was made of: levels, means of
    `center(...)`, knots of splines.
    """

    formula: str
    names: tuple[str, ...]
    matrix: Array
    state: Any

    @classmethod
    def of(cls, formula: str, covariates: Table) -> Design:
        """The formula on the covariates (N rows, named by their experiments).

        Raises InputsError for a formula that cannot be read, an unknown name, a missing value, a
        level that only one experiment has, and columns of which one is a sum of others.

        >>> table = pd.DataFrame({"t": [0.0, 1.0, 2.0, 3.0], "by": ["a", "a", "b", "b"]})
        >>> design = Design.of("1 + t + C(by)", table)
        >>> design.names, design.matrix[2].tolist()
        (('Intercept', 't', 'by=b'), [1.0, 2.0, 1.0])
        """
        require_complete(formula, covariates)
        found = _columns(formula, _parsed(formula), covariates)
        design = cls(formula, named(found), np.asarray(found, dtype=float), found.model_spec)
        _require_levels(design, covariates)
        _require_independent(design)
        return design

    def at(self, covariates: Table) -> Design:
        """The same formula, with what it learned, on the covariates of other experiments.

        Raises InputsError for a level that it has not met.
        """
        require_complete(self.formula, covariates)
        found = _columns(self.formula, self.state, covariates)
        return Design(self.formula, self.names, np.asarray(found, dtype=float), self.state)

    @property
    def base(self) -> Flags:
        """Which columns (p,) add up to one: the intercept, or the levels that stand for it."""
        ones = np.ones(len(self.matrix))
        share = np.linalg.lstsq(self.matrix, ones)[0]
        spanned = np.allclose(self.matrix @ share, ones)
        return np.asarray(spanned & (np.abs(share - 1.0) < 1e-6))


def variables(formula: str, owner: str = "") -> tuple[str, ...]:
    """The columns of the table that a formula names, in order; messages name its owner.

    >>> variables("1 + log(temperature) + C(supplier)")
    ('supplier', 'temperature')
    """
    try:
        return tuple(sorted(_required(_parsed(formula))))
    except InputsError as error:
        of = f"{owner} = " if owner else ""
        raise InputsError(f"{of}{error.problem}", error.remedy) from None


def _required(of: Any) -> set[str]:
    """The columns that a parsed formula names."""
    from formulaic import SimpleFormula
    from formulaic.transforms import TRANSFORMS
    from formulaic.utils.variables import Variable, get_required_variables

    found = set(map(str, of.required_variables))
    if isinstance(of, SimpleFormula):
        # formulaic leaves out what center(...), poly(...) and bs(...) are called with
        for factor in (factor for term in of for factor in term.factors):
            if factor.eval_method is not factor.EvalMethod.PYTHON:
                continue
            with suppress(SyntaxError):  # told when the formula is evaluated
                there = get_required_variables(factor.expr)
                found |= {str(v.root) for v in there if Variable.Role.VALUE in v.roles}
    return found - set(TRANSFORMS)


def named(columns: ModelMatrix) -> tuple[str, ...]:
    """Names of coefficients as they are read aloud: ``supplier=b`` for C(supplier)[T.b]."""

    def aloud(level: re.Match[str]) -> str:
        return f"{level[1] or level[2]}={level[3].removesuffix('.0')}"

    return tuple(LEVEL.sub(aloud, str(name)) for name in columns.columns)


def require_complete(formula: str, covariates: Table) -> None:
    """Raise InputsError for a name that is no column, and for a cell that is empty."""
    columns = [str(name) for name in covariates.columns]
    for name in variables(formula):
        if name not in columns:
            raise InputsError(
                f"'{formula}' names '{name}', which is no column of the table"
                f"{nearest(name, columns)}",
                f"name one of {', '.join(columns) or 'none: the table has no such columns'}",
            )
        empty = np.flatnonzero(covariates[name].isna())
        if empty.size:
            raise InputsError(
                f"'{formula}': experiment '{covariates.index[empty[0]]}' has no {name}",
                "give its value, or leave the experiment out",
            )


def _parsed(formula: str) -> Any:
    # imported where formulas are asked for: it takes half as long as all else together
    from formulaic import Formula
    from formulaic.errors import FormulaicError

    try:
        return Formula(formula)
    except FormulaicError as error:
        raise _unreadable(formula, error) from None


def _columns(formula: str, of: Any, covariates: Table) -> ModelMatrix:
    """The columns of a formula, or of one that learned its state elsewhere."""
    from formulaic import ModelMatrix
    from formulaic.errors import DataMismatchWarning, FormulaicError

    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("error", DataMismatchWarning)
            found = of.get_model_matrix(covariates, na_action="raise", context={})
    except DataMismatchWarning as error:
        level = re.search(r"\{(.*?)\}", str(error))
        raise InputsError(
            f"'{formula}': the level {level[1] if level else ''} is not among those that the law "
            "was identified with",
            "its coefficient is not known; use a level that the experiments have",
        ) from None
    except (FormulaicError, ValueError) as error:
        raise _unreadable(formula, error) from None
    if not isinstance(found, ModelMatrix):
        raise InputsError(
            f"'{formula}' has more than one side", 'write one side only: "1 + temperature"'
        )
    if not found.shape[1]:
        raise InputsError(f"'{formula}' has no terms", 'write "1" for a value without covariates')
    finite = np.isfinite(np.asarray(found, dtype=float)).all(axis=1)
    if not finite.all():
        raise InputsError(
            f"'{formula}' has no value for experiment '{covariates.index[int(np.argmin(finite))]}'",
            "correct the covariates, or take a function that has a value for all of them",
        )
    return found


def _unreadable(formula: str, error: Exception) -> InputsError:
    text = re.sub(r"\x1b\[[0-9;]*m|⧛.*", "", str(error)).strip().splitlines()
    cause = text[0] if text else "it has no terms"
    return InputsError(
        f"'{formula}' is no formula of covariates: {cause}",
        'write terms with + between them, such as "1 + temperature + C(supplier)"',
    )


def _require_levels(design: Design, covariates: Table) -> None:
    """Raise where a level is that of one experiment: nothing tells its coefficient from scatter."""
    for factor, (kind, _) in design.state.encoder_state.items():
        if kind.value != "categorical":
            continue
        name = re.sub(r"^C\((\w+).*\)$", r"\1", str(factor))
        if name not in covariates.columns:
            continue
        counts = covariates[name].value_counts()
        for level in counts.index[counts == 1]:
            alone = covariates.index[covariates[name] == level][0]
            raise InputsError(
                f"'{design.formula}': experiment '{alone}' is the only one with {name} = {level}, "
                "so that the level cannot be told from the scatter between experiments",
                f"leave the experiment out, or join its {name} with another",
            )


def _require_independent(design: Design) -> None:
    """Raise where a column is a sum of those before it."""
    basis = np.empty((len(design.matrix), 0))
    for k, name in enumerate(design.names):
        column = design.matrix[:, k]
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        size = float(np.linalg.norm(rest))
        if size <= DEPENDENT * max(float(np.linalg.norm(column)), 1e-300):
            raise InputsError(
                f"'{design.formula}': {name} says nothing beyond {', '.join(design.names[:k])} "
                f"in these {len(design.matrix)} experiments",
                "leave one of the terms out",
            )
        basis = np.column_stack([basis, rest / size])
