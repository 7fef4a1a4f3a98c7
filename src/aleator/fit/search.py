"""The search for the maximum of the likelihood: its starting points, sample, and stored results.

The search begins also at two baselines that an identified law must improve on: the least-squares
fit of one parameter point, and the law identified with a linearized simulator.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import partial

import numpy as np
from scipy import optimize

from aleator.core.progress import Standing
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
from aleator.likelihood.level_sets.likelihood import LEVELS
from aleator.likelihood.problem import Problem
from aleator.search import Ascent, Objective, Optimum, Search, SearchResult, WarmStart
from aleator.search.interface import OPTIMA, LogLikelihood, read, written
from aleator.simulators import Runner
from aleator.simulators.response_functions import moving_parameters
from aleator.simulators.store import keep, kept


@dataclass(frozen=True)
class GuessSettings:
    """Settings for the starting points and the stored results of a search, chosen by judgement."""

    huge: float = 1e100
    """The residual that replaces an infinite one; its square is still finite."""
    groups: int = 20
    """The number of random groupings of the experiments from which a mixture's starting points are
    computed. In a study with five components, 3 to 4 of 7 groupings led to the better of two
    maxima, whose log-likelihoods differ by 0.08."""
    same: float = 1e-2
    """The relative difference within which two optima are equal, up to the order of components."""
    format: int = 3
    """The version of stored searches; it must be raised when the search or its file changes."""
    probes: int = 3
    """The number of alphas at which log-densities are compared to recognize the same likelihood."""


GUESSES = GuessSettings()


@dataclass(frozen=True)
class SampledSearch:
    """Settings of a search of a sample of many experiments; `pytest tests/fit/test_search.py`.

    The search is made on an even sample. The likelihood of all experiments is then maximized from
    the `best` optima of the sample. These lie within the sample's standard errors of the maxima of
    all experiments, so that few evaluations are needed.
    """

    size: int = 400
    """The largest number of experiments in a sample."""
    least: int = 100
    """The smallest number of experiments in a sample: few of them do not tell a law."""
    observations: int = 10_000
    """A sample of more than `least` experiments has no more observations than this, since an
    experiment of many observations tells more and costs more. 500 curves of 100 values: the same
    maximum in less than half of the time (docs/evidence.md)."""
    times: float = 2.5
    """A sample is taken where there are more than so many times its number of experiments."""
    best: int = 3

    def number(self, experiments: int, observations: int) -> int | None:
        """The number of experiments to be sampled; None where all of them are searched.

        >>> SampledSearch().number(20_000, 20_000), SampledSearch().number(500, 50_000)
        (400, 100)
        """
        allowed = self.observations * experiments // max(observations, 1)
        found = min(self.size, max(self.least, allowed))
        return found if experiments > self.times * found else None


SAMPLE = SampledSearch()


@dataclass(frozen=True)
class LeastSquares:
    """The parameter point x (n,) that minimizes sum_l (y_l - eta_l(x))^2 within the ranges.

    `rmse` is the root mean square of the residuals, in the unit of the outcome. `log_likelihood` is
    that of independent Normal(0, rmse^2) residuals, -N/2 (log(2 pi rmse^2) + 1), which can be
    compared with the log-likelihood of the identified law, unless the noise of that is known.
    """

    x: Array
    rmse: float
    log_likelihood: float


@dataclass(frozen=True)
class LinearGaussian:
    """The law identified with the simulator linearized at one point, as in CIRCE.

    `alpha` (K,) are its hyperparameters. `log_likelihood` is the maximum in the model with a linear
    simulator and normal laws.
    """

    alpha: Array
    log_likelihood: float


def searched(
    question: Question, likelihood: AnyLikelihood, guess: Sequence[Array], ledger: Ledger
) -> SearchResult:
    """The result of the search chosen by the user, which also starts at the baselines.

    With a `guess` (K,), such as the maximum on earlier response surfaces, it is only a local
    maximization from there and from the baselines. The restricted likelihood is maximized from the
    optima of the likelihood, whose values are raised by its difference at the best.
    """
    if isinstance(likelihood, IndividualLikelihood) and likelihood.restricted:
        found = searched(question, replace(likelihood, restricted=False), guess, ledger)
        (value,) = likelihood.continued.values(found.alpha[None])
        return found.raised(value - found.log_likelihood)
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
        found = ordered(found, question.inputs)
    names = [each.name for each in hyperparameters]
    alpha = dict(zip(names, found.alpha.tolist(), strict=True))
    ledger.progress.reached(Standing(question.runner.runs, found.log_likelihood, alpha))
    return found


def makes_runs(likelihood: AnyLikelihood) -> bool:
    """Whether each evaluation of the likelihood makes runs of the simulator."""
    if isinstance(likelihood, Problem):
        return likelihood.surface is None
    return isinstance(likelihood.predictor, Direct)


# ------------------------------------------------------------------------------- many experiments


def by_sample(
    likelihood: AnyLikelihood,
    search: Callable[[Objective], SearchResult],
    settings: SampledSearch = SAMPLE,
) -> SearchResult:
    """Search on a sample of many experiments, then maximize with all of them from its best optima.

    Starts that did not end at one of these optima are left out of the result. With few experiments
    the search uses all of them at once.
    """
    measured = likelihood.outcomes if isinstance(likelihood, Problem) else likelihood.layout
    size = settings.number(likelihood.count, measured.size)
    if size is None:
        return search(likelihood.continued)
    found = search(likelihood.sampled(size).continued)
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
    """The least-squares fit of one parameter point to all observations y (M,), within the ranges.

    A bounded trust-region method starts at the laws' starting means; constants with known values
    stay fixed. It may end in a local minimum. Cost: some tens of simulations of all observations.
    """
    box = likelihood.region
    start = np.clip(start_point(likelihood.inputs), *box.T)
    return fitted(likelihood.at_point, y, box, start)


def fitted(
    simulated: Callable[[Array], tuple[Array, Array]], y: Array, box: Array, start: Array
) -> LeastSquares:
    """The least-squares fit of a function to y (M,), from a start (n,) and within ranges `box`.

    The function `simulated` maps parameters x (n,) to values (M,) with slopes (M, n).
    """
    moving = moving_parameters(box)
    width = box[moving, 1] - box[moving, 0]

    def placed(u: Array) -> Array:
        x = start.copy()
        x[moving] = np.clip(box[moving, 0] + u * width, box[moving, 0], box[moving, 1])
        return x

    def at(u: Array) -> tuple[Array, Array]:
        # Far out a simulator may overflow; the fit then only has to move away from there.
        with np.errstate(all="ignore"):
            value, slopes = simulated(placed(u))
            off, jacobian = value - y, slopes[:, moving] * width
        clipped = (np.clip(np.nan_to_num(part, nan=gap), -GUESSES.huge, GUESSES.huge)
                   for part, gap in ((off, GUESSES.huge), (jacobian, 0.0)))  # fmt: skip
        residual, jacobian = clipped
        return residual, jacobian

    # Start just inside the ends of the ranges, since the method needs an interior point.
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

    y_l ~ Normal(eta_l(x0) + G_l (mean - x0), G_l Cov(x) G_l') with m outcomes of an experiment
    y (N, m), values (N, m) and slopes G (N, m, n): the model of CIRCE (de Crecy and Bazin),
    maximized here by the same search.
    """
    likelihood = _GaussianModel(inputs, x0, value, slope, y)
    result = search.maximize(likelihood, inputs.hyperparameters, seed=seed)
    return LinearGaussian(result.alpha, result.log_likelihood)


def by_tangent(problem: Problem, search: Search, seed: int) -> LinearGaussian:
    """The law identified with the simulator linearized at the laws' starting means."""
    x0 = np.clip(start_point(problem.inputs), *problem.region.T)
    value, slope = problem.at_point(x0)
    shape = problem.count, problem.each
    own = value.reshape(shape), slope.reshape(*shape, x0.size), problem.outcomes.reshape(shape)
    return linear_gaussian(problem.inputs, x0, *own, search, seed)


@dataclass(frozen=True)
class _GaussianModel:
    """The log-likelihood of outcomes y (N, m) that are normal, of a linear simulator.

    The simulator is eta_l(x0) + G_l (x - x0) with slopes G (N, m, n) at x0 (n,).
    """

    inputs: Inputs
    x0: Array
    value: Array
    slope: Array
    outcomes: Array

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihood and its score at alpha (K,); degenerate where outcomes are certain."""
        mean, covariance, by_mean, by_covariance = self._moments(alpha)
        sign, size = np.linalg.slogdet(2.0 * np.pi * covariance)
        some = sign > 0.0
        covariance[~some] = np.eye(self.outcomes.shape[1])
        left, inverse = self.outcomes - mean, np.linalg.inv(covariance)
        u = np.einsum("nij,nj->ni", inverse, left)
        each = np.where(some, -0.5 * (np.sum(left * u, axis=1) + size), DEGENERATE_VALUE)
        bend = u[:, :, None] * u[:, None] - inverse
        scores = np.einsum("ni,nik->nk", u, by_mean)
        scores += 0.5 * np.einsum("nij,nijk->nk", bend, by_covariance)
        status = np.where(some, int(Status.SOLVED), int(Status.DEGENERATE))
        found = LogLikelihood(each, np.where(some[:, None], scores, 0.0), status)
        return found.believed(self.inputs.hyperparameters, alpha)

    def values(self, alphas: Array) -> Array:
        """The log-likelihoods (A,) at alphas (A, K)."""
        return np.array([self(alpha).total for alpha in np.asarray(alphas)])

    def _moments(self, alpha: Array) -> tuple[Array, Array, Array, Array]:
        """Means (N, m) and covariances (N, m, m), with derivatives by alpha as last axes."""
        n, k_total = self.x0.size, alpha.size
        center, spread = np.zeros(n), np.zeros(n)
        d_center, d_spread = np.zeros((n, k_total)), np.zeros((n, k_total))
        laws = zip(self.inputs.laws.values(), self.inputs.slices, strict=True)
        for i, (law, part) in enumerate(laws):
            own = law.mean_and_sd(alpha[part])
            center[i], d_center[i, part] = own.mean, own.dmean
            spread[i], d_spread[i, part] = own.sd, own.dsd
        correlation = self.inputs.correlation_matrix(alpha)
        half = (correlation * spread)[:, :, None] * d_spread[:, None]
        by_law = half + half.transpose(1, 0, 2)
        by_law += np.outer(spread, spread)[:, :, None] * self.inputs.correlation_slope(alpha)
        slope, covariance = self.slope, correlation * np.outer(spread, spread)
        return (
            self.value + slope @ (center - self.x0),
            slope @ covariance @ slope.transpose(0, 2, 1),
            slope @ d_center,
            np.einsum("nia,abk,njb->nijk", slope, by_law, slope, optimize=True),
        )


# --------------------------------------------------------------------------------------- guesses


def _guesses(question: Question, likelihood: AnyLikelihood, fit: LeastSquares) -> list[Array]:
    """Starting points of the search: alphas (K,) of laws centred at the least-squares point.

    Without noise the law of the linearized simulator is added, with noise a much narrower law. For
    mixtures, laws are added whose components are centred at groups of the experiments' parameters.
    """
    inputs, around = question.inputs, likelihood.inputs.centered(fit.x)
    if isinstance(likelihood, Problem):
        linear = by_tangent(likelihood, question.choices.search, question.seed)
        return [around, linear.alpha, *_groups_of(likelihood, fit, question.seed)]
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


def _groups_of(problem: Problem, fit: LeastSquares, seed: int) -> Iterator[Array]:
    """Starting mixtures (K,) without noise, with components centred at groups of experiments.

    The parameters of an experiment are the mean of its level set under a wide law.
    """
    inputs = problem.inputs
    if len(inputs.classes) == 1 or problem.levels is None:
        return
    alone = undivided(inputs)
    sets = problem.levels.sets(inputs.filling(problem.region, LEVELS.widths))
    wide = np.array([h.start for h in alone.hyperparameters])
    x = np.tile(fit.x, (problem.count, 1))
    for rows, points, share in sets.under(alone).points(wide):
        x[rows] = np.einsum("nk,nki->ni", share, points)
    x[sets.empty] = fit.x
    for rng in np.random.default_rng(seed).spawn(GUESSES.groups):
        yield apart(inputs, inputs.centered(fit.x), x, rng)[0]


def _grouped(
    likelihood: IndividualLikelihood, fit: LeastSquares, y: Array, seed: int
) -> Iterator[Array]:
    """Starting mixtures (K,) with components centred at random groups of the experiments.

    Their noise is the root mean square of the residuals from the group centres.
    """
    # Under wide laws each experiment's parameters depend on its observations only.
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
    """All hyperparameters (K,): those of the laws, then a measurement error of size `rmse`."""
    errors = likelihood.errors.hyperparameters
    sizes = [
        float(np.clip(rmse, h.lower, h.upper))
        if h.log and not h.name.endswith(".length")
        else h.start
        for h in errors
    ]
    return np.concatenate([of_laws, sizes])


# ----------------------------------------------------------------------- order of equal components


def ordered(found: SearchResult, inputs: Inputs) -> SearchResult:
    """The search result with optima merged that differ only in the order of equal components."""
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
    """alpha (K,) with the equal components of a mixture sorted by their first hyperparameters."""
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
    """The result of a search, read from the store if the same search was made before.

    A likelihood is recognized by its values and scores at some alphas. Two searches are always made
    again: a search that is no dataclass, since it may have hidden settings, and one that makes
    simulator runs, since these must be counted.
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
    """A hash of everything on which the result of a search depends."""
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
