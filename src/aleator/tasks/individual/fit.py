"""The fit of experiments with individual parameters: the integral, without runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import special

from aleator.inference.check import Remembered
from aleator.inference.decisions.weighted import quantiles
from aleator.inference.diagnostics.surfaces import relative_errors
from aleator.inference.fit import SPAN
from aleator.inference.information import Inference
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs, drawn
from aleator.likelihood.individual import (
    Direct,
    IndividualLikelihood,
    LawPoints,
    OnSurfaces,
    Rule,
    individual_points,
)
from aleator.likelihood.individual.importance import standard_points
from aleator.likelihood.individual.layout import Block
from aleator.likelihood.individual.moments import individual_variates, values_under_law
from aleator.likelihood.individual.rule import AsManyAsNeeded
from aleator.observations.experiments import Experiments
from aleator.search.value import LogLikelihood
from aleator.simulators import Runner
from aleator.tasks.individual.calibration import POINTS as PROBABLE
from aleator.tasks.individual.calibration import sequential_pit
from aleator.tasks.individual.virtual import censored_alike
from aleator.types import Array

MARGINAL = 2048
"""Points of the law at which an observation is measured anew, for its quantiles."""
POINTS = 256
"""Points of each experiment of which one is drawn."""
VALUES, LAW_POINTS = 120_000, (1000, 4000)
"""Simulated values by which each replicate is judged, and the points of an experiment for that."""
TRIES = 20
"""Draws of an experiment's parameters until a run of it works."""


@dataclass(frozen=True, eq=False)
class IndividualFit:
    """A `Fit`: the likelihood with nodes adapted to alpha, on surfaces or the simulator itself.

    `few` is the rule with the fewest nodes of which more hardly change the log-likelihood. The
    nodes of a `held` fit serve for other observations and the alpha of these.
    """

    likelihood: IndividualLikelihood
    alpha: Array
    inference: Inference
    table: Experiments
    few: Rule
    held: bool = False

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """Those of the laws, then those of the errors."""
        return self.likelihood.hyperparameters

    @property
    def inputs(self) -> Inputs:
        """The laws of the parameters, resolved by the covariates that they follow."""
        return self.likelihood.inputs

    @property
    def region(self) -> Array:
        """That of the surfaces; of the simulator itself the box."""
        predictor = self.likelihood.predictor
        return predictor.region if isinstance(predictor, OnSurfaces) else self.inputs.box

    @property
    def count(self) -> int:
        """N."""
        return self.likelihood.count

    def scored(self) -> LogLikelihood:
        """Log-densities (N,) with scores (N, K), nodes as they are."""
        return self._scored

    def objective(self) -> Callable[[Array], LogLikelihood]:
        """The log-likelihood by alpha: nodes follow it, but importance points, whose error does."""
        one = self.likelihood.rule.centers == 1
        return self.likelihood.continued if one else self.likelihood.__call__

    def honest(self) -> Callable[[Array], LogLikelihood]:
        """With nodes adapted to each alpha, from those here; importance points are held."""
        here = self.likelihood
        if here.rule.centers > 1 or not here.inputs.scattering:
            return here.__call__
        return lambda alpha: here.adapted(alpha)(alpha)

    def more_nodes(self, alpha: Array) -> float:
        """By the finest of the rules that tell how exact this one is, adapted to alpha."""
        here, s = self.likelihood, self.likelihood.inputs.scattering
        finer = here.rule.finer(s) if s else ()
        if not finer:
            return 0.0
        most = max(finer, key=lambda rule: rule.size(s))
        more = here.by(most, alpha).evaluate(alpha).likelihood
        return more - self.honest()(alpha).likelihood

    def probabilities(self, points: int | None = None) -> Array:
        """Of each observation given the earlier ones of its experiment, (M,)."""
        seen, points = self.table.observations, points or PROBABLE
        return sequential_pit(self.likelihood, self.alpha, seen, points)

    def rough(self) -> IndividualFit:
        """The same with few nodes."""
        return replace(self, likelihood=self.likelihood.by(self.few.rough, self.alpha))

    def for_replicates(self) -> IndividualFit:
        """By points of the law where panels would have to be sought for each data set.

        One observation leaves enough of these points near; several may not.
        """
        if not (self._alone and isinstance(self.few, AsManyAsNeeded)):
            return self.rough()
        points = LawPoints(int(np.clip(VALUES // self.count, *LAW_POINTS)))
        likelihood = self.likelihood.by(points, self.alpha)
        return replace(self, likelihood=likelihood, held=likelihood.parameters is not None)

    def at(self, alpha: Array) -> IndividualFit:
        """The same data at another alpha, nodes adapted to it."""
        return replace(self, likelihood=self._adapted(self.likelihood, alpha), alpha=alpha)

    def seeing(self, table: Experiments) -> IndividualFit:
        """The same experiments with the observations of another table, nodes adapted to these."""
        errors = self.likelihood.errors.of_others(table.observations)
        likelihood = self._adapted(replace(self.likelihood, errors=errors), self.alpha)
        return replace(self, likelihood=likelihood, table=table)

    def drawn(self, rng: np.random.Generator) -> IndividualFit:
        """Other observations, with bounds like those of the table (see `censored_alike`).

        An experiment whose run fails is drawn again, at most twenty times.
        """
        likelihood, seen = self.likelihood, self.table.observations
        of_errors = self.alpha[likelihood.inputs.size :]
        eta = self._simulated(rng)
        uniform = rng.random(eta.shape)
        y = likelihood.errors.quantile(of_errors, uniform, eta, slice(0, len(seen)))[:, 0]
        return self.seeing(self.table.with_observations(censored_alike(seen, y, rng)))

    def span(self) -> tuple[Array, Array]:
        """Ends (M,): seven standard deviations about the mean of what would be measured."""
        likelihood, of_errors = self.likelihood, self.alpha[self.likelihood.inputs.size :]
        middle, reach = np.empty((2, len(self.table.observations)))
        for block, eta, share in values_under_law(likelihood, self.alpha, POINTS):
            scale = likelihood.errors.scale(of_errors, eta, block.rows)
            mean = np.sum(share * eta, axis=1)
            second = np.sum(share * ((eta - mean[:, None]) ** 2 + scale**2), axis=1)
            middle[block.rows], reach[block.rows] = mean, SPAN * np.sqrt(second)
        return middle - reach, middle + reach

    def quantiles(self, probabilities: Array) -> Array:
        """Those (M, P) of one measurement at each of 2048 points of the law and the error (Sobol).

        Exact to some hundredths of a standard deviation. NaN where no run gives a value.
        """
        likelihood, inputs = self.likelihood, self.likelihood.inputs
        classes = len(inputs.classes)
        joint = standard_points(MARGINAL, inputs.scattering + 1)
        points, uniform = joint[:, :-1], np.tile(special.ndtr(joint[:, -1]), classes)
        found = np.full((len(self.table.observations), probabilities.size), np.nan)
        for block in likelihood.layout.blocks(MARGINAL * classes):
            xi = np.tile(points, (len(block), classes, 1))
            law = inputs.individual(self.alpha[: inputs.size], xi, block.experiments)
            with np.errstate(all="ignore"):
                eta = likelihood.predictor.values(block, law.x)
            share = np.exp(np.broadcast_to(law.log_weight, law.x.shape[:2]))[block.owner]
            level = np.broadcast_to(uniform[: eta.shape[1]], eta.shape)
            y = likelihood.errors.quantile(self.alpha[inputs.size :], level, eta, block.rows)
            found[block.rows] = quantiles(y, share, probabilities)
        return found

    def individuals(self, rng: np.random.Generator) -> Array:
        """A draw (N, n) of each experiment's parameters given its observations."""
        found = np.empty((self.count, len(self.inputs.names)))
        for block in self.likelihood.layout.blocks(POINTS):
            x, share = individual_points(self.likelihood, self.alpha, block, POINTS)
            reached = np.cumsum(share, axis=1)
            level = rng.random((len(block), 1)) * reached[:, -1:]
            chosen = np.minimum(np.sum(reached < level, axis=1), share.shape[1] - 1)
            found[block.experiments] = x[np.arange(len(block)), chosen]
        return found

    def variates(self) -> tuple[Array, Array] | None:
        """Means (N, s) and mean products (N, s, s) by the nodes."""
        if self._alone:
            return None
        return individual_variates(self.likelihood, self.alpha)

    def given(self, x: Array) -> Array:
        """log p(observations | parameters) (N, J) at points x (J, n), the same for all."""
        likelihood = self.likelihood
        found = np.empty((self.count, len(x)))
        for block in likelihood.layout.blocks(len(x)):
            points = np.broadcast_to(x, (len(block), *x.shape))
            with np.errstate(all="ignore"):
                eta = likelihood.predictor.values(block, points)
                found[block.experiments] = likelihood.sums_of(self.alpha, block, eta)
        return found

    @property
    def roughness(self) -> Array | None:
        """Over the noise, (M,)."""
        predictor = self.likelihood.predictor
        if not isinstance(predictor, OnSurfaces):
            return None
        return relative_errors(predictor.surface)[predictor.of]

    def simulated(self, x: Array) -> Array:
        """Values (M, J) of the surfaces, or of the simulator, at points x (J, n)."""
        likelihood, found = self.likelihood, np.empty((len(self.table.observations), len(x)))
        for block in likelihood.layout.blocks(len(x)):
            points = np.broadcast_to(x, (len(block), *x.shape))
            with np.errstate(all="ignore"):
                found[block.rows] = likelihood.predictor.values(block, points)
        return found

    def nodes(self) -> None:
        """None: see `simulated`."""
        return

    def on(self, runner: Runner) -> IndividualFit:
        """The same by the simulator itself: values are runs, which are remembered and stored."""
        known = np.zeros(0, dtype=np.intp)
        simulator = Direct(Remembered(runner), known, self.inputs.box)
        return replace(self, likelihood=replace(self.likelihood, predictor=simulator))

    @cached_property
    def _scored(self) -> LogLikelihood:
        return self.likelihood(self.alpha)

    @property
    def _alone(self) -> bool:
        """Whether each experiment has one observation."""
        return len(self.table.observations) == self.count

    def _adapted(self, likelihood: IndividualLikelihood, alpha: Array) -> IndividualLikelihood:
        return likelihood if self.held else likelihood.adapted(alpha)

    def _simulated(self, rng: np.random.Generator) -> Array:
        """Values (M, 1) of runs at parameters drawn from the law of each experiment."""
        likelihood = self.likelihood
        inputs, eta = likelihood.inputs, np.full((len(self.table.observations), 1), np.nan)
        for _ in range(TRIES):
            x = drawn(inputs, self.alpha[: inputs.size], self.count, rng)
            for block in likelihood.layout.blocks(1):
                eta[block.rows] = self._kept(block, eta[block.rows], x[block.experiments])
            if np.all(np.isfinite(eta)):
                break
        return eta

    def _kept(self, block: Block, known: Array, x: Array) -> Array:
        """Values (m, 1) at x (B, n) where an experiment of the block lacks one; the known ones."""
        lacking = block.summed(np.isnan(known).astype(float)) > 0.0
        if not np.any(lacking):
            return known
        found = self.likelihood.predictor.values(block, x[:, None])
        return np.where(lacking[block.owner], found, known)
