"""The two kinds of likelihood with data at one alpha, with one interface; without simulator runs.

`OutcomesAt` is the likelihood of exact outcomes, by level sets or moments. `IndividualsAt` is the
integral over each experiment's own parameters, with nodes adapted to alpha.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from aleator.core.types import Array, Flags
from aleator.errors import NOISE, InputsError
from aleator.inference.alpha_draws import quantiles
from aleator.inference.calibration import censored_pit, sequential_pit
from aleator.inference.check import Remembered
from aleator.inference.surface_diagnostics import relative_errors
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs, drawn
from aleator.laws.mixture import Mixture
from aleator.likelihood.individual import (
    Direct,
    GaussHermite,
    IndividualLikelihood,
    LawPoints,
    NodeRule,
    OnSurfaces,
    individual_points,
)
from aleator.likelihood.individual.modes import DenseRule
from aleator.likelihood.individual.panels import panels_of
from aleator.likelihood.individual.posterior import (
    IndividualParameters,
    individual_variates,
    values_under_law,
)
from aleator.likelihood.individual.predictors import Block
from aleator.likelihood.individual.rules import standard_points
from aleator.likelihood.problem import Problem
from aleator.observations.responses import Observations
from aleator.search.interface import LogLikelihood, Scored
from aleator.simulators import Runner
from aleator.simulators.response_functions import DirectResponse, OutcomeDistribution


@dataclass(frozen=True)
class FitSettings:
    """Settings of drawn data and of predicted ranges. The values are chosen by judgement.

    span: standard deviations from the mean within which outcomes are taken to lie.
    farthest, tabulated: a density from moments is replaced by so many quantiles when outcomes are
    drawn, at normal scores from -`farthest` to `farthest`.
    points: points of the law of each experiment, one of which is drawn.
    marginal: points of the law of each experiment by which quantiles are computed.
    values, law_points: a replicate is evaluated with about `values` simulated values in total; the
    points of each experiment have a least and a largest number. The measured data get the same
    points, so that p keeps its meaning; with three times as many the fission gas has 0.085, not
    0.080.
    tries: largest number of draws for an experiment whose run fails.
    """

    span: float = 7.0
    farthest: float = 6.0
    tabulated: int = 81
    points: int = 256
    marginal: int = 2048
    values: int = 40_000
    law_points: tuple[int, int] = (1000, 4000)
    tries: int = 20


FIT = FitSettings()


def _without_noise() -> InputsError:
    return InputsError(
        "without measurement noise an outcome has no density given its parameters",
        f"add {NOISE}; it may be small",
    )


@dataclass(frozen=True, eq=False)
class OutcomesAt:
    """The likelihood without noise: of several exact outcomes of each experiment, or of one.

    One outcome may be censored.
    """

    problem: Problem
    alpha: Array
    settings: FitSettings = FIT

    @property
    def inputs(self) -> Inputs:
        """The laws of the parameters."""
        return self.problem.model.inputs

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters in the order of alpha."""
        return self.problem.model.hyperparameters

    @property
    def count(self) -> int:
        """The number N of experiments."""
        return self.problem.count

    @property
    def region(self) -> Array:
        """Ranges (n, 2) of the parameters in which simulated values are known.

        These are the ranges of the surfaces; without surfaces those of the laws.
        """
        return self.problem.region

    @property
    def roughness(self) -> Array | None:
        """The estimated error of each surface over the outcome's scatter (M,), or None."""
        surface, of = self.problem.surface, self.problem.condition
        return None if surface is None else relative_errors(surface)[of]

    def scored(self) -> LogLikelihood:
        """Log-densities (N,) of the outcomes and scores (N, K) at alpha.

        Level sets are kept for the fits of the same data at other alphas.
        """
        return (self.problem.levels or self.problem.continued)(self.alpha)

    def log_likelihood(self) -> float:
        """The log-likelihood without priors; minus infinity if an outcome is impossible."""
        return self.problem.likelihood.evaluate(self.alpha).likelihood

    def objective(self) -> Scored:
        """The log-likelihood for a search: extrapolated where an outcome is impossible."""
        return self.problem.continued

    def honest(self) -> Scored:
        """The log-likelihood for a sampler: minus infinity where an outcome is impossible."""
        return self.problem.likelihood

    def more_nodes(self, alpha: Array) -> float:
        """The change of the log-likelihood at alpha when the number of nodes is raised by half.

        It is zero for collocation, where more nodes would need more runs.
        """
        return self.problem.gap(alpha)

    def rough(self) -> OutcomesAt:
        """The likelihood with level sets on coarser grids; the nodes of moments stay the same."""
        return replace(self, problem=self.problem.coarse())

    def for_replicates(self) -> tuple[OutcomesAt, bool]:
        """The likelihood with fast nodes for many data sets, and whether its maximum differs.

        Where the maximum differs, alpha must be moved to it.
        """
        levels = self.problem.levels is not None
        return (self.rough() if levels else self), levels

    def at(self, alpha: Array) -> OutcomesAt:
        """The likelihood of the same outcomes at another alpha."""
        return replace(self, alpha=alpha)

    def seeing(self, seen: Observations) -> OutcomesAt:
        """The likelihood of other outcomes, taken from the observations `seen`."""
        return replace(self, problem=self.problem.with_outcomes(seen.numbers, seen.bounds))

    def drawn(self, seen: Observations, rng: np.random.Generator) -> Observations:
        """Outcomes drawn under the law of alpha, censored like those seen.

        With surfaces they are values of the surfaces, with level sets of a direct simulator they
        are simulated values. With collocation they are quantiles of the computed densities; an
        outcome whose density failed stays as it is.
        """
        y = self._drawn(rng)
        if np.any(seen.censored):
            return censored_alike(seen, y, rng)
        return replace(seen, lower=y, upper=y)

    def probabilities(self, seen: Observations, points: int | None) -> Array:  # noqa: ARG002
        """P(outcome below the measured one | earlier ones of its experiment, alpha) (M,).

        Under the right alpha these probabilities are independent and uniform. A censored outcome
        gets a random probability between those of its bounds.
        """
        problem = self.problem
        if problem.bounds is not None:
            low, high = (self._under.cdf(end) for end in problem.bounds)
            return censored_pit(low, high)
        alone = self._under.cdf(problem.outcomes)
        if problem.each == 1:
            return alone
        assert problem.levels is not None
        return problem.levels.probabilities(self.alpha, alone[:: problem.each]).ravel()

    def span(self) -> tuple[Array, Array]:
        """Low and high ends (M,) of the range of each outcome, within the possible values."""
        under, ends, far = self._under, self.problem.predictor, self.settings.span
        low, high = under.mean - far * under.sd, under.mean + far * under.sd
        return np.maximum(ends.lower, low), np.minimum(ends.upper, high)

    def quantiles(self, probabilities: Array) -> Array:
        """Quantiles (M, P) of each outcome under the law of alpha."""
        return self._under.quantile(probabilities)

    def simulated(self, x: Array) -> Array | None:
        """The simulated outcomes (M, J) at points x (J, n); None with collocation."""
        if not self.problem.free:
            return None
        return self.problem.response.evaluate(x)[self.problem.condition]

    def nodes(self) -> tuple[Array, Array] | None:
        """The nodes x (J, n) of collocation and their outcomes (M, J); None with another method."""
        if self.problem.free:
            return None
        x = self.problem.nodes(self.alpha)
        return x, self.problem.response.evaluate(x)[self.problem.condition]

    def variates(self) -> tuple[Array, Array] | None:
        """Means (N, s) and mean products (N, s, s) of the normal scores, given the outcomes.

        None with one outcome for each experiment, which does not determine a single parameter.
        """
        return None if self.problem.each == 1 else self._scores_on_level_sets()

    def _scores_on_level_sets(self) -> tuple[Array, Array]:
        """The means (N, s) and mean products (N, s, s) of `variates`."""
        levels, inputs, s = self.problem.levels, self.inputs, self.inputs.scattering
        assert levels is not None
        means, products = np.zeros((self.count, s)), np.zeros((self.count, s, s))
        for rows, x, share in levels.sets(self.alpha).points(self.alpha):
            row, point = np.nonzero(share)
            theta = np.zeros((*share.shape, s))
            for k, i in enumerate(inputs.scattered):
                theta[row, point, k] = inputs.normal_score(i, self.alpha, x[row, point])
            means[rows] = np.einsum("nk,nks->ns", share, theta)
            products[rows] = np.einsum("nk,nks,nkt->nst", share, theta, theta)
        return means, products

    def on_level_sets(self) -> IndividualParameters:
        """The parameters of each experiment, given its outcomes, which lie on its level set.

        The predicted values are those under the law, since those on the set are as measured.
        """
        levels, inputs, alpha = self.problem.levels, self.inputs, self.alpha
        assert levels is not None
        mean, spread, mode = np.zeros((3, self.count, len(inputs.names)))
        mixtures = [
            (i, name, law) for i, (name, law) in enumerate(inputs.laws.items())
            if isinstance(law, Mixture)
        ]  # fmt: skip
        components = {
            name: np.zeros((self.count, len(law.components))) for _, name, law in mixtures
        }  # fmt: skip
        for rows, x, share in levels.sets(alpha).points(alpha):
            mean[rows] = np.einsum("nk,nki->ni", share, x)
            spread[rows] = np.einsum("nk,nki->ni", share, (x - mean[rows][:, None]) ** 2)
            mode[rows] = x[np.arange(rows.size), np.argmax(share, axis=1)]
            for i, name, law in mixtures:
                each = law.probabilities(alpha[inputs.slices[i]], x[..., i])
                components[name][rows] = np.einsum("nk,cnk->nc", share, each)
        shrinkage = np.full(len(inputs.names), np.nan)
        shrinkage[[*inputs.scattered]] = 1.0 - self._scores_on_level_sets()[0].std(axis=0)
        return IndividualParameters(
            mode, mean, np.sqrt(spread), self._under.mean, shrinkage, components
        )

    def individuals(self, rng: np.random.Generator) -> Array:  # noqa: ARG002
        """Raises InputsError: without noise an experiment's parameters have no law of their own."""
        raise _without_noise()

    def log_density_at(self, x: Array) -> Array:  # noqa: ARG002
        """Raises InputsError: without noise an outcome has no density given the parameters."""
        raise _without_noise()

    def _drawn(self, rng: np.random.Generator) -> Array:
        """Drawn outcomes (N,), each at its own draw of the parameters, which may be far out."""
        problem = self.problem
        direct = problem.levels is not None and isinstance(problem.response, DirectResponse)
        if not direct and problem.surface is None:
            return self._from_densities(rng)
        x = self.inputs.sample(self.alpha, rng.random((self.count, len(self.inputs.names))))
        x = np.repeat(x, problem.each, axis=0)
        if isinstance(problem.response, DirectResponse):
            return problem.response.run(problem.condition, x)
        assert problem.surface is not None
        inside = np.clip(x, *problem.region.T)
        return problem.surface.at(problem.condition, inside[:, problem.moving])

    def _from_densities(self, rng: np.random.Generator) -> Array:
        score, table = self._quantiles
        drawn = rng.standard_normal(self.count)
        place = np.clip(np.searchsorted(score, drawn) - 1, 0, score.size - 2)
        share = np.clip((drawn - score[place]) / (score[place + 1] - score[place]), 0.0, 1.0)
        rows = np.arange(self.count)
        y = (1.0 - share) * table[rows, place] + share * table[rows, place + 1]
        return np.where(np.isfinite(y), y, self.problem.outcomes)

    @cached_property
    def _under(self) -> OutcomeDistribution:
        return self.problem.predictor.under(self.alpha)

    @cached_property
    def _quantiles(self) -> tuple[Array, Array]:
        """Normal scores (Q,), and the quantiles (N, Q) of the outcomes at their probabilities."""
        far = self.settings.farthest
        score = np.linspace(-far, far, self.settings.tabulated)
        return score, self._under.quantile(special.ndtr(score))


@dataclass(frozen=True, eq=False)
class IndividualsAt:
    """The integral over each experiment's own parameters, on surfaces or on the simulator itself.

    `fewest` is the rule with the fewest nodes that is accurate enough: more nodes hardly change the
    log-likelihood. With `kept`, the same nodes also serve other observations and other values of
    alpha; otherwise nodes are adapted to each.
    """

    integral: IndividualLikelihood
    alpha: Array
    fewest: NodeRule
    kept: bool = False
    settings: FitSettings = FIT

    @property
    def inputs(self) -> Inputs:
        """The laws of the parameters, with the covariates that they follow."""
        return self.integral.inputs

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """The hyperparameters of the laws, followed by those of the measurement errors."""
        return self.integral.hyperparameters

    @property
    def count(self) -> int:
        """The number N of experiments."""
        return self.integral.count

    @property
    def region(self) -> Array:
        """Ranges (n, 2) of the parameters in which simulated values are known.

        These are the ranges of the surfaces; without surfaces those of the laws.
        """
        predictor = self.integral.predictor
        return predictor.region if isinstance(predictor, OnSurfaces) else self.inputs.box

    @property
    def roughness(self) -> Array | None:
        """The estimated error of each observation's surface over the noise (M,), or None."""
        predictor = self.integral.predictor
        if not isinstance(predictor, OnSurfaces):
            return None
        return relative_errors(predictor.surface)[predictor.of]

    def scored(self) -> LogLikelihood:
        """Log-densities (N,) at alpha with scores (N, K), with the present nodes."""
        return self.integral(self.alpha)

    def log_likelihood(self) -> float:
        """The log-likelihood without priors, with the present nodes."""
        return self.integral.evaluate(self.alpha).likelihood

    def objective(self) -> Scored:
        """The log-likelihood as a function of alpha for a search.

        Nodes follow alpha; importance points stay where they are.
        """
        one = self.integral.rule.centers == 1
        return self.integral.continued if one else self.integral.__call__

    def honest(self) -> Scored:
        """The log-likelihood as a function of alpha for a sampler.

        Nodes are adapted to each alpha; importance points stay where they are.
        """
        here = self.integral
        if here.rule.centers > 1 or not here.inputs.scattering:
            return here.__call__
        return lambda alpha: here.adapted(alpha)(alpha)

    def more_nodes(self, alpha: Array) -> float:
        """The change of the log-likelihood at alpha when the rule with the most nodes is used."""
        here, s = self.integral, self.inputs.scattering
        finer = here.rule.finer(s) if s else ()
        if not finer:
            return 0.0
        most = max(finer, key=lambda rule: rule.size(s))
        more = here.by(most, alpha).evaluate(alpha).likelihood
        return more - self.honest()(alpha).likelihood

    def rough(self) -> IndividualsAt:
        """The likelihood with the coarsest rule that is accurate enough."""
        return replace(self, integral=self.integral.by(self.fewest.rough, self.alpha))

    def ruled(self, rule: NodeRule, which: Flags) -> IndividualsAt:
        """The likelihood of the experiments `which` (N,) with another rule; see `Fit.ruled`."""
        return replace(self, integral=self.integral.only(which).ruled(rule))

    @property
    def panels(self) -> DenseRule | None:
        """The panels that can take the place of nodes about one mode.

        None where there are no such nodes, or no panels for so many scattering parameters.
        """
        about_modes = isinstance(self.integral.rule, GaussHermite)
        return panels_of(self.inputs.scattering) if about_modes else None

    def for_replicates(self) -> tuple[IndividualsAt, bool]:
        """The likelihood with nodes that evaluate many data sets quickly.

        With one observation for each experiment, points of the law replace rules that would have to
        be rebuilt for each data set: enough of these points agree with the observation. With
        several observations they may not. The second value says whether alpha must be moved; it is
        False.
        """
        if not (self._alone and isinstance(self.fewest, DenseRule)):
            return self.rough(), False
        points = int(np.clip(self.settings.values // self.count, *self.settings.law_points))
        integral = self.integral.by(LawPoints(points), self.alpha)
        return replace(self, integral=integral, kept=integral.parameters is not None), False

    def at(self, alpha: Array) -> IndividualsAt:
        """The likelihood at another alpha; nodes are adapted to it, unless they are kept."""
        return replace(self, integral=self._adapted(self.integral, alpha), alpha=alpha)

    def seeing(self, seen: Observations) -> IndividualsAt:
        """The likelihood of other observations; nodes are adapted, unless they are kept."""
        other = replace(self.integral, errors=self.integral.errors.of_others(seen))
        return replace(self, integral=self._adapted(other, self.alpha))

    def drawn(self, seen: Observations, rng: np.random.Generator) -> Observations:
        """Observations drawn under the law and the noise of alpha, censored like those seen."""
        eta = self._simulated(rng)
        uniform = rng.random(eta.shape)
        y = self.integral.errors.drawn(self._of_errors, uniform, eta, slice(0, len(seen)))[:, 0]
        return censored_alike(seen, y, rng)

    def probabilities(self, seen: Observations, points: int | None) -> Array:
        """P(value below the measured one | earlier ones of its experiment, alpha) (M,).

        Under the right alpha these probabilities are independent and uniform; see `sequential_pit`.
        """
        return sequential_pit(self.integral, self.alpha, seen, points)

    def span(self) -> tuple[Array, Array]:
        """Low and high ends (M,) of each observation's range, but for one in many thousands."""
        middle, reach = np.empty((2, self._observations))
        for block, eta, share in values_under_law(self.integral, self.alpha, self.settings.points):
            scale = self.integral.errors.scale(self._of_errors, eta, block.rows)
            mean = np.sum(share * eta, axis=1)
            second = np.sum(share * ((eta - mean[:, None]) ** 2 + scale**2), axis=1)
            middle[block.rows], reach[block.rows] = mean, self.settings.span * np.sqrt(second)
        return middle - reach, middle + reach

    def quantiles(self, probabilities: Array) -> Array:
        """Quantiles (M, P) of what would be measured in place of each observation.

        For each observation one measurement is simulated at each of many points of the law and the
        error (Sobol'); the quantiles are exact to some hundredths of a standard deviation. NaN
        where no run gives a value.
        """
        integral, inputs, count = self.integral, self.inputs, self.settings.marginal
        classes = len(inputs.classes)
        joint = standard_points(count, inputs.scattering + 1)
        points, uniform = joint[:, :-1], np.tile(special.ndtr(joint[:, -1]), classes)
        found = np.full((self._observations, probabilities.size), np.nan)
        for block in integral.layout.blocks(count * classes):
            xi = np.tile(points, (len(block), classes, 1))
            law = inputs.individual(self.alpha[: inputs.size], xi, block.experiments)
            with np.errstate(all="ignore"):
                eta = integral.predictor.values(block, law.x)
            share = np.exp(np.broadcast_to(law.log_weight, law.x.shape[:2]))[block.owner]
            level = np.broadcast_to(uniform[: eta.shape[1]], eta.shape)
            y = integral.errors.quantile(self._of_errors, level, eta, block.rows)
            found[block.rows] = quantiles(y, share, probabilities)
        return found

    def simulated(self, x: Array) -> Array:
        """Simulated values (M, J) at points x (J, n), by the surfaces or the simulator."""
        found = np.empty((self._observations, len(x)))
        for block in self.integral.layout.blocks(len(x)):
            points = np.broadcast_to(x, (len(block), *x.shape))
            with np.errstate(all="ignore"):
                found[block.rows] = self.integral.predictor.values(block, points)
        return found

    def nodes(self) -> None:
        """None: `simulated` gives values at any point, so that no nodes are needed."""

    def variates(self) -> tuple[Array, Array] | None:
        """Means (N, s) and mean products (N, s, s) of the normal variates, given the observations.

        The law makes the parameters from these variates, which are standard normal under the law.
        None with one observation for each experiment, which does not determine a single parameter.
        """
        return None if self._alone else individual_variates(self.integral, self.alpha)

    def individuals(self, rng: np.random.Generator) -> Array:
        """A draw (N, n) of the parameters of each experiment, given its observations.

        Under the right model these draws are a sample of the law.
        """
        found, count = np.empty((self.count, len(self.inputs.names))), self.settings.points
        for block in self.integral.layout.blocks(count):
            x, share = individual_points(self.integral, self.alpha, block, count)
            reached = np.cumsum(share, axis=1)
            level = rng.random((len(block), 1)) * reached[:, -1:]
            chosen = np.minimum(np.sum(reached < level, axis=1), share.shape[1] - 1)
            found[block.experiments] = x[np.arange(len(block)), chosen]
        return found

    def log_density_at(self, x: Array) -> Array:
        """log p(observations of an experiment | parameters) (N, J) at points x (J, n)."""
        found = np.empty((self.count, len(x)))
        for block in self.integral.layout.blocks(len(x)):
            points = np.broadcast_to(x, (len(block), *x.shape))
            with np.errstate(all="ignore"):
                eta = self.integral.predictor.values(block, points)
                found[block.experiments] = self.integral.sums_of(self.alpha, block, eta)
        return found

    def on(self, runner: Runner) -> IndividualsAt:
        """The likelihood with the simulator in place of surfaces; its runs are stored."""
        no_parameters = np.zeros(0, dtype=np.intp)
        simulator = Direct(Remembered(runner), no_parameters, self.inputs.box)
        return replace(self, integral=replace(self.integral, predictor=simulator))

    @property
    def _of_errors(self) -> Array:
        """The hyperparameters of the measurement errors."""
        return self.alpha[self.inputs.size :]

    @property
    def _observations(self) -> int:
        """M, the number of observations."""
        return int(self.integral.layout.experiment.size)

    @property
    def _alone(self) -> bool:
        """Whether each experiment has one observation only, and shares no parameters."""
        return self._observations == self.count and self.inputs.grouping is None

    def _adapted(self, integral: IndividualLikelihood, alpha: Array) -> IndividualLikelihood:
        return integral if self.kept else integral.adapted(alpha)

    def _simulated(self, rng: np.random.Generator) -> Array:
        inputs, eta = self.inputs, np.full((self._observations, 1), np.nan)
        for _ in range(self.settings.tries):
            x = drawn(inputs, self.alpha[: inputs.size], self.count, rng)
            for block in self.integral.layout.blocks(1):
                eta[block.rows] = self._completed(block, eta[block.rows], x[block.experiments])
            if np.all(np.isfinite(eta)):
                break
        return eta

    def _completed(self, block: Block, eta: Array, x: Array) -> Array:
        """Simulated values (m, 1), with new runs at x (B, n) for experiments that lack a value."""
        lacking = block.summed(np.isnan(eta).astype(float)) > 0.0
        if not np.any(lacking):
            return eta
        found = self.integral.predictor.values(block, x[:, None])
        return np.where(lacking[block.owner], found, eta)


LikelihoodAt = OutcomesAt | IndividualsAt
"""The likelihood of N experiments with M observations at one alpha (K,).

It is immutable: a method that changes something returns another likelihood. Both kinds have the
same methods.
"""


def censored_alike(seen: Observations, y: Array, rng: np.random.Generator) -> Observations:
    """Values y (M,) with censoring like that of the observations that were seen.

    If all right-censored values of a response have the same bound, it is a limit of the test, and
    every value above it is censored. If their bounds differ, only the observations that were
    censored before are censored again, each where its value lies above its bound. Left-censored
    values are treated likewise. An interval is replaced by one of the same width at a random
    position about the value.
    """
    lower, upper = y.copy(), y.copy()
    for right in (True, False):
        known, other = (seen.lower, seen.upper) if right else (seen.upper, seen.lower)
        censored = np.isinf(other) & np.isfinite(known)
        bound = np.where(censored, known, np.nan)
        for k in range(len(seen.responses)):
            own = seen.response == k
            bounds = np.unique(bound[own & censored])
            if bounds.size == 1:
                bound[own] = bounds[0]
        with np.errstate(invalid="ignore"):
            beyond = y > bound if right else y < bound
        lower[beyond] = bound[beyond] if right else -np.inf
        upper[beyond] = np.inf if right else bound[beyond]
    between = np.isfinite(seen.lower) & np.isfinite(seen.upper) & ~seen.measured
    width = np.where(between, seen.upper - seen.lower, 0.0)
    below = width * rng.random(len(y))
    lower[between] = (y - below)[between]
    upper[between] = (y - below + width)[between]
    return replace(seen, lower=lower, upper=upper)
