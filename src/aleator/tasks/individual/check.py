"""The answer on surfaces, checked by a few runs of the simulator itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.likelihood.individual import Direct, Evaluator
from aleator.likelihood.individual.layout import Block
from aleator.likelihood.individual.likelihood import IndividualLikelihood, mean_of
from aleator.simulators import Runner
from aleator.types import Array, Indices

POINTS = 8
"""Runs of each unit."""


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


def checked(likelihood: IndividualLikelihood, alpha: Array, runner: Runner) -> Checked:
    """Compare surfaces and simulator where each experiment's own law of the parameters lies.

    L_simulator / L_surface = E[exp(l_simulator(x) - l_surface(x))] over the individual law of x on
    the surfaces, with l(x) = sum_k log p(y_k | eta_k(x)): the mean over eight of its quantiles
    along the nodes. Its variance is that of a small difference. Cost: eight runs a unit, which are
    remembered and stored.
    """
    box = likelihood.inputs.box
    simulator = Direct(_Remembered(runner), np.zeros(0, dtype=np.intp), box)
    change, error = np.zeros(likelihood.count), np.zeros(likelihood.count)
    for block in likelihood.blocks:
        part = block.experiments
        xi = _drawn(likelihood, alpha, block)
        x = likelihood.inputs.individual(alpha[: likelihood.inputs.size], xi, part).x
        ratio = np.exp(
            _sums(likelihood, alpha, block, simulator.values(block, x))
            - _sums(likelihood, alpha, block, likelihood.predictor.values(block, x))
        )
        mean = ratio.mean(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            change[part] = np.log(mean)
            error[part] = ratio.std(axis=1, ddof=1) / np.sqrt(POINTS) / mean
    return Checked(change, np.nan_to_num(error, nan=np.inf))


@dataclass(frozen=True, eq=False)
class _Remembered(Evaluator):
    """The runs of a runner, kept."""

    runner: Runner

    def straight(self, unit: Indices, x: Array) -> Array:
        """Values (R, W), NaN where a run failed."""
        return self.runner.values(unit, x)


def _drawn(likelihood: IndividualLikelihood, alpha: Array, block: Block) -> Array:
    """Nodes xi (B, 8, s) at even quantiles of their shares in the likelihood."""
    xi = likelihood.nodes.xi[block.experiments]
    log_weight = likelihood.nodes.log_weight[block.experiments]
    share = mean_of(likelihood.sums(alpha, block, xi) + log_weight)[1]
    reached = np.cumsum(share, axis=1)
    wanted = (np.arange(POINTS) + 0.5) / POINTS * reached[:, -1:]
    place = np.sum(reached[:, None, :] < wanted[:, :, None], axis=2)
    return np.take_along_axis(xi, np.minimum(place, xi.shape[1] - 1)[..., None], axis=1)


def _sums(likelihood: IndividualLikelihood, alpha: Array, block: Block, eta: Array) -> Array:
    terms = likelihood.errors.terms(alpha[likelihood.inputs.size :], eta, block.rows)
    return block.summed(terms.value)
