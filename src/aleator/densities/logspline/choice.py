"""The density whose logarithm is a cubic spline: maximum entropy with local statistics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aleator.densities.convolution import LARGEST_RIPPLE, ripple
from aleator.densities.gaussian import FittedGaussian
from aleator.densities.interface import (
    SMALLEST_SD,
    Codes,
    Status,
    check_noise,
    check_weights,
    range_end,
)
from aleator.densities.logspline.dual import minimize_penalized_dual, residual
from aleator.densities.logspline.fitted import FittedLogSpline, Support
from aleator.densities.logspline.splines import NoisyPowers, expected_splines, of_quadratic, uniform
from aleator.densities.outcomes import Outcomes
from aleator.densities.stand_in import NodeNormal
from aleator.errors import InputsError
from aleator.threads import single_threaded
from aleator.types import Array, Flags

MARGIN = 8.0
"""Standard deviations of noise by which the range of the outcome is widened."""

LARGEST_RESIDUAL = 1e-6

_SPLINE_SD = 3.0**-0.5
"""Standard deviation of a cubic B-spline, as a density, in units of the distance of its knots."""

_LARGEST_BATCH = 50_000
"""Powers computed at once: they fit the cache of one core."""


@dataclass(frozen=True)
class LogSpline:
    """The density of largest entropy with given expectations of cubic B-splines.

    log f(y) = sum_k theta_k B_k(t) - log Z on the support, t in [0, 1] (Stone, Ann. Statist. 18,
    1990; Barron and Sheu, Ann. Statist. 19, 1991, for the rate), with the expectations
    sum_j w_j E B_k(t_j + noise) of the nodes' outcomes, the noise in closed form. Where raw moments
    stop at eight, `knots` K counts the equal intervals of the support: the physical range of the
    outcome, widened by the noise, cut at `reach` standard deviations. The dual is penalized by
    `smoothing`/2 times the squared third differences of theta, which are zero for a normal density:
    intervals without an outcome continue the density as a normal one would, and an expectation
    is missed by about `smoothing`.

    The tail needs nodes with weights that tell its probability (a Gauss rule): those of equal
    probability end before it does, and call for fewer knots or a `smoothing` of 1e-4 to 1e-3.
    The nodes must be closer than the knots (`points` asks for 20 an interval); too coarse ones
    have status TOO_COARSE, and the normal density stands in. Raises InputsError for an inadmissible
    choice, a negative weight or noise. Cost O(N J K) and some ten to thirty Newton steps of
    O(N K^3): some twenty times that of `MaximumEntropy(4)`.

    >>> t, w = np.polynomial.legendre.leggauss(200)
    >>> uniform = Outcomes(t[None], w / 2.0)
    >>> fitted = LogSpline(knots=8).fit_nodes(uniform, 0.0, [-1.0], [1.0])
    >>> fitted.pdf([[-0.9, 0.0, 0.5, 1.1]]).round(4).tolist()
    [[0.5, 0.5, 0.5, 0.0]]
    """

    knots: int = 32
    reach: float = 8.0
    smoothing: float = 1e-5

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        if not 2 <= self.knots <= 64:
            raise InputsError(
                f"logspline with {self.knots} knots: not in 2..64", "take 32, the usual choice"
            )
        if not (np.isfinite(self.reach) and self.reach > 0.0):
            raise InputsError(
                f"logspline with reach {self.reach}: not positive and finite",
                "take 8 standard deviations, the usual choice",
            )
        if not (np.isfinite(self.smoothing) and self.smoothing > 0.0):
            raise InputsError(
                f"logspline with smoothing {self.smoothing}: not positive and finite",
                "take 1e-5, the usual choice",
            )

    @property
    def points(self) -> int:
        """Number of nodes to ask for, all parameters together."""
        return 20 * self.knots

    @property
    def name(self) -> str:
        """Name for reports."""
        return f"logspline, {self.knots} knots"

    @single_threaded
    def fit_nodes(
        self, outcomes: Outcomes, noise_sd: float, lower: ArrayLike, upper: ArrayLike
    ) -> FittedLogSpline:
        """Fit N densities; lower, upper (N,) is the range of the noise-free outcome."""
        check_weights(outcomes.weights, self.name)
        check_noise(noise_sd)
        finite = np.asarray(np.isfinite(outcomes.y).all(axis=1))
        normal = NodeNormal(np.where(finite[:, None], outcomes.y, 0.0), outcomes.weights, noise_sd)
        none = ~finite | ~(normal.sd > SMALLEST_SD)
        support = self._support(normal, none, lower, upper)
        kernel = np.hypot(noise_sd, _SPLINE_SD * support.width / self.knots)
        coarse = ripple(normal.y, outcomes.weights, kernel) > LARGEST_RIPPLE
        # what cannot be fitted takes part as a uniform law
        fits = ~(coarse | support.empty)[:, None]
        expected = np.where(fits, self._expected(normal, support), uniform(self.knots))
        start = of_quadratic(
            support.inside(normal.mean[:, None])[:, 0],
            -0.5 * (support.width / support.scale) ** 2,
            self.knots,
        )
        answer = minimize_penalized_dual(expected, np.where(fits, start, 0.0), self.smoothing)
        unexplained = residual(answer.coefficients, answer.log_z, expected, self.smoothing)
        solved = answer.converged & (unexplained <= LARGEST_RESIDUAL)
        return FittedLogSpline(
            nodes=normal,
            normal=FittedGaussian(np.where(finite, normal.mean, np.nan), normal.sd, 3),
            range=support,
            coefficients=answer.coefficients,
            log_z=answer.log_z,
            mean=answer.mean,
            hessian=answer.hessian,
            status=_status(none, support.empty, coarse, solved),
        )

    def _support(
        self, normal: NodeNormal, none: Flags, lower: ArrayLike, upper: ArrayLike
    ) -> Support:
        """The range widened by the noise and cut at the reach."""
        count, margin = normal.mean.size, MARGIN * normal.noise_sd
        scale = np.where(none, 1.0, normal.sd)
        low = range_end(lower, count, "lower") - margin
        high = range_end(upper, count, "upper") + margin
        near, far = normal.mean - self.reach * scale, normal.mean + self.reach * scale
        lower_moves, upper_moves = low > near, high < far
        a, b = np.where(lower_moves, low, near), np.where(upper_moves, high, far)
        empty = none | ~((a < normal.mean) & (b > normal.mean))
        return Support(
            a=np.where(empty, normal.mean - scale, a),
            b=np.where(empty, normal.mean + scale, b),
            scale=scale,
            lower_moves=lower_moves & ~empty,
            upper_moves=upper_moves & ~empty,
            reach=self.reach,
            margin=MARGIN,
            empty=empty,
        )

    def _expected(self, normal: NodeNormal, support: Support) -> Array:
        """Expectations (N, K+3) of the splines under nodes and noise."""
        t, s = support.inside(normal.y), normal.noise_sd / support.width
        rows = max(1, _LARGEST_BATCH // (t.shape[1] * (self.knots + 1)))
        blocks = (slice(i, i + rows) for i in range(0, t.shape[0], rows))
        return np.concatenate(
            [
                expected_splines(NoisyPowers.at(t[b], s[b], self.knots), normal.weights)
                for b in blocks
            ]
        )


def _status(none: Flags, empty: Flags, coarse: Flags, solved: Flags) -> Codes:
    codes = np.where(solved, Status.SOLVED, Status.NOT_CONVERGED)
    codes = np.where(coarse, Status.TOO_COARSE, codes)
    codes = np.where(empty, Status.NOT_REALIZABLE, codes)
    return np.where(none, Status.DEGENERATE, codes).astype(np.int64)
