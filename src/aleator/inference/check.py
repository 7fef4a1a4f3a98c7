"""The check of a result computed on response surfaces, by a small number of new simulator runs.

The runs are made where the parameters of each experiment most probably lie. With measurement noise
the integral over the parameters of each experiment is computed again, with the simulator's values
at the same nodes. Without noise each outcome is treated as if it had a small normal error, on the
surfaces and on the simulator alike, so that this error cancels in the comparison.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.core.status import Status
from aleator.core.types import Array, Flags, Indices
from aleator.errors import InputsError
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import (
    Direct,
    Evaluator,
    GaussHermite,
    ImportancePoints,
    IndividualLikelihood,
    Layout,
    Predictor,
)
from aleator.likelihood.individual.likelihood import mean_of
from aleator.likelihood.individual.posterior import values_under_law
from aleator.likelihood.individual.predictors import Block
from aleator.likelihood.level_sets import LevelLikelihood
from aleator.observations.errors import MeasurementErrors, ResponseErrors
from aleator.observations.noise import Noise
from aleator.simulators import Runner
from aleator.surrogates import AdaptiveSurfaces


@dataclass(frozen=True)
class ExactOutcomeSettings:
    """Settings of the check of exact outcomes and narrow laws. The values are chosen by judgement.

    smallest: the error of an outcome that does not scatter, and the least sum of weights.
    step: share of the outcome's scatter. The log-density is differentiated numerically over this
    step, or over the error of the fitted line (see `Checked`) where that is larger.
    nodes: points per parameter of the Gauss-Hermite rule, for no, one and two scattering
    parameters.
    """

    smallest: float = 1e-150
    step: float = 1e-3
    nodes: tuple[int, int, int] = (1, 5, 3)


EXACT_OUTCOMES = ExactOutcomeSettings()


@dataclass(frozen=True)
class Check:
    """Settings of the check of surfaces: `samples` is the number of runs per unit (0: no check).

    A unit is what one simulator run serves: a row of the table, or an experiment with a series.
    With `samples` None there are `most` runs, or `fewest` where the estimated errors of all
    surfaces are below `exact` times the noise (without noise: times the scatter of the outcome).
    With more than two parameters the runs are chosen from `nodes` points of each experiment. An
    exact outcome gets an auxiliary error of `smooth` times its scatter. Measured by `pytest
    tests/inference/test_check.py tests/tasks/test_folds.py`. Raises InputsError for a negative
    number of samples, and for a single one.

    >>> Check().active, Check(samples=0).active
    (True, False)
    """

    samples: int | None = None
    most: int = 12
    fewest: int = 2
    exact: float = 1e-3
    nodes: int = 32
    smooth: float = 0.25

    def __post_init__(self) -> None:
        """Check the number of samples at once, so that a mistake is reported where it was made."""
        if self.samples is not None and (self.samples < 0 or self.samples == 1):
            raise InputsError(
                f"verification: samples {self.samples}", f"use 0 (off) or at least {self.fewest}"
            )

    @property
    def active(self) -> bool:
        """Whether there is a check."""
        return self.samples != 0

    def runs(self, surfaces: AdaptiveSurfaces) -> int:
        """The number of check runs of each distinct condition or series; fewer for tiny errors."""
        if self.samples is not None:
            return self.samples
        return self.fewest if surfaces.relative.max() < self.exact else self.most


@dataclass(frozen=True, eq=False)
class Checked:
    """Changes (N,) of the log-likelihoods, with errors, when the simulator replaces surfaces.

    For each of M observations, `largest` (M,) is the largest difference between simulator and
    surface at the points of the check, `typical` (M,) the root mean square of these differences,
    and `scatter` (M,) the standard deviation of the surface's values under the law. A straight line
    is fitted to the difference as a function of the surface's value: `line` (M, 2) has the
    difference at the measured outcome and the slope, and `line_error` (M, 2) the errors of both.
    """

    change: Array
    error: Array
    largest: Array
    typical: Array
    scatter: Array
    line: Array
    line_error: Array

    @property
    def total(self) -> float:
        """The change of the whole log-likelihood when the simulator replaces the surfaces."""
        return float(self.change.sum())

    @property
    def standard_error(self) -> float:
        """The standard error of the total change."""
        return float(np.sqrt(np.sum(self.error**2)))

    @property
    def relative(self) -> Array:
        """The root mean square difference over the scatter, for each observation (M,)."""
        return np.asarray(self.typical / np.where(self.scatter > 0.0, self.scatter, np.inf))


def checked(
    likelihood: IndividualLikelihood,
    alpha: Array,
    runner: Runner,
    most: int,
    settings: Check | None = None,
    measured: Array | None = None,
) -> Checked:
    """Compare surfaces and simulator at the most probable parameters of each experiment.

    The change of the log-likelihood is log sum_j w_j exp(l_simulator(x_j)) minus log sum_j w_j
    exp(l_surface(x_j)), with l(x) = sum_k log p(y_k | eta_k(x)). Both sums use the same nodes x_j,
    so that the error of a small number of nodes cancels. Of more than `most` nodes those of largest
    weight are taken. A node at which a run failed is left out, unless all nodes of the experiment
    failed. The reported error treats the nodes as a stratified sample; it is rough. `measured` (M,)
    are exact outcomes, for which the line of `Checked` is fitted too. Cost: `most` runs of each
    unit, which are stored.
    """
    inputs, settings = likelihood.inputs, settings or Check()
    few, variates = likelihood, inputs.scattering
    if isinstance(likelihood.rule, GaussHermite):
        rule = (
            ImportancePoints(settings.nodes, 1)
            if variates > 2
            else GaussHermite(EXACT_OUTCOMES.nodes[variates])
        )
        few = likelihood.by(rule, alpha)
    simulator = Direct(Remembered(runner), np.zeros(0, dtype=np.intp), inputs.box)
    change, error = np.zeros(likelihood.count), np.zeros(likelihood.count)
    count = likelihood.layout.experiment.size
    largest, typical = np.zeros((2, count))
    line, line_error = np.zeros((2, count, 2))
    for block in few.blocks:
        part = block.experiments
        x, log_weight = _likeliest(few, alpha, block, most)
        eta, on_surface = simulator.values(block, x), few.predictor.values(block, x)
        lost = _lost(block, eta)
        by_surface = few.sums_of(alpha, block, on_surface) + log_weight
        by_simulator = few.sums_of(alpha, block, eta) + log_weight
        by_surface, by_simulator = (
            np.where(lost, -np.inf, of) for of in (by_surface, by_simulator)
        )
        known, share = mean_of(by_surface)
        change[part] = mean_of(by_simulator)[0] - known
        with np.errstate(all="ignore"):
            ratio = np.exp(by_simulator - by_surface - change[part, None])
            off = np.where(lost, 0.0, share * (ratio - 1.0) ** 2)
            error[part] = np.sqrt(np.sum(off, axis=1)) / np.sum(~lost, axis=1)
            away = np.where(np.isfinite(eta), eta - on_surface, 0.0)
            largest[block.rows] = np.abs(away).max(axis=1)
            typical[block.rows] = np.sqrt(np.mean(away**2, axis=1))
            if measured is not None:
                weights = np.where(np.isfinite(eta), share[block.owner], 0.0)
                off = on_surface - measured[block.rows, None]
                line[block.rows], line_error[block.rows] = _line(off, away, weights)
    error = np.nan_to_num(error, nan=np.inf)
    scatter = scatter_of(likelihood, alpha)
    return Checked(change, error, largest, typical, scatter, line, line_error)


def unsmoothed(found: Checked, levels: LevelLikelihood, alpha: Array) -> Checked:
    """The check with changes of the exact log-densities, without the auxiliary error.

    Where the simulator differs from the surface by e0 + e1 (eta - y) near an outcome y, its density
    at y is f(y - e0/(1 + e1))/(1 + e1), with f the density by the surface. Where the surface gives
    no density there, the change with the auxiliary error is kept.
    """
    here, (e0, e1) = levels.evaluate(alpha).each, found.line.T
    s0, s1 = found.line_error.T
    least = np.maximum(s0, EXACT_OUTCOMES.step * found.scatter)
    y = levels.outcomes - e0 / (1.0 + e1)
    there, above, below = (
        levels.with_outcomes(y + by * least).evaluate(alpha) for by in (0.0, 1.0, -1.0)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        change = there.each - here - np.log1p(e1)
        slope = (above.each - below.each) / (2.0 * least)
    solved = [one.status == Status.SOLVED for one in (there, above, below)]
    fine = np.logical_and.reduce(solved) & np.isfinite(change) & np.isfinite(slope)
    error = np.where(fine, np.hypot(slope * s0, s1 / (1.0 + e1)), found.error)
    return replace(found, change=np.where(fine, change, found.change), error=error)


def _line(off: Array, away: Array, weights: Array) -> tuple[Array, Array]:
    """Weighted least-squares lines (m, 2) of `away` (m, P) against `off` (m, P), with errors."""
    weights = weights / np.maximum(weights.sum(axis=1, keepdims=True), EXACT_OUTCOMES.smallest)
    middle, mean = (np.sum(weights * of, axis=1, keepdims=True) for of in (off, away))
    wide = np.sum(weights * (off - middle) ** 2, axis=1)
    safe = np.where(wide > 0.0, wide, np.inf)
    slope = np.sum(weights * (off - middle) * (away - mean), axis=1) / safe
    left = away - mean - slope[:, None] * (off - middle)
    count = 1.0 / np.maximum(np.sum(weights**2, axis=1), EXACT_OUTCOMES.smallest)
    spread = np.sqrt(np.sum(weights * left**2, axis=1) / np.maximum(count - 1.0, 1.0))
    line = np.stack([mean[:, 0] - slope * middle[:, 0], slope], axis=1)
    error = np.stack([spread * np.sqrt(1.0 + middle[:, 0] ** 2 / safe), spread / np.sqrt(safe)], 1)
    return line, error


def smoothed(
    inputs: Inputs, alpha: Array, predictor: Predictor, layout: Layout, y: Array, share: float
) -> IndividualLikelihood:
    """The likelihood of exact outcomes y (N,), each with an auxiliary normal error.

    If some are censored, y (2, N) are the bounds of all. The error is the `share` of the scatter of
    the `predictor` under the law alpha (K,).
    """

    def with_errors(sd: Array) -> IndividualLikelihood:
        (lower, upper), rows = np.broadcast_to(y, (2, count)), np.arange(count)
        part = ResponseErrors(
            Noise("error"), rows, lower[:, None], upper[:, None], sd[:, None]
        )  # fmt: skip
        errors = MeasurementErrors((part,), ("y",))
        return IndividualLikelihood.of(inputs, errors, predictor, layout, GaussHermite(1))

    count = y.shape[-1]
    sd = share * scatter_of(with_errors(np.ones(count)), alpha)
    return with_errors(np.where(sd > 0.0, sd, EXACT_OUTCOMES.smallest))


def scatter_of(likelihood: IndividualLikelihood, alpha: Array, points: int = 128) -> Array:
    """The standard deviation (M,) of the simulated values under the law alpha (K,)."""
    found = np.zeros(likelihood.layout.experiment.size)
    for block, eta, share in values_under_law(likelihood, alpha, points):
        mean = np.sum(share * eta, axis=1, keepdims=True)
        found[block.rows] = np.sqrt(np.sum(share * (eta - mean) ** 2, axis=1))
    return np.nan_to_num(found)


def _lost(block: Block, eta: Array) -> Flags:
    """Flags (B, J) of nodes where a run failed, unless all nodes of the experiment failed."""
    failed = block.summed(np.isnan(eta).astype(float)) > 0.0
    return np.asarray(failed & ~np.all(failed, axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class Remembered(Evaluator):
    """A simulator as an evaluator whose runs are remembered and stored."""

    runner: Runner

    def straight(self, unit: Indices, x: Array) -> Array:
        """Simulated values (R, W) at parameters x; NaN where a run failed."""
        return self.runner.values(unit, x)


def _likeliest(
    likelihood: IndividualLikelihood, alpha: Array, block: Block, most: int
) -> tuple[Array, Array]:
    """The `most` nodes of largest weight as parameters x (B, P, n), with log weights (B, P)."""
    part = block.experiments
    found = likelihood.inputs.individual(
        alpha[: likelihood.inputs.size], likelihood.nodes.xi[part], part
    )
    log_weight = likelihood.nodes.log_weight[part] + found.log_weight
    eta = likelihood.predictor.values(block, found.x)
    total = likelihood.sums_of(alpha, block, eta) + log_weight
    best = np.argsort(-total, axis=1)[:, :most]
    chosen = np.take_along_axis(found.x, best[..., None], axis=1)
    return chosen, np.take_along_axis(log_weight, best, axis=1)
