"""The answer on surfaces, checked by a few runs of the simulator itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.likelihood.individual import Direct, Evaluator, GaussHermite
from aleator.likelihood.individual.layout import Block
from aleator.likelihood.individual.likelihood import IndividualLikelihood, mean_of
from aleator.simulators import Runner
from aleator.surrogates import AdaptiveSurfaces
from aleator.types import Array, Flags, Indices

RULES = (GaussHermite(1), GaussHermite(5), GaussHermite(3))
"""The nodes of the check, by the number of variates; for more than two as for two."""
POINTS, FEW = 12, 2
"""Runs of each unit, at most, and where surfaces expect hardly an error."""
EXACT = 1e-3
"""Estimated error of a surface over the noise, below which it can hardly matter."""


@dataclass(frozen=True, eq=False)
class Checked:
    """What the simulator changes of each log-likelihood (N,), and the error of that (N,)."""

    change: Array
    error: Array

    @property
    def total(self) -> float:
        """The change of the log-likelihood."""
        return float(self.change.sum())

    @property
    def standard_error(self) -> float:
        """The standard error of the total."""
        return float(np.sqrt(np.sum(self.error**2)))


def points(surfaces: AdaptiveSurfaces) -> int:
    """Runs of each unit, at most, that check surfaces with the errors that these expect."""
    return FEW if surfaces.relative.max() < EXACT else POINTS


def checked(
    likelihood: IndividualLikelihood, alpha: Array, runner: Runner, most: int = POINTS
) -> Checked:
    """Compare surfaces and simulator where each experiment's own law of the parameters lies.

    log L_simulator - log L_surface = log sum_j w_j exp(l_simulator(x_j)) - the same on surfaces,
    with l(x) = sum_k log p(y_k | eta_k(x)), at the same few nodes: what these nodes miss is missed
    by both. Of more than `most` nodes the likeliest are taken. A node whose run failed is left out,
    as surfaces do, unless all of an experiment are. The error is as if the ratios at the nodes were
    a stratified sample: it is rough. Cost: up to twelve runs a unit, which are remembered and
    stored.
    """
    inputs = likelihood.inputs
    few = likelihood
    if isinstance(likelihood.rule, GaussHermite):
        few = likelihood.by(RULES[min(inputs.scattering, len(RULES) - 1)], alpha)
    simulator = Direct(Remembered(runner), np.zeros(0, dtype=np.intp), inputs.box)
    change, error = np.zeros(likelihood.count), np.zeros(likelihood.count)
    for block in few.blocks:
        part = block.experiments
        x, log_weight = _likeliest(few, alpha, block, most)
        eta = simulator.values(block, x)
        lost = _lost(block, eta)
        by_surface = few.sums_of(alpha, block, few.predictor.values(block, x)) + log_weight
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
    return Checked(change, np.nan_to_num(error, nan=np.inf))


def _lost(block: Block, eta: Array) -> Flags:
    """Nodes (B, J) where a run failed, of experiments that have others."""
    failed = block.summed(np.isnan(eta).astype(float)) > 0.0
    return np.asarray(failed & ~np.all(failed, axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class Remembered(Evaluator):
    """The runs of a runner, kept."""

    runner: Runner

    def straight(self, unit: Indices, x: Array) -> Array:
        """Values (R, W), NaN where a run failed."""
        return self.runner.values(unit, x)


def _likeliest(
    likelihood: IndividualLikelihood, alpha: Array, block: Block, most: int
) -> tuple[Array, Array]:
    """The nodes with the largest shares as parameters x (B, P, n), and their log weights (B, P)."""
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
