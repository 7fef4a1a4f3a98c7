"""The density of largest entropy that has the given moments on a bounded support."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aleator.errors import InputsError
from aleator.moments.densities.gaussian import FittedGaussian
from aleator.moments.densities.interface import check_moments, in_sds, range_end
from aleator.moments.densities.maximum_entropy.fitted import FittedMaximumEntropy
from aleator.moments.densities.maximum_entropy.solution import solve
from aleator.moments.densities.moments import Moments
from aleator.threads import single_threaded
from aleator.types import Array


@dataclass(frozen=True)
class MaximumEntropy:
    """The density of largest entropy with the first M moments, on an explicit bounded support.

    f(y) = exp(sum_k lambda_k phi_k(t))/Z (paper, appendix "Maximum entropy distribution"), with
    phi_k Legendre polynomials of degree 1..M on the support [a, b] of u = (y - mean)/sd: the
    physical range of the outcome, cut at the reach. The paper takes the whole real line, where
    odd M, or M = 4 with a kurtosis above that of the normal, have no solution; on a bounded
    support every M has one if the moments are realizable. The reach is at least `reach` standard
    deviations and grows smoothly with heavy tails, so that their moments are (module `support`).
    `order` M is 2..8, `nodes` the Gauss-Legendre nodes of the solve.

    A kurtosis above 3 puts a small bump at an edge that the reach has set. Raises InputsError for
    an inadmissible choice. Cost:
    some 7 Newton steps of O(N nodes M), for hard targets at M of 6 and more some 100 times that.
    It fails, with a status and M-2 moments in its place, where the moments are not realizable, so
    close to that boundary that the density is a set of spikes, or where eight moments of heavy
    tails leave no digits (a third of the cubics of a normal variable with a kurtosis of 10 to
    20): orders above 8 are not offered for that reason.

    >>> m = Moments(np.array([1.0]), np.array([3.0**-0.5]), np.array([[1.0, 0.0, 1.0, 0.0, 1.8]]))
    >>> fitted = MaximumEntropy(order=4).fit(m, [0.0], [2.0])  # the moments of the uniform law
    >>> fitted.pdf([[0.0, 0.5, 2.0, 2.1]]).round(9).tolist()
    [[0.5, 0.5, 0.5, 0.0]]
    """

    order: int = 4
    reach: float = 8.0
    nodes: int = 200

    def __post_init__(self) -> None:
        if not 2 <= self.order <= 8:
            raise InputsError(
                f"maximum entropy of order {self.order}: the order is not in 2..8",
                "take 4, the usual choice",
            )
        if not (np.isfinite(self.reach) and self.reach > 0.0):
            raise InputsError(
                f"maximum entropy with reach {self.reach}: not positive and finite",
                "take 8 standard deviations, the usual choice",
            )
        if self.nodes < 4 * self.order:
            raise InputsError(
                f"maximum entropy of order {self.order} with {self.nodes} nodes: too few",
                "take 200 nodes, the usual choice",
            )

    @property
    def name(self) -> str:
        """Name for reports."""
        return f"maximum entropy, {self.order} moments"

    def fit(self, moments: Moments, lower: ArrayLike, upper: ArrayLike) -> FittedMaximumEntropy:
        """Fit N densities on the physical ranges lower, upper (N,), each possibly infinite.

        Raises InputsError for too few moments or a wrong shape. A mean outside its range, or
        moments that no density on the support has, are a status.
        """
        return self.fit_near(moments, lower, upper, None)

    @single_threaded
    def fit_near(
        self,
        moments: Moments,
        lower: ArrayLike,
        upper: ArrayLike,
        known: FittedMaximumEntropy | None,
    ) -> FittedMaximumEntropy:
        """The same densities, sooner where those of nearby moments and this choice are known.

        Some 3 Newton steps instead of 7 and more; what is solved differs by rounding.
        """
        check_moments(moments, self.order, self.name)
        normal = FittedGaussian(moments.mean, moments.sd, moments.standardized.shape[1])
        mean, sd = normal.safe()
        lower = in_sds(range_end(lower, mean.size, "lower"), mean, sd)
        upper = in_sds(range_end(upper, mean.size, "upper"), mean, sd)
        standardized = moments.standardized[:, : self.order + 1]
        # a mean outside the range, or NaN, gets moments that no density has: not realizable
        usable = (lower < 0.0) & (upper > 0.0) & np.isfinite(standardized).all(axis=1)
        standardized = np.where(usable[:, None], standardized, _first(self.order))
        lower, upper = np.where(usable, lower, -np.inf), np.where(usable, upper, np.inf)
        start = known.solution if known else None
        return FittedMaximumEntropy(
            normal, solve(lower, upper, standardized, self.reach, self.nodes, start)
        )


def _first(order: int) -> Array:
    """Moments (M+1,) of no law: E 1 = 1 and all others zero but for a second moment of -1."""
    moments = np.zeros(order + 1)
    moments[0], moments[2] = 1.0, -1.0
    return moments
