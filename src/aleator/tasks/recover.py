"""A recovery study: data sets are simulated under a known law, and each is identified."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from aleator.core.progress import Progress, Silent
from aleator.core.types import Array
from aleator.errors import InputsError
from aleator.fit.flow import answered
from aleator.fit.ledger import Ledger
from aleator.fit.question import DEFAULT_PROPAGATION, DEFAULT_SEARCH, Choices
from aleator.inference.information import INTERVALS
from aleator.inference.likelihood_at import censored_alike
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs, drawn
from aleator.observations.errors import MeasurementErrors
from aleator.observations.experiments import Experiments, unmeasured
from aleator.observations.responses import Observations
from aleator.results import printed
from aleator.search import Search
from aleator.simulators import Runner, Simulator
from aleator.simulators.command.run import passing
from aleator.simulators.pool import packed
from aleator.simulators.store import Store
from aleator.surrogates import ResponseSurface
from aleator.tasks.arguments import AnyNoise, Laws, conditions_in, inputs_of, noise_of
from aleator.tasks.runs import AnySimulator, AnyTable, in_processes, runner_on

if TYPE_CHECKING:
    from aleator.moments.densities import Density
    from aleator.moments.propagation import Collocation


@dataclass(frozen=True)
class Recovered:
    """The identification of one simulated data set: alpha (K,), intervals and errors (K, 2).

    The two errors are the standard error from the observed information, and the sandwich error.
    """

    alpha: Array
    intervals: Array
    errors: Array
    log_likelihood: float
    converged: bool


def _drawn(
    choices: Choices, runner: Runner, alpha: Array, replicates: int, rng: np.random.Generator
) -> list[Observations]:
    """The simulated observations of each replicate, under the conditions of the table."""
    table, inputs, count = choices.table, choices.inputs, len(runner.ids)
    if not choices.exact:
        return [
            virtual_observations(runner, table, inputs, choices.errors, alpha, rng)
            for _ in range(replicates)
        ]
    if not table.simple:
        seen, censored = table.observations, bool(np.any(table.observations.censored))
        return [
            censored_alike(seen, y, rng) if censored else replace(seen, lower=y, upper=y)
            for y in (_simulated(runner, inputs, alpha, rng) for _ in range(replicates))
        ]
    x = inputs.sample(alpha[: inputs.size], rng.random((replicates * count, len(inputs.names))))
    y = runner(np.tile(np.arange(count), replicates), x).reshape(replicates, count)
    (response,) = table.observations.responses
    return [Observations.exact(one, response.name, response.transform) for one in y]


def _identified(choices: Choices, runner: Runner, data: Observations, seed: int) -> Recovered:
    """Identify the laws from one data set, as `identify` does, without the check."""
    answer = answered(choices.question(runner, data, seed), Ledger(runner, Silent()))
    inference = answer.inference
    errors = np.stack([inference.standard_error, inference.sandwich_error], axis=1)
    return Recovered(
        answer.maximum.alpha, answer.profile.intervals, errors, answer.search_result.log_likelihood,
        answer.search_result.converged,
    )  # fmt: skip


def virtual_observations(
    runner: Runner,
    table: Experiments,
    inputs: Inputs,
    errors: MeasurementErrors,
    alpha: Array,
    rng: np.random.Generator,
) -> Observations:
    """Simulate observations under the conditions of a table, with the law and noise of alpha (K,).

    Observations that one simulator run can give together come from one run. The values are censored
    as in the table (see `censored_alike`). A value whose run fails is NaN and counts as missing.
    """
    seen = table.observations
    eta = _simulated(runner, inputs, alpha, rng)[:, None]
    uniform = rng.random(eta.shape)
    with np.errstate(invalid="ignore"):
        y = errors.drawn(alpha[inputs.size :], uniform, eta, slice(0, len(seen)))[:, 0]
    return censored_alike(seen, y, rng)


def _simulated(runner: Runner, inputs: Inputs, alpha: Array, rng: np.random.Generator) -> Array:
    """Simulated values (M,) of all observations, at parameters drawn from the law of alpha (K,)."""
    x = drawn(inputs, alpha[: inputs.size], len(runner.ids), rng)
    units, place = np.unique(runner.unit, return_inverse=True)
    values = runner.values(units, x[runner.experiment[units]])
    return np.asarray(values[place, runner.column])


@dataclass(frozen=True)
class Recovery:
    """The estimates `alpha` (R, F) of R replicates of a known law, with intervals (R, F, 2).

    `truth` (F,) are the true values of the F free hyperparameters `names`. `errors` (R, F, 2) are
    the standard errors from the information and the sandwich errors.
    """

    names: tuple[str, ...]
    truth: Array
    alpha: Array
    intervals: Array
    log_likelihood: Array
    converged: NDArray[np.bool_]
    errors: Array | None = None

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        head = f"{len(self.alpha)} replicates of a known law"
        missed = int(np.sum(~self.converged))
        return printed.shown(head, self.table(), f"{missed} did not converge." if missed else "")

    def table(self) -> pd.DataFrame:
        """A table with the truth, the bias and the coverage of each hyperparameter.

        The columns are `truth`, the `mean` estimate, the `bias` with its Monte Carlo error
        `bias_error` (`scatter` divided by sqrt(R)), the standard deviation `scatter` of the
        estimates, and `coverage`, the share of the computed 95 % intervals that contain the truth.
        `by_error` and `by_sandwich` are the coverages of the estimate -+ 1.96 standard errors or
        sandwich errors, in replicates that have one; an estimate on a limit has none.
        """
        count = self.alpha.shape[0]
        scatter = self.alpha.std(axis=0, ddof=1)
        held = (self.intervals[:, :, 0] <= self.truth) & (self.truth <= self.intervals[:, :, 1])
        return pd.DataFrame(
            {
                "truth": self.truth,
                "mean": self.alpha.mean(axis=0),
                "bias": self.alpha.mean(axis=0) - self.truth,
                "bias_error": scatter / np.sqrt(count),
                "scatter": scatter,
                "coverage": _share(held, np.asarray(np.isfinite(self.intervals).all(axis=2))),
                **self._by_errors(),
            },
            index=list(self.names),
        )

    def _by_errors(self) -> dict[str, Array]:
        if self.errors is None:
            return {}
        half = float(stats.norm.ppf(0.5 + 0.5 * INTERVALS.level)) * self.errors
        held = np.abs(self.alpha - self.truth)[..., None] <= half
        known = np.isfinite(half)
        names = ("by_error", "by_sandwich")
        return {name: _share(held[..., i], known[..., i]) for i, name in enumerate(names)}


def _share(held: NDArray[np.bool_], known: NDArray[np.bool_]) -> Array:
    """The share (F,) of intervals that contain the truth (`held`), among the `known` ones (R, F).

    NaN if no replicate is known.
    """
    count = known.sum(axis=0)
    return np.where(count, (held & known).sum(axis=0) / np.maximum(count, 1), np.nan)


def recover(
    simulator: AnySimulator,
    experiments: AnyTable,
    inputs: Laws,
    truth: Mapping[str, float],
    *,
    vectorized: bool | None = None,
    noise: AnyNoise = None,
    propagation: ResponseSurface | Collocation = DEFAULT_PROPAGATION,
    density: Density | None = None,
    search: Search = DEFAULT_SEARCH,
    replicates: int = 40,
    seed: int = 0,
    workers: int = 1,
    progress: Progress | None = None,
    restricted: bool = False,
    small_sample: bool = False,
) -> Recovery:
    """Identify data sets simulated under the law `truth`, and compare the estimates with it.

    The arguments are those of `identify`; measured outcomes are not used. `truth` maps every free
    hyperparameter to its true value.

    The outcomes are simulated with one run for each experiment and replicate, plus noise if the
    model has it. They are censored as in the table: at the common bound of a response, or else
    where a measured value was censored.

    Each data set is identified completely, from the first run of its response surfaces to its
    intervals. Equal runs are made only once. `workers` processes identify in parallel; the result
    does not depend on their number. Raises InputsError for fewer than two replicates, and for a
    truth that lacks a hyperparameter or is outside its limits. Cost: that of `replicates`
    identifications without check on the simulator.

    >>> from aleator.laws import Free, Normal
    >>> inputs = Inputs({"x": Normal(mean=Free(0.0, 2.0), sd=Free(0.01, 0.5))})
    >>> found = recover(lambda load, x: load * x, pd.DataFrame({"load": range(1, 10)}), inputs,
    ...                 {"x.mean": 1.0, "x.sd": 0.1}, replicates=2)
    >>> found.table()["mean"].round(1).tolist()
    [1.0, 0.1]
    """
    progress = progress or Silent()
    inputs, noise = inputs_of(inputs), noise_of(noise)
    runner = runner_on(simulator, experiments, inputs.names, vectorized)
    table = experiments
    if not isinstance(table, Experiments):
        table = unmeasured(conditions_in(table, "experiments", noise))
    choices = Choices.of(
        table, inputs, noise, propagation, density, search, restricted=restricted,
        small_sample=small_sample,
    )  # fmt: skip
    hyperparameters = choices.hyperparameters
    alpha = _checked(truth, hyperparameters, replicates)
    progress.stage("virtual experiments")
    data = _drawn(choices, runner, alpha, replicates, np.random.default_rng(seed))
    progress.stage("identification")
    found: dict[int, Recovered] = {}
    for number, replicate in _each_identified(choices, runner, data, seed, workers):
        found[number] = replicate
        progress.update(f"{len(found)} of {replicates} data sets", len(found), replicates)
    results = [found[number] for number in range(replicates)]
    free = np.flatnonzero([h.free for h in hyperparameters])
    return Recovery(
        tuple(hyperparameters[k].name for k in free),
        alpha[free],
        np.stack([r.alpha[free] for r in results]),
        np.stack([r.intervals[free] for r in results]),
        np.array([r.log_likelihood for r in results]),
        np.array([r.converged for r in results]),
        np.stack([r.errors[free] for r in results]),
    )


@dataclass(frozen=True)
class _Elsewhere:
    """The data that another process needs to identify data sets of the same experiments."""

    choices: Choices
    simulator: Simulator
    parameters: tuple[str, ...]
    store: Path
    retries: int
    max_failed: float

    def identified(self, data: Observations, seed: int) -> Recovered:
        """Identify one data set in this process; runs are shared with others through the store."""
        with Store(self.store) as store:
            runner = Runner(
                self.simulator, self.choices.table, self.parameters, store=store,
                retries=self.retries, max_failed=self.max_failed,
            )  # fmt: skip
            return _identified(self.choices, runner, data, seed)


def _each_identified(
    choices: Choices, runner: Runner, data: Sequence[Observations], seed: int, workers: int
) -> Iterator[tuple[int, Recovered]]:
    if workers > 1:
        with passing() as folder:
            store = runner.cache.store.path if runner.cache else folder / "runs.sqlite"
            parcel = packed(
                _Elsewhere(
                    choices, runner.simulator, runner.parameters, store, runner.retries,
                    runner.max_failed,
                )
            )  # fmt: skip
            if parcel is not None:
                pieces = {k: (part, seed + k) for k, part in enumerate(data)}
                yield from in_processes(parcel, _Elsewhere.identified, pieces, workers)
                return
    for k, part in enumerate(data):
        yield k, _identified(choices, runner, part, seed + k)


def _checked(
    truth: Mapping[str, float], hyperparameters: Sequence[Hyperparameter], replicates: int
) -> Array:
    if replicates < 2:
        raise InputsError(f"recover: {replicates} replicates", "use at least 2; 40 tell a lot")
    values = []
    for h in hyperparameters:
        value = truth.get(h.name, h.start if not h.free else None)
        if value is None:
            raise InputsError(f"recover: no true value of {h.name}", "give every hyperparameter")
        if not h.lower <= value <= h.upper:
            raise InputsError(
                f"recover: true {h.name} = {value} is outside its limits [{h.lower}, {h.upper}]",
                "widen the limits or choose another truth",
            )
        values.append(float(value))
    return np.array(values)
