"""The likelihood without noise, from points at which the simulator gives the measured outcome."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.status import DEGENERATE_VALUE, Status
from aleator.core.types import Array, Flags, Indices
from aleator.laws.inputs import Inputs
from aleator.likelihood.individual.likelihood import mean_of
from aleator.likelihood.individual.parameters import densities, law_scores
from aleator.search.interface import LogLikelihood


@dataclass(frozen=True, eq=False)
class LevelSets:
    """Points x (N, K, n) on the level sets {x: eta_l(x) = y_l}, with log weights (N, K).

    Without noise f_l(y_l | alpha) = int p(x | alpha) delta(eta_l(x) - y_l) dx. By the coarea
    formula (Federer, 1969, 3.2.12) this is the integral of p/|grad eta_l| over the set. The set
    does not depend on alpha and is found only once; f_l = sum_k w_lk p(x_lk | alpha) is smooth in
    alpha for any simulator. Cost of a value with its score: 2 K + 1 densities of the law at all
    points. `block` points are processed together (by judgement, to fit a core's cache).

    >>> from aleator.laws import Free, Normal
    >>> inputs = Inputs({"a": Normal(Free(-2.0, 2.0), Free(0.1, 2.0))})
    >>> sets = LevelSets(inputs, np.array([[[0.5]]]), np.log([[1.0 / 2.0]]))  # 2 a = 1
    >>> round(float(sets.evaluate(np.array([0.0, 1.0])).likelihood), 6)  # Normal(0, 2^2) at 1
    -1.737086
    """

    inputs: Inputs
    x: Array
    log_weight: Array
    block: int = 64_000

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-densities (N,) with scores (N, K); DEGENERATE_VALUE where the density is zero."""
        found = [self.take(rows)._scored(alpha) for rows in self._blocks]
        total, scores = (np.concatenate(part) for part in zip(*found, strict=True))
        return self._found(alpha, total, scores)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-densities (N,) without scores; DEGENERATE_VALUE where the density is zero."""
        found = [mean_of(self.take(rows)._terms(alpha))[0] for rows in self._blocks]
        return self._found(alpha, np.concatenate(found), None)

    def shares(self, alpha: Array) -> Array:
        """The probability (N, K) of each point under the law alpha (K,), given the outcomes."""
        return mean_of(self._terms(alpha))[1]

    def take(self, rows: Indices | slice) -> LevelSets:
        """The level sets of the experiments `rows`, with no more points than these need."""
        log_weight = self.log_weight[rows]
        most = max(1, int(np.isfinite(log_weight).sum(axis=1).max(initial=0)))
        return replace(self, x=self.x[rows, :most], log_weight=log_weight[:, :most])

    def filled(self, other: LevelSets) -> LevelSets:
        """These level sets, with those of `other` for the experiments that have none here."""
        count = max(self.x.shape[1], other.x.shape[1])
        own, others = self._wide(count), other._wide(count)
        empty = self.empty
        return replace(
            self,
            x=np.where(empty[:, None, None], others.x, own.x),
            log_weight=np.where(empty[:, None], others.log_weight, own.log_weight),
        )

    @property
    def empty(self) -> Flags:
        """Flags (N,) of the experiments without a level set: no parameters give their outcome."""
        return np.asarray(np.all(np.isinf(self.log_weight), axis=1))

    @property
    def _blocks(self) -> list[slice]:
        """Blocks of experiments whose points fit into a core's cache."""
        return blocks(len(self.x), self.x.shape[1], self.block)

    def _scored(self, alpha: Array) -> tuple[Array, Array]:
        total, share = mean_of(self._terms(alpha))
        return total, law_scores(self.inputs, alpha, self.x, share)

    def _wide(self, count: int) -> LevelSets:
        """These level sets with points of weight zero added, so that all have `count` points."""
        more = count - self.x.shape[1]
        x = np.concatenate([self.x, np.repeat(self.x[:, :1], more, axis=1)], axis=1)
        log_weight = np.pad(self.log_weight, ((0, 0), (0, more)), constant_values=-np.inf)
        return replace(self, x=x, log_weight=log_weight)

    def _terms(self, alpha: Array) -> Array:
        return self.log_weight + densities(self.inputs, alpha, self.x)

    def _found(self, alpha: Array, total: Array, scores: Array | None) -> LogLikelihood:
        none = np.isinf(total)
        status = np.where(none, int(Status.DEGENERATE), int(Status.SOLVED))
        found = LogLikelihood(np.where(none, DEGENERATE_VALUE, total), scores, status)
        return found.believed(self.inputs.hyperparameters, alpha)
