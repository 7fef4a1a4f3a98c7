"""Laws that follow covariates: formulas, the columns of their design matrix, and coefficients."""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pandas as pd

from aleator.core.arithmetic import FUNCTIONS, NoArithmeticError, in_short, require_arithmetic, tree
from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError, nearest
from aleator.laws.hyperparameter import Beside, By, Hyperparameter, Specification, resolve, within

if TYPE_CHECKING:
    from formulaic import ModelMatrix


Table = pd.DataFrame
"""A table of covariates with one row for each experiment; the index has the experiments' names."""
LEVEL = re.compile(r"(?:C\((\w+)\)|\b(\w+))\[(?:T\.)?([^\]]*)\]")
"""The pattern of formulaic's column names for levels: C(supplier)[T.b], supplier[T.b], and so on.

A level is one of the texts that a column of categories contains.
"""
TRANSFORMS = ("center", "scale", "standardize", "poly", "bs", "cs", "cr", "cc", "log2", "exp2")
"""Functions of formulaic that a formula may use, besides the arithmetic ones in `FUNCTIONS`."""
CODINGS = ("treatment", "sum", "helmert", "diff", "poly")
"""The contrasts by which C(...) may code levels, for example C(by, contr.treatment(base='a'))."""


@dataclass(frozen=True)
class FormulaBounds:
    """Limits of the size of a formula of covariates; chosen by `python -m hardening formulas`.

    characters: the largest number of characters; the time to read a formula grows with its square.
    terms: the largest number of terms, counted before equal terms are joined: a power of a sum has
    many. degree: the largest power, degree of a polynomial or a spline, and number of degrees of
    freedom. dependent: a column counts as a linear combination of the columns before it where the
    part of it that they do not explain is smaller than this, relative to the column (by judgement).
    """

    characters: int = 2000
    terms: int = 1000
    degree: int = 50
    dependent: float = 1e-9


@dataclass(frozen=True, eq=False)
class DesignMatrix:
    """The columns (N, p) of a formula for N experiments, and the names of their coefficients.

    `state` keeps what the formula took from its first table: the levels, the means of
    `center(...)`, the knots of splines. With it the formula is applied to other experiments.
    """

    formula: str
    names: tuple[str, ...]
    matrix: Array
    state: Any

    @classmethod
    def of(cls, formula: str, covariates: Table) -> DesignMatrix:
        """The design matrix of a formula for covariates of N experiments, one row each.

        Raises InputsError for a formula that cannot be read, an unknown name, a missing value, a
        level that only one experiment has, and columns that are linearly dependent.

        >>> table = pd.DataFrame({"t": [0.0, 1.0, 2.0, 3.0], "by": ["a", "a", "b", "b"]})
        >>> design = DesignMatrix.of("1 + t + C(by)", table)
        >>> design.names, design.matrix[2].tolist()
        (('Intercept', 't', 'by=b'), [1.0, 2.0, 1.0])
        """
        require_complete(formula, covariates)
        found = _columns(formula, _read(formula).terms, covariates)
        design = cls(formula, named(found), np.asarray(found, dtype=float), found.model_spec)
        _require_levels(design, covariates)
        _require_independent(design)
        return design

    def at(self, covariates: Table) -> DesignMatrix:
        """The design matrix of this formula for the covariates of other experiments.

        The levels, means and knots are those of the first experiments. Raises InputsError for a
        level that the first experiments do not have.
        """
        require_complete(self.formula, covariates)
        _require_known_levels(self, covariates)
        found = _columns(self.formula, self.state, covariates)
        return DesignMatrix(self.formula, self.names, np.asarray(found, dtype=float), self.state)

    @property
    def levels(self) -> dict[str, list[Any]]:
        """The levels of each column of the table whose entries the formula takes as levels."""
        found = {
            re.sub(r"^C\((\w+).*\)$", r"\1", str(factor)): [*state["categories"]]
            for factor, (kind, state) in self.state.encoder_state.items()
            if kind.value == "categorical"
        }
        known = variables(self.formula)
        return {name: levels for name, levels in found.items() if name in known}

    @property
    def factors(self) -> tuple[str, ...]:
        """The columns of the table whose entries the formula takes as levels."""
        return tuple(self.levels)

    @property
    def base(self) -> Flags:
        """Flags (p,) of the columns whose sum is one: the intercept, or all levels of a factor."""
        ones = np.ones(len(self.matrix))
        share = np.linalg.lstsq(self.matrix, ones)[0]
        spanned = np.allclose(self.matrix @ share, ones)
        return np.asarray(spanned & (np.abs(share - 1.0) < 1e-6))


def variables(formula: str, owner: str = "") -> tuple[str, ...]:
    """The columns of the table that a formula names, sorted.

    The formula is read and not evaluated. Raises InputsError for a text that is no formula of
    covariates; the message names the `owner` of the formula.

    >>> variables("1 + log(temperature) + C(supplier)")
    ('supplier', 'temperature')
    """
    try:
        return _read(formula).names
    except InputsError as error:
        of = f"{owner} = " if owner else ""
        raise InputsError(f"{of}{error.problem}", error.remedy) from None


def named(columns: ModelMatrix) -> tuple[str, ...]:
    """Readable names of the coefficients: ``supplier=b`` for formulaic's C(supplier)[T.b]."""

    def aloud(level: re.Match[str]) -> str:
        return f"{level[1] or level[2]}={level[3].removesuffix('.0')}"

    return tuple(LEVEL.sub(aloud, str(name)) for name in columns.columns)


def require_complete(formula: str, covariates: Table) -> None:
    """Raise InputsError where the table does not have what a formula needs.

    That is a name that is no column, an empty cell, or arithmetic with a column of texts.
    """
    columns = [str(name) for name in covariates.columns]
    read = _read(formula)
    for name in read.names:
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
    for name in read.numbers:
        if not pd.api.types.is_numeric_dtype(covariates[name].infer_objects()):
            raise InputsError(
                f"'{formula}' computes with '{name}', which is a column of texts",
                f"write C({name}), or a column of numbers",
            )


@dataclass(frozen=True)
class _Formula:
    """A formula after reading: its terms, and the columns that it names.

    `numbers` are the columns that it computes with.
    """

    terms: Any
    names: tuple[str, ...]
    numbers: tuple[str, ...]


def _read(formula: str, bounds: FormulaBounds = FormulaBounds()) -> _Formula:
    """Read a formula without evaluating it; raises InputsError where it cannot be read."""
    # formulaic is imported only here because its import takes half as long as all others together.
    from formulaic import Formula, SimpleFormula
    from formulaic.parser import DefaultFormulaParser

    if len(formula) > bounds.characters:
        raise InputsError(
            f"{in_short(formula)} is a formula of {len(formula):,} characters",
            f"write one of {bounds.characters:,} at most; columns can be prepared in the table",
        )
    try:
        count = _count(formula, DefaultFormulaParser().parse(formula, target="ast"), bounds)
        if count > bounds.terms:
            raise InputsError(
                f"'{formula}' has a product or a power with more than {bounds.terms:,} terms",
                "write the terms that are meant",
            )
        terms = Formula(formula)
    except RecursionError:
        raise InputsError(
            f"{in_short(formula)} has too many operations within each other",
            "write fewer terms; columns can be prepared in the table",
        ) from None
    except InputsError:
        raise
    except Exception as error:  # formulaic raises IndexError, AttributeError and others
        raise _unreadable(formula, error) from None
    if not isinstance(terms, SimpleFormula):
        raise InputsError(
            f"'{formula}' has more than one side", 'write one side only: "1 + temperature"'
        )
    names: set[str] = set()
    numbers: set[str] = set()
    for factor in (factor for term in terms for factor in term.factors):
        if factor.eval_method is factor.EvalMethod.LOOKUP:
            names.add(str(factor.expr))
        else:
            read = _FormulaFactor(formula, str(factor.expr), bounds)
            names |= read.levels
            numbers |= read.numbers
    return _Formula(terms, tuple(sorted(names | numbers)), tuple(sorted(numbers)))


def _count(formula: str, node: Any, bounds: FormulaBounds) -> float:
    """The number of terms of a formula before equal terms are joined, from its operator tree."""
    operator = getattr(node, "operator", None)
    if operator is None:
        return 1.0
    if operator.symbol == ".":
        raise InputsError(
            f"'{formula}' has a '.' for all columns", "name the columns that are meant"
        )
    sizes = [_count(formula, part, bounds) for part in node.args]
    if operator.symbol in ("**", "^"):
        power = getattr(node.args[1], "token", "")
        small = power.isdigit() and int(power) <= bounds.degree and sizes[0] <= bounds.terms
        return sizes[0] ** int(power) if small else math.inf
    products = math.prod(sizes) if operator.symbol in ("*", "/", "in", ":") else 0.0
    return products + (sum(sizes) if operator.symbol != ":" else 0.0)


class _FormulaFactor:
    """A factor of a formula that is more than a column name, checked before it is evaluated.

    formulaic evaluates such a factor as Python code. Only arithmetic of columns, transforms of it,
    and C(column) are therefore accepted; raises InputsError for everything else. `levels` and
    `numbers` are the columns that it uses as categories and as numbers.
    """

    def __init__(self, formula: str, text: str, bounds: FormulaBounds) -> None:
        self.levels: set[str] = set()
        self.numbers: set[str] = set()
        self._bounds = bounds
        self._quoted: dict[str, str] = {}
        plain = re.sub("`([^`]*)`", self._plain, text)
        try:
            found = tree(plain)
            if _called(found) == "C":
                self._read_levels(cast(ast.Call, found))
            else:
                require_arithmetic(found, self._is_leaf)
        except NoArithmeticError as error:
            part = plain if error.node is None else ast.unparse(error.node)
            functions = ", ".join((*FUNCTIONS, *TRANSFORMS, "I", "C"))
            raise InputsError(
                f"'{formula}' has {in_short(part)}, which {error.problem}",
                error.remedy or f"write columns, numbers, + - * / ** and the functions {functions}",
            ) from None

    def _plain(self, quoted: re.Match[str]) -> str:
        """A plain name that replaces a column name in backticks."""
        name = f"column_{len(self._quoted)}_"
        self._quoted[name] = quoted[1]
        return name

    def _name(self, node: ast.Name) -> str:
        return self._quoted.get(node.id, node.id)

    def _is_leaf(self, node: ast.expr) -> bool:
        """Whether a node of the expression is a column, or a transform of arithmetic."""
        if isinstance(node, ast.Name):
            self.numbers.add(self._name(node))
            return True
        if _called(node) not in (*TRANSFORMS, "I"):
            return False
        call = cast(ast.Call, node)
        if not call.args or require_arithmetic(call.args[0], self._is_leaf) is not None:
            raise NoArithmeticError("has no column", node=node)
        for option in call.args[1:]:
            self._require_option(option, is_degree=True)
        for keyword in call.keywords:
            self._require_option(keyword.value, is_degree=keyword.arg in ("df", "degree"))
        return True

    def _read_levels(self, call: ast.Call) -> None:
        """Read C(column, contrast, options): a column's categories and the coding of its levels."""
        if not call.args or not isinstance(call.args[0], ast.Name):
            raise NoArithmeticError("has no column", "write C(column)", call)
        self.levels.add(self._name(call.args[0]))
        for option in (*call.args[1:], *(keyword.value for keyword in call.keywords)):
            coding = option.func if isinstance(option, ast.Call) else option
            if (
                isinstance(coding, ast.Attribute)
                and isinstance(coding.value, ast.Name)
                and (coding.value.id, coding.attr in CODINGS) == ("contr", True)
            ):
                given = option if isinstance(option, ast.Call) else ast.Call(option, [], [])
                for each in (*given.args, *(keyword.value for keyword in given.keywords)):
                    self._require_option(each)
            else:
                self._require_option(option)

    def _require_option(self, node: ast.expr, is_degree: bool = False) -> None:
        """Raise NoArithmeticError where an option is no plain value, or is too large a degree."""
        try:
            value = ast.literal_eval(node)
        except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
            raise NoArithmeticError("is no plain value", "write a number or a text", node) from None
        if is_degree and isinstance(value, (int, float)) and not abs(value) <= self._bounds.degree:
            raise NoArithmeticError("is too large", f"write {self._bounds.degree} or less", node)


def _called(node: ast.expr) -> str:
    """The name of the function that a node of the expression calls, or "" if it is no call."""
    called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    return str(node.func.id) if called else ""  # type: ignore[attr-defined]


def _columns(formula: str, of: Any, covariates: Table) -> ModelMatrix:
    """The columns that a formula gives for the covariates.

    `of` has the terms of the formula, or its state where it was applied to another table before.
    """
    from formulaic.errors import DataMismatchWarning, FormulaicError

    whole = covariates.select_dtypes("integer").columns  # powers of integers may overflow
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore", RuntimeWarning)  # values not finite are refused below
            warnings.simplefilter("error", DataMismatchWarning)
            found: ModelMatrix = of.get_model_matrix(
                covariates.astype(dict.fromkeys(whole, float)), na_action="raise", context=FUNCTIONS
            )
    except DataMismatchWarning as error:
        level = re.search(r"\{(.*?)\}", str(error))
        raise InputsError(
            f"'{formula}': the level {level[1] if level else ''} is not among those of the formula",
            "add it to them, or leave out the experiments that have it",
        ) from None
    except (FormulaicError, ValueError) as error:
        raise _unreadable(formula, error) from None
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
    said = error.msg if isinstance(error, SyntaxError) else str(error)
    text = re.sub(r"\x1b\[[0-9;]*m|⧛.*", "", said).strip().splitlines()
    cause = text[0] if text else "it has no terms"
    return InputsError(
        f"'{formula}' is no formula of covariates: {cause}",
        'write terms with + between them, such as "1 + temperature + C(supplier)"',
    )


def _require_known_levels(design: DesignMatrix, covariates: Table) -> None:
    """Raise InputsError for a level that the experiments of the formula do not have."""
    for name, levels in design.levels.items():
        new = covariates[name][~covariates[name].isin(levels)]
        if len(new):
            known, level = [_spoken(one) for one in levels], _spoken(new.iloc[0])
            raise InputsError(
                f"'{design.formula}': the level '{level}' is not among those of {name} that the "
                f"law was identified with{nearest(level, known)}",
                f"its coefficient is not known; use one of {', '.join(known)}",
            )


def _spoken(level: object) -> str:
    """A level as a reader writes it: whole numbers have no decimals."""
    return str(level).removesuffix(".0")


def _require_levels(design: DesignMatrix, covariates: Table) -> None:
    """Raise InputsError where only one experiment has a level.

    The coefficient of such a level cannot be separated from the scatter between experiments.
    """
    for name in design.factors:
        counts = covariates[name].value_counts()
        for level in counts.index[counts == 1]:
            alone = covariates.index[covariates[name] == level][0]
            raise InputsError(
                f"'{design.formula}': experiment '{alone}' is the only one with {name} = {level}, "
                "so that the level cannot be told from the scatter between experiments",
                f"leave the experiment out, or join its {name} with another",
            )


def _require_independent(design: DesignMatrix, bounds: FormulaBounds = FormulaBounds()) -> None:
    """Raise InputsError where a column is a linear combination of the columns before it."""
    basis = np.empty((len(design.matrix), 0))
    for k, name in enumerate(design.names):
        column = design.matrix[:, k]
        column = column / (float(np.max(np.abs(column))) or 1.0)
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        size = float(np.linalg.norm(rest))
        if size <= bounds.dependent * max(float(np.linalg.norm(column)), 1e-300):
            raise InputsError(
                f"'{design.formula}': {name} says nothing beyond {', '.join(design.names[:k])} "
                f"in these {len(design.matrix)} experiments",
                "leave one of the terms out",
            )
        basis = np.column_stack([basis, rest / size])


@dataclass(frozen=True, eq=False)
class CoefficientPlaces:
    """A hyperparameter of a law, and the `places` of its value or its coefficients in alpha.

    A hyperparameter that follows covariates has coefficients; `design` is their design matrix.
    """

    hyperparameter: Hyperparameter
    places: slice
    design: DesignMatrix | None

    def value(self, alpha: Array, experiments: slice) -> Array:
        """The hyperparameter's value (B,) in B experiments, moved into its limits.

        The value is a single number where it is the same in every experiment.
        """
        if self.design is None:
            return np.asarray(alpha[self.places.start])
        linear = self.design.matrix[experiments] @ alpha[self.places]
        return np.asarray(np.clip(linear, self.hyperparameter.lower, self.hyperparameter.upper))

    def score(self, alpha: Array, by_value: Array, experiments: slice) -> Array:
        """Derivatives (B, p) by the coefficients, from derivatives (B,) by the value."""
        if self.design is None:
            return by_value[:, None]
        columns = self.design.matrix[experiments]
        linear = columns @ alpha[self.places]
        inside = (linear >= self.hyperparameter.lower) & (linear <= self.hyperparameter.upper)
        return np.asarray(np.where(inside, by_value, 0.0)[:, None] * columns)


@dataclass(frozen=True, eq=False)
class CovariateModel:
    """The laws' hyperparameters in N experiments as functions of alpha, which has coefficients.

    A value that would leave the limits of its hyperparameter is set to the limit, because no law
    exists beyond.
    """

    entries: tuple[CoefficientPlaces, ...]
    hyperparameters: tuple[Hyperparameter, ...]
    count: int

    @classmethod
    def of(cls, own: Sequence[Hyperparameter], covariates: Table) -> CovariateModel:
        """The model for the laws' hyperparameters and covariates with a row for each experiment.

        Raises InputsError as `DesignMatrix.of` does; the message names the hyperparameter.
        """
        entries: list[CoefficientPlaces] = []
        found: list[Hyperparameter] = []
        for h in own:
            design = _design_of(h, covariates) if h.by is not None else None
            new = [h] if design is None else coefficients(h, design)
            entries.append(CoefficientPlaces(h, slice(len(found), len(found) + len(new)), design))
            found += new
        return cls(tuple(entries), tuple(found), len(covariates))

    def at(self, covariates: Table) -> CovariateModel:
        """The model with the same coefficients for other experiments.

        Raises InputsError for a level that the first experiments do not have.
        """
        entries = [
            entry if entry.design is None else replace(entry, design=entry.design.at(covariates))
            for entry in self.entries
        ]
        return replace(self, entries=tuple(entries), count=len(covariates))

    def values(self, alpha: Array, part: slice, experiments: slice) -> Array:
        """Values of the hyperparameters of one law, whose places among all are `part`.

        The shape is (k,), or (k, B, 1) for B experiments where one of them follows covariates.
        """
        found = [entry.value(alpha, experiments) for entry in self.entries[part]]
        if all(value.ndim == 0 for value in found):
            return np.array(found)
        count = len(range(*experiments.indices(self.count)))
        return np.stack([np.broadcast_to(value, count) for value in found])[:, :, None]

    def coefficients_for(self, values: Array) -> Array:
        """The alpha for which all experiments have hyperparameters nearest to `values` (H,)."""
        found = np.array([h.start for h in self.hyperparameters])
        for entry, value in zip(self.entries, values, strict=True):
            if entry.design is None:
                found[entry.places] = value
            else:
                matrix = entry.design.matrix
                found[entry.places] = np.linalg.lstsq(matrix, np.full(len(matrix), value))[0]
        return within(self.hyperparameters, found.tolist())

    def score(self, alpha: Array, by_values: Array, experiments: slice) -> Array:
        """Derivatives (B, K) by alpha, from derivatives (B, H) by the hyperparameters' values."""
        return np.concatenate(
            [
                entry.score(alpha, by_values[:, h], experiments)
                for h, entry in enumerate(self.entries)
            ],
            axis=1,
        )

    def on_limits(self, alpha: Array) -> dict[str, Indices]:
        """The experiments (B,) in which a value is set to its limit, for each hyperparameter name.

        Hyperparameters without such experiments are left out.
        """
        found = {}
        for entry in self.entries:
            if entry.design is not None:
                linear = entry.design.matrix @ alpha[entry.places]
                outside = (linear < entry.hyperparameter.lower) | (
                    linear > entry.hyperparameter.upper
                )
                if outside.any():
                    found[entry.hyperparameter.name] = np.flatnonzero(outside)
        return found


def coefficients(own: Hyperparameter, design: DesignMatrix) -> list[Hyperparameter]:
    """The coefficients of a formula, as hyperparameters ``mean[temperature]``.

    The intercept has the limits of the value itself; so have the levels of a factor that replaces
    the intercept. Every other coefficient lies within plus or minus the width of those limits
    divided by the range of its column. Where zero lies outside the range of a covariate, the
    intercept is a value far from all experiments. Its limits are then wider by the largest change
    that the coefficient of the covariate can cause, and the search uses the value at the mean of
    the covariate instead (see `Beside`).
    """
    assert own.by is not None
    _require_terms(own, own.by, design.names)
    low, high = design.matrix.min(axis=0), design.matrix.max(axis=0)
    base, width = design.base, own.upper - own.lower
    if base.any():
        steepest = np.where(base, 0.0, width / np.where(high > low, high - low, 1.0))
    else:
        reach = max(abs(own.lower), abs(own.upper))
        steepest = reach / np.maximum(np.maximum(np.abs(low), np.abs(high)), 1e-300)
    far = ~base & ((low > 0.0) | (high < 0.0)) & base.any()
    middle = design.matrix.mean(axis=0)
    beyond = float(np.abs(middle[far]) @ steepest[far])
    terms = tuple((_name(own, design.names[j]), float(middle[j])) for j in np.flatnonzero(far))
    beside = Beside(terms, own.lower, own.upper) if terms else None
    found = []
    for name, is_base, steep in zip(design.names, base, steepest, strict=True):
        limits = (own.lower - beyond, own.upper + beyond) if is_base else (-steep, steep)
        wanted = own.by.terms.get(name)
        log = bool(is_base and own.log and beside is None)
        h = _coefficient(_name(own, name), wanted, limits, own.start if is_base else 0.0, log=log)
        found.append(replace(h, beside=beside) if is_base and wanted is None else h)
    return found


def _coefficient(
    name: str,
    wanted: Specification | None,
    limits: tuple[float, float],
    start: float,
    *,
    log: bool,
) -> Hyperparameter:
    if wanted is None:
        return Hyperparameter(name, *limits, start, free=True, log=log)
    h = resolve(name, wanted, limits)
    if h.free and getattr(wanted, "start", None) is None and h.lower <= start <= h.upper:
        h = replace(h, start=start)
    return replace(h, log=log and h.lower > 0.0)


def _name(own: Hyperparameter, term: str) -> str:
    return f"{own.name}[{term}]"


def _require_terms(own: Hyperparameter, by: By, names: Sequence[str]) -> None:
    for term in by.terms:
        if term not in names:
            raise InputsError(
                f"{own.name}: '{by.formula}' has no coefficient '{term}'{nearest(term, names)}",
                f"its coefficients are {', '.join(names)}",
            )


def _design_of(own: Hyperparameter, covariates: Table) -> DesignMatrix:
    assert own.by is not None
    try:
        return DesignMatrix.of(own.by.formula, covariates)
    except InputsError as error:
        raise InputsError(f"{own.name} = {error.problem}", error.remedy) from None
