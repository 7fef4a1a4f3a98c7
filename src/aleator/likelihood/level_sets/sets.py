"""The likelihood without noise, from points at which the simulator gives the measured outcome."""

from __future__ import annotations

from collections.abc import Iterator
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
        return log_likelihood(self.inputs, alpha, *self.scored(alpha))

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-densities (N,) without scores; DEGENERATE_VALUE where the density is zero."""
        return log_likelihood(self.inputs, alpha, self.totals(alpha), None)

    def scored(self, alpha: Array) -> tuple[Array, Array]:
        """The logarithms (N,) of the sums over the points, with scores (N, K)."""
        found = [self.take(rows)._scored(alpha) for rows in self._blocks]
        total, scores = (np.concatenate(part) for part in zip(*found, strict=True))
        return total, scores

    def totals(self, alpha: Array) -> Array:
        """The logarithms (N,) of the sums over the points."""
        return np.concatenate(
            [mean_of(self.take(rows)._terms(alpha))[0] for rows in self._blocks]
        )  # fmt: skip

    def shares(self, alpha: Array) -> Array:
        """The probability (N, K) of each point under the law alpha (K,), given the outcomes."""
        return mean_of(self._terms(alpha))[1]

    def points(self, alpha: Array) -> Iterator[tuple[Indices, Array, Array]]:
        """Blocks of experiments (B,), with points (B, K, n) and the shares (B, K) of these."""
        for rows in self._blocks:
            part = self.take(rows)
            yield np.arange(rows.start, rows.stop), part.x, part.shares(alpha)

    def under(self, inputs: Inputs) -> LevelSets:
        """The same points for other laws of the same parameters."""
        return replace(self, inputs=inputs)

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
    def size(self) -> int:
        """The number of points, with those of weight zero."""
        return self.log_weight.size

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


@dataclass(frozen=True, eq=False)
class JoinedSets:
    """The level sets of exact outcomes and the bands of censored ones, as one likelihood.

    The points of a band {x: lower <= eta(x) <= upper} have weights for the probability of the
    outcome, P(lower <= eta <= upper | alpha) = sum_k w_k p(x_k | alpha). Experiments with the same
    condition and the same bounds share a band. `place` (N,) is the number of each experiment's row
    in the rows of all `parts`.
    """

    inputs: Inputs
    parts: tuple[LevelSets, ...]
    place: Indices

    def __call__(self, alpha: Array) -> LogLikelihood:
        """The log-likelihoods (N,) with scores (N, K); DEGENERATE_VALUE where one is zero."""
        found = zip(*(part.scored(alpha) for part in self.parts), strict=True)
        total, scores = (np.concatenate(each)[self.place] for each in found)
        return log_likelihood(self.inputs, alpha, total, scores)

    def evaluate(self, alpha: Array) -> LogLikelihood:
        """The log-likelihoods (N,) without scores; DEGENERATE_VALUE where one is zero."""
        total = np.concatenate([part.totals(alpha) for part in self.parts])[self.place]
        return log_likelihood(self.inputs, alpha, total, None)

    def points(self, alpha: Array) -> Iterator[tuple[Indices, Array, Array]]:
        """Blocks of experiments (B,), with points (B, K, n) and the shares (B, K) of these."""
        first = 0
        for part in self.parts:
            for own, x, share in part.points(alpha):
                rows = np.flatnonzero(np.isin(self.place, first + own))
                for some in blocks(rows.size, share.shape[1], part.block):
                    at = self.place[rows[some]] - first - own[0]
                    yield rows[some], x[at], share[at]
            first += len(part.x)

    def under(self, inputs: Inputs) -> JoinedSets:
        """The same points for other laws of the same parameters."""
        return replace(self, inputs=inputs, parts=tuple(part.under(inputs) for part in self.parts))

    @property
    def empty(self) -> Flags:
        """Flags (N,) of the experiments without a set: no parameters agree with their outcome."""
        return np.asarray(np.concatenate([part.empty for part in self.parts])[self.place])

    @property
    def size(self) -> int:
        """The number of points, with those of weight zero."""
        return sum(part.size for part in self.parts)


Sets = LevelSets | JoinedSets
"""The points of all experiments, on which the likelihood is a sum."""


def filled(own: Sets, other: Sets) -> Sets:
    """The sets `own`, with those of `other` for the experiments that have none there."""
    if isinstance(own, LevelSets):
        assert isinstance(other, LevelSets)
        return own.filled(other)
    assert isinstance(other, JoinedSets)
    pairs = zip(own.parts, other.parts, strict=True)
    return replace(own, parts=tuple(one.filled(more) for one, more in pairs))


def log_likelihood(
    inputs: Inputs, alpha: Array, total: Array, scores: Array | None
) -> LogLikelihood:
    """The log-likelihoods (N,) at alpha (K,); DEGENERATE_VALUE where `total` (N,) is infinite."""
    none = np.isinf(total)
    status = np.where(none, int(Status.DEGENERATE), int(Status.SOLVED))
    found = LogLikelihood(np.where(none, DEGENERATE_VALUE, total), scores, status)
    return found.believed(inputs.hyperparameters, alpha)
