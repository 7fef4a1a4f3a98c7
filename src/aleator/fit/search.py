"""The search of a question: where it begins, on how many experiments, and what is kept of it.

It begins at what an identified law must improve on: a deterministic fit of one parameter point, and
the law identified with the simulator linearized there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import partial

import numpy as np
from scipy import optimize

from aleator.core.status import DEGENERATE_VALUE, Status
from aleator.core.types import Array
from aleator.fit.ledger import SEARCH, Ledger
from aleator.fit.quadrature import AnyLikelihood, nearest_maximum
from aleator.fit.question import Question, start_point
from aleator.laws import Hyperparameter, classes
from aleator.laws.classes import apart, undivided
from aleator.laws.hyperparameter import limits_of
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual import (
    Direct,
    GaussHermite,
    IndividualLikelihood,
    individual_parameters,
)
from aleator.likelihood.problem import Problem
from aleator.search import Ascent, Objective, Optimum, Search, SearchResult, WarmStart
from aleator.search.interface import OPTIMA, LogLikelihood, read, written
from aleator.simulators import Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.simulators.store import keep, kept


@dataclass(frozen=True)
class GuessSettings:
    """Where a search begins, and when two searches are the same; by judgement."""

    huge: float = 1e100
    """A residual whose square is still finite."""
    groups: int = 20
    """Groups that a mixture is guessed by, for all starts of a search that has to go on: of five
    components 3 to 4 of 7 lead to the best of two maxima that differ by 0.08."""
    same: float = 1e-2
    """Relative difference of two optima that are one but for the order of components."""
    format: int = 2
    """To be changed with what a search does, or with how its result is written."""
    probes: int = 3
    """Alphas at which two likelihoods agree in every digit of every experiment if they are the
    same."""


GUESSES = GuessSettings()


@dataclass(frozen=True)
class SampledSearch:
    """Of more than `large` experiments a search is made on a sample of `size`, its ends on all.

    An optimum of the sample lies within its standard errors of one of all, and a climb from there
    takes few evaluations. `best` are climbed from. Measured by `pytest tests/fit/test_search.py`.
    """

    large: int = 1000
    size: int = 400
    best: int = 3


SAMPLE = SampledSearch()


@dataclass(frozen=True)
class LeastSquares:
    """The one parameter point x (n,) that minimizes sum_l (y_l - eta_l(x))^2 over the box.

    `rmse` in the unit of the outcome; `log_likelihood` that of independent Normal(0, rmse^2)
    residuals, -N/2 (log(2 pi rmse^2) + 1), comparable with the identified law's.
    """

    x: Array
    rmse: float
    log_likelihood: float


@dataclass(frozen=True)
class LinearGaussian:
    """The law identified with the simulator linearized at one point (as CIRCE does).

    `alpha` (K,) and its `log_likelihood` under the linear-Gaussian model.
    """

    alpha: Array
    log_likelihood: float


def searched(
    question: Question, likelihood: AnyLikelihood, guess: Sequence[Array], ledger: Ledger
) -> SearchResult:
    """The result of the user's search, which begins at baselines of the same likelihood too.

    From a `guess` (K,) on it only climbs: what a search finds at other surfaces need not be sought
    everywhere again.
    """
    with ledger.stage("baselines"):
        fit = least_squares(likelihood, question.measured)
        known = [*guess, *_guesses(question, likelihood, fit)]
    search = WarmStart(guess[0]) if guess else question.choices.search
    hyperparameters, seed = likelihood.hyperparameters, question.seed
    maximize = partial(
        search.maximize, hyperparameters=hyperparameters, seed=seed, guesses=known,
        progress=ledger.progress,
    )  # fmt: skip
    runner = None if makes_runs(likelihood) else question.runner
    with ledger.stage(SEARCH):
        found = _kept(
            runner, search, likelihood.continued, hyperparameters, known, seed,
            lambda: by_sample(likelihood, maximize),
        )  # fmt: skip
        return ordered(found, question.inputs)


def makes_runs(likelihood: AnyLikelihood) -> bool:
    """Whether an evaluation makes runs of the simulator."""
    if isinstance(likelihood, Problem):
        return likelihood.surface is None
    return isinstance(likelihood.predictor, Direct)


# ------------------------------------------------------------------------------- many experiments


def by_sample(
    likelihood: AnyLikelihood,
    search: Callable[[Objective], SearchResult],
    settings: SampledSearch = SAMPLE,
) -> SearchResult:
    """The search made on a sample where experiments are many, then climbed on with all.

    Starts that ended at none of the best optima of the sample are left out.
    """
    if likelihood.count <= settings.large:
        return search(likelihood.continued)
    found = search(likelihood.sampled(settings.size).continued)
    optima, ascents = list[Optimum](), list[Ascent]()
    for of_sample in found.optima[: settings.best]:
        there, alpha = nearest_maximum(likelihood, of_sample.alpha)
        at = there(alpha)
        assert at.scores is not None
        led = [a for a in found.ascents if _level(a.log_likelihood, of_sample.log_likelihood)]
        ascents += [replace(a, alpha=alpha, log_likelihood=at.total) for a in led]
        known = [o for o in optima if _level(o.log_likelihood, at.total)]
        if not any(
            np.linalg.norm(at.scores @ (alpha - o.alpha)) < OPTIMA.same_place for o in known
        ):
            optima.append(Optimum(alpha, at.total, of_sample.starts))
    optima.sort(key=lambda optimum: -optimum.log_likelihood)
    best = optima[0]
    return replace(
        found, alpha=best.alpha, log_likelihood=best.log_likelihood, optima=tuple(optima),
        ascents=tuple(ascents) or found.ascents,
    )  # fmt: skip


def _level(one: float, other: float) -> bool:
    return abs(one - other) < OPTIMA.same_value


# ------------------------------------------------------------------------------------- baselines


def least_squares(likelihood: AnyLikelihood, y: Array) -> LeastSquares:
    """The one point of the box that is nearest to all observations y (M,).

    By a bounded trust-region method from the starts of the laws. Parameters that are known stay. A
    local method: it may end in a local minimum. Cost: some tens of simulations of all observations.
    """
    box = likelihood.region
    start = np.clip(start_point(likelihood.inputs), *box.T)
    return fitted(likelihood.at_point, y, box, start)


def fitted(
    simulated: Callable[[Array], tuple[Array, Array]], y: Array, box: Array, start: Array
) -> LeastSquares:
    """Least squares of a function that maps x (n,) to values (M,) with slopes (M, n)."""
    moving = moving_parameters(box)
    width = box[moving, 1] - box[moving, 0]

    def placed(u: Array) -> Array:
        x = start.copy()
        x[moving] = np.clip(box[moving, 0] + u * width, box[moving, 0], box[moving, 1])
        return x

    def at(u: Array) -> tuple[Array, Array]:
        # limits many orders too wide let a simulator overflow; the fit must only move away
        with np.errstate(all="ignore"):
            value, slopes = simulated(placed(u))
            off, jacobian = value - y, slopes[:, moving] * width
        clipped = (np.clip(np.nan_to_num(part, nan=gap), -GUESSES.huge, GUESSES.huge)
                   for part, gap in ((off, GUESSES.huge), (jacobian, 0.0)))  # fmt: skip
        residual, jacobian = clipped
        return residual, jacobian

    # just off the ends: a box may be much wider than where the law lies
    u = np.clip((start[moving] - box[moving, 0]) / width, 1e-6, 1.0 - 1e-6)
    if moving.size:
        u = optimize.least_squares(
            lambda v: at(v)[0], u, jac=lambda v: at(v)[1], bounds=(0.0, 1.0), x_scale="jac"
        ).x
    variance = float(np.mean(at(u)[0] ** 2))
    value = -0.5 * y.size * (np.log(2.0 * np.pi * max(variance, 1e-300)) + 1.0)
    return LeastSquares(placed(u), variance**0.5, float(value))


def linear_gaussian(
    inputs: Inputs, x0: Array, value: Array, slope: Array, y: Array, search: Search, seed: int
) -> LinearGaussian:
    """Identify the law with the simulator replaced by its tangent at x0 (n,).

    y_l ~ Normal(eta_l(x0) + g_l (mean - x0), g_l Cov(x) g_l') with outcomes y, values (N,) and
    slopes (N, n): the model of CIRCE (de Crecy and Bazin), maximized here by the same search.
    """
    likelihood = _GaussianModel(inputs, x0, value, slope, y)
    result = search.maximize(likelihood, inputs.hyperparameters, seed=seed)
    return LinearGaussian(result.alpha, result.log_likelihood)


def by_tangent(problem: Problem, search: Search, seed: int) -> LinearGaussian:
    """The law identified with the tangent at the start of the laws."""
    x0 = np.clip(start_point(problem.inputs), *problem.region.T)
    own = problem.inputs, x0, *problem.at_point(x0), problem.outcomes
    return linear_gaussian(*own, search, seed)


@dataclass(frozen=True)
class _GaussianModel:
    """The log-likelihood of y_l ~ Normal of the mean and sd of eta_l(x0) + g_l (x - x0)."""

    inputs: Inputs
    x0: Array
    value: Array
    slope: Array
    outcomes: Array

    def __call__(self, alpha: Array) -> LogLikelihood:
        """Value and score at alpha (K,); none where nothing scatters."""
        mean, sd, dmean, dsd = self._moments(alpha)
        some = sd > 0.0
        scale = np.where(some, sd, 1.0)
        u = (self.outcomes - mean) / scale
        each = np.where(some, -0.5 * (u**2 + np.log(2.0 * np.pi)) - np.log(scale), DEGENERATE_VALUE)
        scores = (u / scale)[:, None] * dmean + ((u**2 - 1.0) / scale)[:, None] * dsd
        status = np.where(some, int(Status.SOLVED), int(Status.DEGENERATE))
        found = LogLikelihood(each, np.where(some[:, None], scores, 0.0), status)
        return found.believed(self.inputs.hyperparameters, alpha)

    def values(self, alphas: Array) -> Array:
        """Totals (A,) at alphas (A, K)."""
        return np.array([self(alpha).total for alpha in np.asarray(alphas)])

    def _moments(self, alpha: Array) -> tuple[Array, Array, Array, Array]:
        n, k_total = self.x0.size, alpha.size
        center, spread = np.zeros(n), np.zeros(n)
        d_center, d_spread = np.zeros((n, k_total)), np.zeros((n, k_total))
        laws = zip(self.inputs.laws.values(), self.inputs.slices, strict=True)
        for i, (law, part) in enumerate(laws):
            own = law.mean_and_sd(alpha[part])
            center[i], d_center[i, part] = own.mean, own.dmean
            spread[i], d_spread[i, part] = own.sd, own.dsd
        mean = self.value + self.slope @ (center - self.x0)
        scaled = self.slope * spread
        mixed = scaled @ self.inputs.correlation_matrix(alpha)
        sd = np.sqrt(np.maximum(np.sum(mixed * scaled, axis=1), 0.0))
        safe = np.where(sd > 0.0, sd, 1.0)
        by_correlation = self.inputs.correlation_slope(alpha)
        sd_jac = (mixed * self.slope) @ d_spread / safe[:, None]
        for k in np.flatnonzero(np.any(by_correlation, axis=(0, 1))):
            sd_jac[:, k] += np.sum(scaled @ by_correlation[:, :, k] * scaled, axis=1) / (2.0 * safe)
        return mean, sd, self.slope @ d_center, sd_jac


# --------------------------------------------------------------------------------------- guesses


def _guesses(question: Question, likelihood: AnyLikelihood, fit: LeastSquares) -> list[Array]:
    """Laws about the point of least squares, from which the search starts too.

    Of exact outcomes also the law of the tangent; with noise also much narrower laws; of mixtures
    also components about groups of the experiments' own parameters.
    """
    inputs, around = question.inputs, likelihood.inputs.centered(fit.x)
    if isinstance(likelihood, Problem):
        linear = by_tangent(likelihood, question.choices.search, question.seed)
        return [around, linear.alpha]
    around = _with_noise(likelihood, around, fit.rmse)
    narrow = around.copy()
    lower, upper = limits_of(inputs.hyperparameters)
    for k, h in enumerate(inputs.hyperparameters):
        if h.log and h.free:
            narrow[k] = np.clip(0.1 * around[k], lower[k], upper[k])
    if len(inputs.classes) == 1 or inputs.covariate_model is not None:
        return [around, narrow]
    first, *others = _grouped(likelihood, fit, question.measured, question.seed)
    return [first, around, narrow, *others]


def _grouped(
    likelihood: IndividualLikelihood, fit: LeastSquares, y: Array, seed: int
) -> Iterator[Array]:
    """Mixtures about random groups of experiments, with the noise that the groups leave."""
    # wide laws leave each experiment's parameters to its observations
    inputs, alone = likelihood.inputs, undivided(likelihood.inputs)
    wide = alone.centered(fit.x)
    for k, h in enumerate(alone.hyperparameters):
        wide[k] = h.upper if h.log else wide[k]
    wide = _with_noise(likelihood, wide, fit.rmse)
    one = IndividualLikelihood.of(
        alone, likelihood.errors, likelihood.predictor, likelihood.layout, GaussHermite(1)
    )
    x = individual_parameters(one.adapted(wide), wide).mode
    for rng in np.random.default_rng(seed).spawn(GUESSES.groups):
        alpha, centers = apart(inputs, inputs.centered(fit.x), x, rng)
        residual = np.empty(y.size)
        for block in one.blocks:
            eta = one.predictor.values(block, centers[block.experiments, None])
            residual[block.rows] = eta[:, 0] - y[block.rows]
        yield _with_noise(likelihood, alpha, float(np.sqrt(np.nanmean(residual**2))))


def _with_noise(likelihood: IndividualLikelihood, of_laws: Array, rmse: float) -> Array:
    """Values (K,) of all hyperparameters: those of the laws, then errors of this size."""
    errors = likelihood.errors.hyperparameters
    sizes = [float(np.clip(rmse, h.lower, h.upper)) if h.log else h.start for h in errors]
    return np.concatenate([of_laws, sizes])


# ----------------------------------------------------------------------- order of equal components


def ordered(found: SearchResult, inputs: Inputs) -> SearchResult:
    """The search with optima merged that differ in the order of equal components only."""
    if not classes.exchangeable(inputs):
        return found
    optima: list[Optimum] = []
    for optimum in found.optima:
        alpha = in_order(optimum.alpha, inputs)
        for k, known in enumerate(optima):
            if np.allclose(known.alpha, alpha, rtol=GUESSES.same):
                optima[k] = replace(known, starts=known.starts + optimum.starts)
                break
        else:
            optima.append(replace(optimum, alpha=alpha))
    ascents = tuple(replace(a, alpha=in_order(a.alpha, inputs)) for a in found.ascents)
    return replace(found, alpha=optima[0].alpha, ascents=ascents, optima=tuple(optima))


def in_order(alpha: Array, inputs: Inputs) -> Array:
    """alpha (K,) with equal components in the order of their first hyperparameters."""
    return np.concatenate([classes.ordered(inputs, alpha[: inputs.size]), alpha[inputs.size :]])


# ----------------------------------------------------------------------------- searches are kept


def _kept(
    runner: Runner | None,
    search: Search,
    objective: Objective,
    hyperparameters: Sequence[Hyperparameter],
    guesses: Sequence[Array],
    seed: int,
    searched: Callable[[], SearchResult],
) -> SearchResult:
    """The result of a search, read from the store where the same search was made before.

    A likelihood is recognized by its values and scores at some alphas. A search that is no
    dataclass may have hidden settings, and one that makes runs counts them: both are made again.
    """
    if runner is None or runner.cache is None or not is_dataclass(search):
        return searched()
    store, fingerprint = runner.cache.store, runner.cache.identity.fingerprint
    key = _key(search, objective, hyperparameters, guesses, seed)
    known = kept(store, fingerprint, key)
    if known is not None:
        return read(known)
    found = searched()
    keep(store, fingerprint, key, written(found))
    return found


def _key(
    search: Search,
    objective: Objective,
    hyperparameters: Sequence[Hyperparameter],
    guesses: Sequence[Array],
    seed: int,
) -> str:
    """A digest of all that a search depends on."""
    digest = hashlib.sha256(repr((GUESSES.format, search, [*hyperparameters], seed)).encode())
    start = np.array([h.start for h in hyperparameters])
    for guess in guesses:
        digest.update(np.ascontiguousarray(guess).tobytes())
    with np.errstate(all="ignore"):
        for alpha in [start, *guesses][: GUESSES.probes]:
            found = objective(alpha)
            digest.update(found.each.tobytes())
            digest.update(np.ascontiguousarray(found.scores).tobytes())
    return digest.hexdigest()
