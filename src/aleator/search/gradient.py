"""Quasi-Newton ascent on the exact score, from several starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.stats import qmc

from aleator.errors import InputsError
from aleator.laws import Hyperparameter
from aleator.progress import Progress, Silent
from aleator.search.coordinates import Coordinates
from aleator.search.interface import Ascent, Optimum, Scored, SearchResult

Array = NDArray[np.float64]

SAME_VALUE = 0.01
"""Two ends within this log-likelihood of each other may be the same optimum."""
SAME_PLACE = 0.3
"""... and are, if also within this many standard errors (outer product of scores)."""


@dataclass(frozen=True)
class GradientMultistart:
    """Bounded quasi-Newton (L-BFGS-B) on the exact score from `starts` points.

    The starts are the hyperparameters' own start, the guesses of the baselines, and scrambled
    Sobol' points of the limits. Variables are scaled by the outer product of the scores at the
    start, which is the information matrix's estimate there. At most `evaluations` of the
    log-likelihood a start; a start that needs more ends as not converged. Raises InputsError for
    values below one.

    >>> GradientMultistart(starts=5).name
    'gradient_multistart(5)'
    """

    starts: int = 10
    evaluations: int = 60

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if self.starts < 1 or self.evaluations < 1:
            raise InputsError(
                f"search: starts {self.starts} and evaluations {self.evaluations}",
                "both must be at least 1; 10 starts find most second optima",
            )

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return f"gradient_multistart({self.starts})"

    def maximize(
        self,
        objective: Scored,
        hyperparameters: Sequence[Hyperparameter],
        *,
        seed: int,
        guesses: Sequence[Array] = (),
        progress: Progress | None = None,
    ) -> SearchResult:
        """Climb from every start and gather the distinct optima, best first."""
        progress = progress or Silent()
        coordinates = Coordinates(hyperparameters)
        if coordinates.free.size == 0:
            value = objective(coordinates.start).total
            only = Ascent(coordinates.start, coordinates.start, value, 1, converged=True)
            return _gathered([only], [coordinates.start], objective)
        ascents: list[Ascent] = []
        for k, start in enumerate(self._starts(coordinates, guesses, seed)):
            ascents.append(self._climb(objective, coordinates, start))
            best = max(a.log_likelihood for a in ascents)
            text = f"start {k + 1} of {self.starts}, best log-likelihood {best:.3f}"
            progress.update(text, k + 1, self.starts)
        return _gathered(ascents, [a.alpha for a in ascents], objective)

    def _starts(self, coordinates: Coordinates, guesses: Sequence[Array], seed: int) -> list[Array]:
        known = [coordinates.to_unit(alpha) for alpha in (coordinates.start, *guesses)]
        missing = self.starts - len(known)
        if missing > 0:
            sobol = qmc.Sobol(coordinates.free.size, rng=np.random.default_rng(seed))
            points = sobol.random_base2(int(np.ceil(np.log2(missing))))[:missing]
            # a start on a bound tells the search little: keep a twentieth away
            known += list(0.05 + 0.9 * points)
        return known[: self.starts]

    def _climb(self, objective: Scored, coordinates: Coordinates, u0: Array) -> Ascent:
        start = coordinates.to_alpha(u0)
        first = objective(start)
        assert first.scores is not None
        each = coordinates.gradient(start, first.scores)
        # no variable is scaled to more than its whole range, nor to nothing
        scale = 1.0 / np.clip(np.sqrt(np.sum(each**2, axis=0)), 1.0, 1e6)
        count, best = 1, (start, first.total)

        def negative(v: Array) -> tuple[float, Array]:
            nonlocal count, best
            alpha = coordinates.to_alpha(v * scale)
            if np.array_equal(alpha, start):
                result = first
            elif count < self.evaluations:
                count += 1
                result = objective(alpha)
            else:
                # the method's own limit is not looked at within a line search
                raise _SpentError
            if result.total > best[1]:
                best = (alpha, result.total)
            return -result.total, -coordinates.gradient(alpha, result.score) * scale

        try:
            end = optimize.minimize(
                negative,
                u0 / scale,
                jac=True,
                method="L-BFGS-B",
                bounds=[(0.0, 1.0 / s) for s in scale],
                options={"ftol": 1e-11, "gtol": 1e-4, "maxcor": 20},
            )
        except _SpentError:
            return Ascent(start, *best, count, converged=False)
        alpha = coordinates.to_alpha(end.x * scale)
        return Ascent(start, alpha, -float(end.fun), count, converged=bool(end.success))


class _SpentError(Exception):
    """All evaluations of a start are used up."""


def _gathered(ascents: list[Ascent], ends: list[Array], objective: Scored) -> SearchResult:
    """Distinct optima: ends that differ in value or in place, measured in standard errors."""
    order = sorted(range(len(ascents)), key=lambda k: -ascents[k].log_likelihood)
    groups: list[tuple[Ascent, Array, int]] = []
    for k in order:
        for g, (head, information, count) in enumerate(groups):
            step = ends[k] - head.alpha
            near = float(step @ information @ step) < SAME_PLACE**2
            if head.log_likelihood - ascents[k].log_likelihood < SAME_VALUE and near:
                groups[g] = (head, information, count + 1)
                break
        else:
            scores = objective(ends[k]).scores
            assert scores is not None
            groups.append((ascents[k], scores.T @ scores, 1))
    optima = tuple(Optimum(a.alpha, a.log_likelihood, count) for a, _, count in groups)
    return SearchResult(optima[0].alpha, optima[0].log_likelihood, tuple(ascents), optima)
