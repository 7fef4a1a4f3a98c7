"""Bands {x: lower <= eta(x) <= upper} found on lines, where no grid can be used; see `lines`.

The lines go across the bound. On each line the pieces that lie in the band are found, and each gets
the points of a Gauss rule.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aleator.core.blocks import blocks
from aleator.core.polynomials import gauss_legendre
from aleator.core.types import Array, Flags, Indices
from aleator.laws.inputs import Inputs, parameters_at
from aleator.likelihood.level_sets.bands import inside
from aleator.likelihood.level_sets.lines import (
    CROSSINGS,
    Crossings,
    LineBlock,
    by_gauss,
    by_sobol,
    fitted,
    normal,
    of_lines,
    sobol_scores,
)
from aleator.simulators.response_functions import Divisible


@dataclass(frozen=True)
class PieceSettings:
    """Settings for the pieces of lines that lie in a band.

    `halvings`: the number of halvings by which an end of a piece is found; 30 leave a billionth of
    a step. `nodes`: the number of Gauss points of a piece, with which the probability of a whole
    line is exact to 2e-5, and that beyond any bound to 1e-6. `far`: a piece ends where the squared
    variate exceeds the least one on the piece by this value, beyond which lies less than 1e-8 of
    its probability.
    """

    halvings: int = 30
    nodes: int = 16
    far: float = 40.0


PIECES = PieceSettings()


def enclosed(
    inputs: Inputs,
    alpha: Array,
    response: Divisible,
    condition: Indices,
    ends: Array,
    lines: int,
    settings: Crossings = CROSSINGS,
) -> tuple[Indices, Array, Array]:
    """Points in bands, found on lines that are placed for the law alpha (K,).

    Returns the numbers of the bands (H,), points x (H, n) and log weights (H,). The probability of
    band r is P_r(beta) = sum_h w_h p(x_h | beta) for any beta near alpha. `ends` (2, R) are the
    bounds, one of which may be infinite, and `condition` (R,) are the numbers of the conditions.
    Cost: the outcomes of each band at 25 points of every line, and at 30 for every end of a piece.
    """
    law = sobol_scores(settings.points, inputs.scattering, 0)
    x = parameters_at(inputs, alpha, law[None], slice(0, 1), often=True)[0][0]
    bound = np.where(np.isfinite(ends[0]), ends[0], ends[1])
    found = []
    for rows in blocks(bound.size, lines * (settings.steps + 1), settings.block):
        own, where = np.unique(condition[rows], return_inverse=True)
        eta = response.take(own).evaluate(x)[where]
        block = _BandBlock(
            inputs, alpha, response, condition[rows], bound[rows], settings, ends[:, rows]
        )
        some = block.enclosed(law, eta, lines)
        found.append((some[0] + rows.start, *some[1:]))
    owner, on, log_weight = (np.concatenate(part) for part in zip(*found, strict=True))
    return owner, on, log_weight


@dataclass(frozen=True, eq=False)
class _BandBlock(LineBlock):
    """A block of B bands whose lines are evaluated together."""

    ends: Array
    pieces: PieceSettings = PIECES

    def enclosed(self, law: Array, eta: Array, lines: int) -> tuple[Indices, Array, Array]:
        """The points of bands on lines: numbers of the bands (H,), points x and log weights.

        `law` (P, s) are points of the law, and eta (B, P) the outcomes there. A small number of
        first lines shows where the band has its probability, and the final lines are placed there.
        They are placed by a Gauss rule if each of the first lines has one piece in the band. If
        not, the probability of a line is not a smooth function of its position, and more lines are
        used.
        """
        basis = self.laid(law, eta)[0]
        centre = self._centre(law, eta, basis)
        dimensions = centre.shape[1]
        if not dimensions:
            owner, _, xi, log_value = self._on(basis, centre[:, None])
            return self.weighted(owner, xi, log_value)
        settings = self.settings
        first_lines = dimensions * (dimensions + 3) + settings.spare
        u = centre[:, None] + settings.wider * sobol_scores(first_lines, dimensions)
        owner, line, _, log_value = self._on(basis, u)
        mean, factor = fitted(u, of_lines(u, owner, line, log_value), settings)
        points = np.zeros(u.shape[:2])
        np.add.at(points, (owner, line), 1.0)
        smooth = np.all(points == self.pieces.nodes, axis=1)
        parts = []
        for rows in (np.flatnonzero(smooth), np.flatnonzero(~smooth)):
            if not rows.size:
                continue
            if smooth[rows[0]]:
                at, log_q = by_gauss(lines, mean[rows], factor[rows], settings)
            else:
                many = lines * settings.bent
                at, log_q = by_sobol(many, mean[rows], factor[rows], centre[rows], settings)
            own = replace(
                self, condition=self.condition[rows], y=self.y[rows], ends=self.ends[:, rows]
            )
            owner, line, xi, log_value = own._on(basis[rows], at)
            parts.append((rows[owner], xi, log_value - log_q[owner, line]))
        owner, xi, log_weight = (np.concatenate(part) for part in zip(*parts, strict=True))
        return self.weighted(owner, xi, log_weight)

    def _centre(self, law: Array, eta: Array, basis: Array) -> Array:
        """The center (B, s - 1) of the lines' positions: the mean of points of the law in the band.

        Of bands with few points of the law, those points are taken that miss it least.
        """
        lower, upper = self.ends[..., None]
        with np.errstate(invalid="ignore"):
            off = np.maximum(np.maximum(lower - eta, eta - upper), 0.0)
        off = np.nan_to_num(off, nan=np.inf)
        near = np.argpartition(off, self.settings.nearest, axis=1)[:, : self.settings.nearest]
        return np.asarray(np.einsum("bi,bik->bk", law[near].mean(axis=1), basis[:, :, 1:]))

    def _on(self, basis: Array, u: Array) -> tuple[Indices, Indices, Array, Array]:
        """The points on lines in the bands: bands (H,), lines (H,), variates (H, s), log values.

        The lines are those of `_roots`. A value is the density of the variates times the weight of
        the point along its line.
        """
        reach, along = self.settings.reach, basis[:, :, 0]
        of, line, bound, low, high, before = self._switches(basis, u)
        first = np.einsum("hik,hk->hi", basis[of][:, :, 1:], u[of, line])
        for _ in range(self.pieces.halvings):
            middle = 0.5 * (low + high)
            value = self.eta(of, first + middle[:, None] * along[of])
            same = self._beyond(of, bound, value) == before
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        count, lines = u.shape[:2]
        every = np.arange(count * lines)
        of_part = np.concatenate([every, every, of * lines + line])
        ends = np.concatenate([np.repeat([-reach, reach], every.size), 0.5 * (low + high)])
        order = np.lexsort((ends, of_part))
        of_part, ends = of_part[order], ends[order]
        together = (of_part[1:] == of_part[:-1]) & (ends[1:] > ends[:-1])
        low, high = ends[:-1][together], ends[1:][together]
        of, line = np.divmod(of_part[:-1][together], lines)
        start = np.einsum("hik,hk->hi", basis[of][:, :, 1:], u[of, line])
        value = self.eta(of, start + (0.5 * (low + high))[:, None] * along[of])
        kept = inside(self.ends[:, of], value)
        of, line, start, low, high = of[kept], line[kept], start[kept], low[kept], high[kept]
        far = np.sqrt(np.clip(0.0, low, high) ** 2 + self.pieces.far)
        low, high = np.maximum(low, -far), np.minimum(high, far)
        t, share = gauss_legendre(self.pieces.nodes)
        t = 0.5 * (low + high)[:, None] + 0.5 * (high - low)[:, None] * t
        xi = start[:, None] + t[..., None] * along[of][:, None]
        log_value = normal(xi) + np.log(high - low)[:, None] + np.log(share)
        of, line = np.repeat(of, share.size), np.repeat(line, share.size)
        return of, line, xi.reshape(-1, along.shape[1]), log_value.ravel()

    def _switches(
        self, basis: Array, u: Array
    ) -> tuple[Indices, Indices, Indices, Array, Array, Flags]:
        """The steps of lines at one end of which the outcome is beyond a bound, at the other not.

        Returns the bands (R,), the lines (R,), the numbers of the bounds (R,), the lower and upper
        ends (R,) of the steps, and whether the outcome at the lower end is beyond the bound.
        """
        t, start, direction, eta = self.stepped(basis, u)
        whose, which = np.indices(eta.shape[:2]).reshape(2, -1)
        places = np.broadcast_to(t, (whose.size, t.size))
        looked = [(whose, which, places, eta.reshape(whose.size, -1))]
        for end in self.ends:
            with np.errstate(invalid="ignore"):
                off = eta - end[:, None, None]
            looked.append(self.closer(off, t, start, direction))
        parts = []
        for whose, which, places, value in looked:
            for number in (0, 1):
                bound = np.full(whose.size, number)
                status = self._beyond(whose, bound, value.T).T
                row, step = np.nonzero(status[:, 1:] != status[:, :-1])
                ends = places[row, step], places[row, step + 1]
                parts.append((whose[row], which[row], bound[row], *ends, status[row, step]))
        of, line, bound, low, high, before = (
            np.concatenate(part) for part in zip(*parts, strict=True)
        )
        return of, line, bound, low, high, before

    def _beyond(self, of: Indices, bound: Indices, value: Array) -> Flags:
        """Whether outcomes (..., R) of bands (R,) are at their lower bound or above (bound 0).

        For bound 1: whether they are above their upper bound. A run that failed is beyond neither.
        """
        lower, upper = self.ends[:, of]
        return np.asarray(np.where(bound == 0, value >= lower, value > upper))
