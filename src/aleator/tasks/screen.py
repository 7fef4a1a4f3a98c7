"""The sensitivity of every experiment to the parameters: Sobol' indices before identification.

They show which parameters matter, and so may be given a law.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import pandas as pd

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array, Indices
from aleator.errors import InputsError, count, nearest
from aleator.laws import Law, Uniform
from aleator.moments.expansion import Basis, Expansion, SobolIndices, TotalDegree, sobol_indices
from aleator.moments.projection import Regression
from aleator.observations.experiments import Experiments
from aleator.results import printed
from aleator.results.printed import THRESHOLDS
from aleator.simulators import Runner
from aleator.tasks.arguments import Laws, conditions_in, inputs_of
from aleator.tasks.first_look import SingleValues, of_values, one_each
from aleator.tasks.runs import AnySimulator, AnyTable, runner_on


@dataclass(frozen=True)
class ScreenSettings:
    """Settings of the polynomial expansions of a sensitivity study; chosen by judgement."""

    most_terms: int = 400
    """The largest number of terms of an expansion, unless the user asks for more runs. Then 2, 4,
    8, 12 parameters have the degrees 8, 6, 3, 2."""
    highest_degree: int = 8
    """The highest degree of an expansion."""
    runs_per_term: int = 2
    """The largest number of runs for each term of an expansion."""
    first_runs: int = 10
    """The first number of runs for each parameter; it is doubled until the expansions are good."""
    quantile: float = 0.9
    """The share of the expansions that must explain enough of the variance."""
    rounding: float = 1e-10
    """The rounding error of an effect, as a share of the outcome's standard deviation."""
    lost: float = 3.0
    """The ratio of an effect to its error below which the alignment of effects is not computed."""


SCREEN = ScreenSettings()


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """The sensitivity of the outcomes of N experiments to n parameters that vary independently.

    `spreads` says how each parameter was varied. `sobol` has the Sobol' indices (shares of the
    variance). `effects` (N, n) are the linear effects in the outcome's unit: the coefficient of the
    parameter's first polynomial. For a normal law this is the average slope times the standard
    deviation. `runs` is the number of runs for each experiment.
    """

    names: tuple[str, ...]
    spreads: tuple[str, ...]
    ids: tuple[str, ...]
    expansion: Expansion
    sobol: SobolIndices
    effects: Array
    runs: int

    @property
    def converged(self) -> bool:
        """Whether nine of ten expansions miss at most a hundredth of their outcome's variance."""
        return _good(self.expansion)

    def _repr_html_(self) -> str:
        """The parameters in a notebook, the most important first."""
        rough = "" if self.converged else "The expansions are rough: allow more runs."
        over = count(len(self.ids), "experiment")
        head = f"Shares of the variance over {over}, {self.runs} runs each"
        return printed.shown(head, self.parameters().set_index("parameter"), rough)

    @property
    def alignment(self) -> Array:
        """The cosines (n, n) between the linear effects of two parameters over the experiments.

        C_ij = sum_l g_li g_lj / sqrt(sum_l g_li^2 sum_l g_lj^2) is an uncentred correlation of
        the effects g. At 1 or -1 the two parameters change every outcome in the same proportion.
        These experiments then cannot distinguish a change of one from a change of the other. NaN
        for an effect below the error of the expansions, about leave_one_out / sqrt(runs).
        """
        size = np.linalg.norm(self.effects, axis=0)
        error = np.linalg.norm(self.expansion.leave_one_out) / np.sqrt(self.runs)
        rounding = SCREEN.rounding * np.linalg.norm(np.sqrt(self.sobol.variance))
        unit = self.effects / np.where(size > SCREEN.lost * error + rounding, size, np.nan)
        return np.asarray(unit.T @ unit)

    def parameters(self) -> pd.DataFrame:
        """A table with a row for each parameter, the most important first.

        The columns are how it was varied, the means over the experiments of its first and total
        Sobol' index, the largest total index with its experiment, and the root mean square of the
        linear effect. The means leave out experiments whose outcome does not vary.
        """
        total = np.where(np.isnan(self.sobol.total), 0.0, self.sobol.total)
        counted = max(int(np.sum(~np.isnan(self.sobol.total[:, 0]))), 1)
        first = np.where(np.isnan(self.sobol.first), 0.0, self.sobol.first)
        most = np.argmax(total, axis=0)
        table = pd.DataFrame(
            {
                "parameter": self.names,
                "spread": self.spreads,
                "mean_first": first.sum(axis=0) / counted,
                "mean_total": total.sum(axis=0) / counted,
                "max_total": total.max(axis=0),
                "experiment": [self.ids[l] for l in most],
                "effect": np.sqrt(np.mean(self.effects**2, axis=0)),
            }
        )
        return table.sort_values("mean_total", ascending=False, kind="stable", ignore_index=True)

    def pairs(self) -> pd.DataFrame:
        """A table with a row for each pair of parameters: the explained variance, and alignment.

        `explained` is the mean over experiments of the Sobol' indices S_i + S_j + S_ij, and
        `interaction` the mean of S_ij. `confounded` marks pairs with an alignment near 1 or -1.
        """
        order = {name: k for k, name in enumerate(self.parameters()["parameter"])}
        rows, columns = np.triu_indices(len(self.names), 1)
        swap = [
            order[self.names[i]] > order[self.names[j]] for i, j in zip(rows, columns, strict=True)
        ]
        first, second = np.where(swap, columns, rows), np.where(swap, rows, columns)
        varies = ~np.isnan(self.sobol.total[:, 0])
        closed, second_order = self.sobol.closed[varies], self.sobol.second[varies]
        count = max(len(closed), 1)
        table = pd.DataFrame(
            {
                "first": [self.names[i] for i in first],
                "second": [self.names[j] for j in second],
                "explained": closed.sum(axis=0)[first, second] / count,
                "interaction": second_order.sum(axis=0)[first, second] / count,
                "alignment": self.alignment[first, second],
            }
        )
        table["confounded"] = table["alignment"].abs() > THRESHOLDS.confounded
        return table.sort_values("explained", ascending=False, kind="stable", ignore_index=True)

    def table(self) -> pd.DataFrame:
        """A table with a row for each experiment and parameter: Sobol' indices, linear effect."""
        count, n = self.effects.shape
        return pd.DataFrame(
            {
                "experiment": np.repeat(self.ids, n),
                "parameter": np.tile(self.names, count),
                "first": self.sobol.first.ravel(),
                "total": self.sobol.total.ravel(),
                "effect": self.effects.ravel(),
                "standard_deviation": np.repeat(np.sqrt(self.sobol.variance), n),
                "unexplained": np.repeat(self.expansion.unexplained, n),
            }
        )


def screen(
    simulator: AnySimulator,
    experiments: AnyTable,
    inputs: Laws,
    *,
    vectorized: bool | None = None,
    only: Sequence[str] | None = None,
    runs: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    executor: Executor | None = None,
    settings: ScreenSettings = SCREEN,
) -> Sensitivity:
    """Expand the outcome of every experiment in polynomials, and compute its Sobol' indices.

    `simulator` and `experiments` are those of `identify`; measured outcomes are not used.

    A parameter with a known law is varied by it. A parameter with free hyperparameters is varied
    uniformly over its range or, if that is infinite, by its law at the starting values. A known
    constant is not varied, and correlations are ignored. If an experiment has several observations,
    each is expanded under a name with its row and response.

    `runs` is the number of runs for each experiment. By default it is ten for each parameter,
    doubled until nine of ten expansions miss less than a hundredth of the variance, or until there
    are two runs for each term. `only` are the ids of a subset. Cost: one run for each experiment
    and point, and one least-squares fit for all experiments. Raises InputsError if nothing varies,
    an id is unknown, or runs < 4. Raises SimulatorError if a run fails.

    >>> from aleator.laws import Constant, Free
    >>> table = pd.DataFrame({"load": [1.0, 2.0]})
    >>> inputs = {"x": Constant(Free(0.0, 1.0)), "y": Constant(Free(0.0, 2.0))}
    >>> found = screen(lambda load, x, y: load * x + y, table, inputs)
    >>> found.sobol.first.round(6).tolist()           # load^2/12 against 4/12
    [[0.2, 0.8], [0.5, 0.5]]
    """
    inputs, table = inputs_of(inputs), experiments
    if not isinstance(table, Experiments):
        table = conditions_in(table, "experiments", None)
    made = runner_on(simulator, table, inputs.names, vectorized, executor)
    runner: Runner | SingleValues = made if one_each(made) else of_values(made, table)
    chosen = _positions(made.ids if isinstance(runner, Runner) else runner.owner, only)
    laws, spreads = zip(*[_varied(law) for law in inputs.laws.values()], strict=True)
    varies = [i for i, law in enumerate(laws) if law.scatters]
    if not varies:
        raise InputsError(
            "every parameter is a known constant", "give those to be screened limits or a law"
        )
    if runs is not None and runs < 4:
        raise InputsError(f"{runs} runs an experiment are too few", "allow ten a parameter")
    values = tuple(np.array([h.start for h in law.hyperparameters]) for law in laws)
    expansion, count = _expanded(
        runner, chosen, Basis(laws, values), len(varies), runs, seed, progress or Silent(), settings
    )
    linear = np.eye(len(laws), dtype=np.int64)[varies]
    at = [np.flatnonzero(np.all(expansion.indices == row, axis=1)) for row in linear]
    effects = [expansion.coefficients[:, k].sum(axis=1) for k in at]
    return Sensitivity(
        names=tuple(inputs.names[i] for i in varies),
        spreads=tuple(spreads[i] for i in varies),
        ids=tuple(runner.ids[l] for l in chosen),
        expansion=expansion,
        sobol=sobol_indices(expansion.indices[:, varies], expansion.coefficients),
        effects=np.stack(effects, axis=1),
        runs=count,
    )


def _expanded(
    runner: Runner | SingleValues,
    chosen: Indices,
    basis: Basis,
    n: int,
    runs: int | None,
    seed: int,
    progress: Progress,
    settings: ScreenSettings,
) -> tuple[Expansion, int]:
    terms = _terms(n, runs, settings)
    last = runs or max(
        settings.runs_per_term * len(terms.indices(basis.limits)), settings.first_runs * n
    )
    count = runs or settings.first_runs * n
    outcomes = np.zeros((len(chosen), 0))
    while True:
        way = Regression(terms, runs=count, seed=seed)
        design = way.design(basis)
        fresh = design.x[outcomes.shape[1] :]
        progress.update(f"{count} runs for each of {len(chosen)} experiments", count, last)
        index = np.repeat(chosen, len(fresh))
        new = runner(index, np.tile(fresh, (len(chosen), 1))).reshape(len(chosen), -1)
        outcomes = np.concatenate([outcomes, new], axis=1)
        found = way.fit(basis, design, outcomes)
        if count >= last or _good(found):
            return found, count
        count = min(2 * count, last)


def _good(expansion: Expansion) -> bool:
    return bool(np.quantile(expansion.unexplained, SCREEN.quantile) <= THRESHOLDS.missed)


def _terms(n: int, runs: int | None, settings: ScreenSettings) -> TotalDegree:
    """The terms of an expansion: all up to the highest total degree that does not give too many."""
    most = max(settings.most_terms, (runs or 0) // settings.runs_per_term)
    small = [d for d in range(2, settings.highest_degree + 1) if math.comb(n + d, d) <= most]
    return TotalDegree(max(small, default=1))


def _varied(law: Law) -> tuple[Law, str]:
    free = any(h.free for h in law.hyperparameters)
    kind = type(law).__name__
    if not free:
        return law, f"{kind}, as it is known"
    if law.bounded:
        lower, upper = law.box
        return Uniform.between(lower, upper), f"uniform on [{lower:.6g}, {upper:.6g}]"
    return law, f"{kind} at its start"


def _positions(ids: Sequence[str], chosen: Sequence[str] | None) -> Indices:
    if chosen is None:
        return np.arange(len(ids))
    unknown = [name for name in chosen if name not in ids]
    if unknown or not chosen:
        name = unknown[0] if unknown else ""
        raise InputsError(
            f"there is no experiment '{name}'{nearest(name, ids)}",
            f"the experiments are {', '.join(ids[:10])}{', ...' if len(ids) > 10 else ''}",
        )
    return np.array(
        [k for name in dict.fromkeys(chosen) for k, own in enumerate(ids) if own == name],
        dtype=np.intp,
    )
