"""Level sets found on lines through the space of the standard normal variates.

This is used where no grid can be, for example with more than two scattering parameters. The
integral int phi(xi) delta(eta(x(xi)) - y) dxi is taken over parallel lines in one direction. On
each line it is a sum over the points at which the outcome is y: the crossings of the line with the
level set. The lines go through quadrature points in the plane normal to their direction, placed
where the law explains the outcome.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import special
from scipy.stats import qmc

from aleator.core.blocks import blocks
from aleator.core.polynomials import gauss_hermite
from aleator.core.types import Array, Flags, Indices
from aleator.laws.inputs import Inputs, parameters_at
from aleator.likelihood.individual.parameters import scattered_density
from aleator.likelihood.individual.rules import RULES
from aleator.simulators.response_functions import Divisible


@dataclass(frozen=True)
class Crossings:
    """Settings for the lines on which level sets are found, and for their crossings with the sets.

    A line is a straight line in the space of the standard normal variates. These values were
    measured by `tests/likelihood/test_level_lines.py`. `points` and `nearest`: of this number of
    points of the law, the `nearest` ones in outcome show the direction in which the outcome changes
    most. `wider`: lines are spread wider than the law by this factor. `reach`: the ends of a line,
    in standard deviations. `steps`: the number of steps in which a line is searched; `alone`: this
    number if there is only one variate and thus one line. `closer`: the number of finer steps where
    the outcome has an extreme between two steps. `halvings`: the iterations of the false-position
    method for a crossing. `difference`: the step for the slope there. `jump`: a crossing is
    rejected as a jump if the outcome there is off by this share of its change over that step.
    `narrow`: limits of the precision of the normal law by which lines are placed. `touching`: the
    share of the level set, nearly parallel to the lines, above which it counts as curved. A set
    that is not curved is integrated by a Gauss rule. `bent`: a curved set gets this factor times as
    many lines, along each axis in turn. `thick`: the smallest standard deviation of the lines'
    positions for it. `power`: the power of the slopes by which the directions are weighted.

    These values are chosen by judgement. `flat` and `ridge`: small ridge terms in the least-squares
    fits of a plane and of a normal law. `weight`: the power of the density that weights the latter
    fit. `spare`: the first lines are d (d + 3) plus this number, in d dimensions normal to them.
    `of_law`: for a curved set, one line in this number is placed by the law itself. `nodes`: the
    smallest and the largest number of nodes per dimension of the Gauss rule. `block`: the number of
    outcomes that are simulated together.
    """

    points: int = 256
    nearest: int = 32
    wider: float = 1.2
    reach: float = 8.0
    steps: int = 24
    alone: int = 128
    closer: int = 12
    halvings: int = 7
    difference: float = 3e-3
    jump: float = 0.2
    narrow: tuple[float, float] = (0.3, 1e4)
    power: int = 3
    touching: float = 1e-3
    bent: int = 4
    thick: float = 0.5
    flat: float = 1e-6
    ridge: float = 1e-10
    weight: float = 0.25
    spare: int = 16
    of_law: int = 5
    nodes: tuple[int, int] = (3, 15)
    block: int = 400_000


CROSSINGS = Crossings()


def traced(
    inputs: Inputs,
    alpha: Array,
    response: Divisible,
    condition: Indices,
    y: Array,
    lines: int,
    settings: Crossings = CROSSINGS,
) -> tuple[Indices, Array, Array]:
    """Points on level sets, found on lines that are placed for the law alpha (K,).

    Returns experiments (H,), points x (H, n) and log weights (H,). The density of outcome l is
    f_l(y_l | beta) = sum_h w_h p(x_h | beta) for any beta near alpha. Cost: the outcomes of each
    experiment at 25 points of every line.
    """
    law = sobol_scores(settings.points, inputs.scattering, 0)
    x = parameters_at(inputs, alpha, law[None], slice(0, 1), often=True)[0][0]
    found = []
    for rows in blocks(y.size, lines * (settings.steps + 1), settings.block):
        own, where = np.unique(condition[rows], return_inverse=True)
        eta = response.take(own).evaluate(x)[where]
        block = LineBlock(inputs, alpha, response, condition[rows], y[rows], settings)
        some = block.crossed(block.laid(law, eta), lines)
        found.append((some[0] + rows.start, *some[1:]))
    owner, on, log_weight = (np.concatenate(part) for part in zip(*found, strict=True))
    return owner, on, log_weight


@dataclass(frozen=True, eq=False)
class LineBlock:
    """A block of B experiments whose lines are evaluated together."""

    inputs: Inputs
    alpha: Array
    response: Divisible
    condition: Indices
    y: Array
    settings: Crossings

    def laid(self, law: Array, eta: Array) -> tuple[Array, Array]:
        """The direction of the lines of each experiment, and the center of their positions.

        The direction is the first column of an orthonormal basis (B, s, s); the center (B, s - 1)
        has coordinates in the other columns. A plane is fitted to the outcomes eta (B, P) at those
        points of the law (P, s) whose outcomes are nearest to the measured one. The direction is
        that of its slope, and the center is the mean of these points.
        """
        away = np.nan_to_num(np.abs(eta - self.y[:, None]), nan=np.inf)
        near = np.argpartition(away, self.settings.nearest, axis=1)[:, : self.settings.nearest]
        xi, value = law[near], np.take_along_axis(eta, near, axis=1)
        value = np.where(np.isfinite(value), value, 0.0)
        middle = xi.mean(axis=1)
        off = xi - middle[:, None]
        square = np.einsum("bmi,bmj->bij", off, off)
        size = np.trace(square, axis1=1, axis2=2)[:, None, None]
        rise = np.einsum("bmi,bm->bi", off, value - value.mean(axis=1, keepdims=True))
        ridge = self.settings.flat * size * np.eye(law.shape[1])
        slope = np.linalg.solve(square + ridge, rise[..., None])[..., 0]
        length = np.sqrt(np.sum(slope**2, axis=1, keepdims=True))
        first = np.eye(law.shape[1])[0]
        direction = np.where(length > 0.0, slope / np.where(length > 0.0, length, 1.0), first)
        basis = _reflected(direction)
        return basis, np.einsum("bi,bik->bk", middle, basis[:, :, 1:])

    def crossed(self, laid: tuple[Array, Array], lines: int) -> tuple[Indices, Array, Array]:
        """The crossings of lines with the level sets: experiments, points x and log weights.

        A small number of first lines shows where the set has its probability, and the final lines
        are placed there. If the lines go straight through the set everywhere, they are placed by a
        Gauss rule. If the set is curved, so that some lines only touch it, more lines along every
        axis are used.
        """
        basis, centre = laid
        dimensions = centre.shape[1]
        if not dimensions:
            found = self._roots(basis, centre[:, None])
            return self.weighted(found.owner, found.xi, found.log_alone)
        settings, wide = self.settings, self.settings.wider
        first_lines = dimensions * (dimensions + 3) + settings.spare
        u = centre[:, None] + wide * sobol_scores(first_lines, dimensions)
        first = self._roots(basis, u)
        mean, factor = fitted(u, of_lines(u, first.owner, first.line, first.log_alone), settings)
        log_q = gaussian(u, centre, np.eye(dimensions), wide) + np.log(u.shape[1])
        middle, square, left = first.moments(log_q, len(self.y))
        parts = []
        plain = np.flatnonzero(left < settings.touching)
        if plain.size:
            own, log_q = by_gauss(lines, mean[plain], factor[plain], settings)
            found = self._of(plain)._roots(basis[plain], own)
            parts.append((plain, found.weighed(log_q, found.log_alone)))
        bent = np.flatnonzero(~(left < settings.touching))
        if bent.size:
            block, many, own = self._of(bent), lines * settings.bent, basis[bent]
            at, log_q = by_sobol(many, mean[bent], factor[bent], centre[bent], settings)
            found = block._roots(own, at)
            parts.append((bent, found.weighed(log_q, found.log_value)))
            middle, square, _ = found.moments(log_q, bent.size)
            score = sobol_scores(many, dimensions)
            for turned in range(1, basis.shape[1]):
                turn = own[:, :, np.roll(np.arange(basis.shape[1]), -turned)]
                about = np.einsum("bi,bik->bk", middle, turn[:, :, 1:])
                spread = np.einsum("bij,bik,bjl->bkl", square, turn[:, :, 1:], turn[:, :, 1:])
                wider = np.linalg.cholesky(spread + settings.thick**2 * np.eye(dimensions))
                at = about[:, None] + wide * np.einsum("bij,lj->bli", wider, score)
                found = block._roots(turn, at)
                log_q = gaussian(at, about, wider, wide) + np.log(many)
                parts.append((bent, found.weighed(log_q, found.log_value)))
        owner = np.concatenate([rows[part[0]] for rows, part in parts])
        xi, log_weight = (np.concatenate([part[i] for _, part in parts]) for i in (1, 2))
        return self.weighted(owner, xi, log_weight)

    def weighted(
        self, owner: Indices, xi: Array, log_weight: Array
    ) -> tuple[Indices, Array, Array]:
        """The crossings as parameters x (H, n), with log weights for the density of the outcome.

        A crossing adds exp(log weight) p(x | alpha) to this density.
        """
        x = self._x(xi)
        return owner, x, log_weight - scattered_density(self.inputs, self.alpha, x)

    def _of(self, rows: Indices) -> LineBlock:
        return replace(self, condition=self.condition[rows], y=self.y[rows])

    def stepped(self, basis: Array, u: Array) -> tuple[Array, Array, Array, Array]:
        """The outcomes (B, J, T) at all steps of lines, which are described in `_roots`.

        Also returns the steps (T,), the points (B, J, s) of the lines at step 0, and their
        directions (B, s).
        """
        settings = self.settings
        steps = settings.steps if basis.shape[1] > 1 else settings.alone
        t = np.linspace(-settings.reach, settings.reach, steps + 1)
        direction = basis[:, :, 0]
        start = np.einsum("bik,bjk->bji", basis[:, :, 1:], u)
        xi = start[:, :, None] + t[:, None] * direction[:, None, None]
        owner = np.repeat(np.arange(len(u)), u.shape[1] * t.size)
        eta = self.eta(owner, xi.reshape(-1, xi.shape[-1])).reshape(xi.shape[:3])
        return t, start, direction, eta

    def _roots(self, basis: Array, u: Array) -> _Crossed:
        """The crossings of lines with the level sets.

        The lines are parallel to the first column of the basis (B, s, s). Their positions
        u (B, J, s - 1) are coordinates in the other columns.
        """
        settings = self.settings
        t, start, direction, eta = self.stepped(basis, u)
        off = eta - self.y[:, None, None]
        of, line, low, high, f_low, f_high = self._brackets(off, t, start, direction)
        first, along = start[of, line], direction[of]
        for _ in range(settings.halvings):
            middle = _between(low, high, f_low, f_high)
            value = self.eta(of, first + middle[:, None] * along) - self.y[of]
            right = (value > 0.0) == (f_high > 0.0)
            # Illinois rule: the value at the end of the bracket that is kept is halved.
            f_low = np.where(right, 0.5 * f_low, value)
            f_high = np.where(right, value, 0.5 * f_high)
            low, high = np.where(right, low, middle), np.where(right, middle, high)
        root, by = _between(low, high, f_low, f_high), settings.difference
        down, here, up = (
            self.eta(of, first + (root + k * by)[:, None] * along) - self.y[of] for k in (-1, 0, 1)
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            slope, bend = (up - down) / (2.0 * by), (up - 2.0 * here + down) / by**2
            # One Newton step is made if it stays between the points of the difference.
            move = np.nan_to_num(-here / slope)
            move = np.where(np.abs(move) < by, move, 0.0)
            root, log_slope = root + move, np.log(np.abs(slope + bend * move))
        xi = first + root[:, None] * along
        others = []
        for axis in np.moveaxis(basis[of][:, :, 1:], 2, 0):
            ends = (self.eta(of, xi + sign * by * axis) for sign in (1.0, -1.0))
            others.append((next(ends) - next(ends)) / (2.0 * by))
        with np.errstate(divide="ignore", invalid="ignore"):
            log_others = np.log(np.abs(np.reshape(others, (len(others), of.size)).T))
        # Where the outcome jumps over y, its value at the supposed crossing still differs from y.
        fine = np.isfinite(log_slope) & (np.abs(here) < settings.jump * np.abs(up - down))
        each = (of[fine], line[fine], xi[fine], log_slope[fine], log_others[fine])
        return _Crossed(*each, settings.power)

    def _brackets(
        self, off: Array, t: Array, start: Array, direction: Array
    ) -> tuple[Indices, Indices, Array, Array, Array, Array]:
        """The steps in which lines cross level sets.

        Returns the experiments (R,) and lines (R,), the lower and upper ends (R,) of the steps, and
        the differences (R,) at both ends of the outcome from the measured one. `off` (B, J, T) are
        these differences at all points of all lines. Near an extreme of the outcome two crossings
        may lie in one step; such places are searched in finer steps.
        """
        changes = _changes(off)
        of, line, step = np.nonzero(changes)
        ends = t[step], t[step + 1], off[of, line, step], off[of, line, step + 1]
        whose, which, fine, closer = self.closer(off, t, start, direction)
        if not whose.size:
            return of, line, *ends
        closer = closer - self.y[whose][:, None]
        row, step = np.nonzero(_changes(closer))
        hidden = (fine[row, step], fine[row, step + 1], closer[row, step], closer[row, step + 1])
        both = [np.concatenate(pair) for pair in zip(ends, hidden, strict=True)]
        return (
            np.concatenate([of, whose[row]]), np.concatenate([line, which[row]]),
            both[0], both[1], both[2], both[3],
        )  # fmt: skip

    def closer(
        self, off: Array, t: Array, start: Array, direction: Array
    ) -> tuple[Indices, Indices, Array, Array]:
        """Finer steps where lines may cross a level set twice in one step, near an extreme.

        `off` (B, J, T) are the differences of the outcomes from those of the sets. Returns the
        experiments (R,) and lines (R,), the finer steps (R, C) and the outcomes (R, C) there.
        """
        changes = _changes(off)
        with np.errstate(invalid="ignore"):
            bend = np.abs(np.diff(off, 2, axis=2))
            here = np.abs(off[..., 1:-1])
            turned = (here < 0.5 * bend) & ~changes[..., 1:] & ~changes[..., :-1]
            turned &= (here <= np.abs(off[..., 2:])) & (here < np.abs(off[..., :-2]))
        whose, which, middle = np.nonzero(turned)
        share = np.linspace(0.0, 1.0, self.settings.closer + 1)
        fine = t[middle][:, None] + share * (t[middle + 2] - t[middle])[:, None]
        if not whose.size:
            return whose, which, fine, fine
        xi = start[whose, which][:, None] + fine[..., None] * direction[whose][:, None]
        owner = np.repeat(whose, share.size)
        return whose, which, fine, self.eta(owner, xi.reshape(owner.size, -1)).reshape(fine.shape)

    def _x(self, xi: Array) -> Array:
        return np.asarray(
            parameters_at(self.inputs, self.alpha, xi[None], slice(0, 1), often=True)[0][0]
        )

    def eta(self, owner: Indices, xi: Array) -> Array:
        """The outcomes (R,) of the experiments `owner` (R,) at variates xi (R, s)."""
        return self.response.at(self.condition[owner], self._x(xi))


def by_gauss(lines: int, mean: Array, factor: Array, settings: Crossings) -> tuple[Array, Array]:
    """Positions (B, J, d) of about `lines` lines by a Gauss rule, and their log densities (B, J).

    The rule is that of normal laws with means (B, d) and Cholesky factors (B, d, d). The densities
    are those of the positions, times their number.
    """
    z, log_weight = gauss_nodes(lines, mean.shape[1], settings.nodes)
    u = mean[:, None] + np.einsum("bij,lj->bli", factor, z)
    return u, gaussian(u, mean, factor) - log_weight


def by_sobol(
    many: int, mean: Array, factor: Array, centre: Array, settings: Crossings
) -> tuple[Array, Array]:
    """Positions (B, J, d) of `many` lines by a Sobol' sequence, and their log densities (B, J).

    Most are spread by normal laws with means (B, d) and Cholesky factors (B, d, d), the others by
    the law itself about a centre (B, d).
    """
    wide, score = settings.wider, sobol_scores(many, mean.shape[1])
    of_law = np.arange(many) % settings.of_law == settings.of_law - 1
    at = mean[:, None] + wide * np.einsum("bij,lj->bli", factor, score)
    at = np.where(of_law[:, None], centre[:, None] + wide * score, at)
    share = float(of_law.mean())
    log_q = np.log(many) + np.logaddexp(
        np.log1p(-share) + gaussian(at, mean, factor, wide),
        np.log(share) + gaussian(at, centre, np.eye(mean.shape[1]), wide),
    )
    return at, log_q


def of_lines(u: Array, owner: Indices, line: Indices, log_value: Array) -> Array:
    """The logarithms (B, J) of sums over the points of each line, at positions u (B, J, d).

    `log_value` (H,) are the logarithms of the values that are summed, of experiments `owner` (H,)
    and lines `line` (H,).
    """
    found = np.full(u.shape[:2], -np.inf)
    np.logaddexp.at(found, (owner, line), log_value)
    return found


def _changes(off: Array) -> Flags:
    """Flags (..., T - 1) of the pairs of neighbors, among values (..., T), with unlike signs."""
    with np.errstate(invalid="ignore"):
        above, known = off > 0.0, np.isfinite(off)
    found: Flags = above[..., 1:] != above[..., :-1]
    return found & known[..., 1:] & known[..., :-1]


def _between(low: Array, high: Array, f_low: Array, f_high: Array) -> Array:
    """The place at which the straight line between two points (low, f_low), (high, f_high) is 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = f_low / (f_low - f_high)
    return np.asarray(low + np.clip(np.nan_to_num(share, nan=0.5), 0.0, 1.0) * (high - low))


def _reflected(direction: Array) -> Array:
    """Orthonormal bases (B, s, s) with the direction (B, s) as first column, by Householder."""
    s = direction.shape[1]
    side = direction.copy()
    sign = np.where(direction[:, 0] > 0.0, 1.0, -1.0)
    side[:, 0] += sign
    square = np.sum(side**2, axis=1)[:, None, None]
    matrix = np.eye(s) - 2.0 * side[:, :, None] * side[:, None, :] / square
    return np.asarray(-sign[:, None, None] * matrix)


def gauss_nodes(count: int, dimensions: int, limits: tuple[int, int]) -> tuple[Array, Array]:
    """About `count` nodes (J, d) of the standard normal law, and their log weights (J,).

    Up to three dimensions they are those of a product of Gauss-Hermite rules. In more dimensions
    they are points of a Sobol' sequence with their mirror images, scaled so that the mean and the
    covariance are those of the law.
    """
    if dimensions <= 3:
        each = int(np.clip(round(count ** (1.0 / dimensions)), *limits))
        t, weight = gauss_hermite(each)
        grid = np.meshgrid(*[t] * dimensions, indexing="ij")
        weights = np.meshgrid(*[np.log(weight)] * dimensions, indexing="ij")
        return np.stack([g.ravel() for g in grid], axis=1), np.sum(weights, axis=0).ravel()
    half = sobol_scores(max(count // 2, 4 * dimensions), dimensions)
    z = np.concatenate([half, -half])
    z = z @ np.linalg.inv(np.linalg.cholesky(z.T @ z / len(z))).T
    return z, np.full(len(z), -np.log(len(z)))


@lru_cache
def sobol_scores(count: int, dimensions: int, seed: int = 1) -> Array:
    """Normal scores (count, dimensions) of a Sobol' sequence, scrambled with a fixed seed."""
    u = qmc.Sobol(dimensions, rng=seed).random_base2(int(np.ceil(np.log2(count))))[:count]
    least = RULES.least_probability
    found = np.asarray(special.ndtri(np.clip(u, least, 1.0 - least)))
    found.flags.writeable = False
    return found


@dataclass(frozen=True, eq=False)
class _Crossed:
    """All crossings of lines with level sets.

    `owner` (H,) is the experiment of each crossing, `line` (H,) the number of its line, and `xi`
    (H, s) its variates. `log_slope` (H,) is the logarithm of the outcome's absolute slope along the
    line, and `log_others` (H, s - 1) are those of the slopes normal to it. `power` is the power p
    of the slopes by which directions are weighted.
    """

    owner: Indices
    line: Indices
    xi: Array
    log_slope: Array
    log_others: Array
    power: int

    @cached_property
    def log_part(self) -> Array:
        """The log weight (H,) of this direction of lines among all directions.

        The weight is g_1^2p / sum_i g_i^2p with the slopes g_i. It is zero where a line only
        touches the set, and one where the line goes straight through it.
        """
        every = np.concatenate([self.log_slope[:, None], self.log_others], axis=1)
        power = 2.0 * self.power
        with np.errstate(invalid="ignore"):
            whole = special.logsumexp(power * every, axis=1)
        return np.asarray(np.nan_to_num(power * self.log_slope - whole, nan=-np.inf))

    @property
    def log_alone(self) -> Array:
        """The logarithm (H,) of phi/|g_1|, for lines in this direction alone."""
        return normal(self.xi) - self.log_slope

    @property
    def log_value(self) -> Array:
        """The logarithm (H,) of phi/|g_1| times the weight of this direction (`log_part`)."""
        return self.log_alone + self.log_part

    def weighed(self, log_q: Array, log_value: Array) -> tuple[Indices, Array, Array]:
        """The experiments (H,), variates (H, s) and log weights (H,) of the crossings.

        `log_q` (B, J) is the logarithm of the density of the lines' positions times their number.
        """
        return self.owner, self.xi, log_value - log_q[self.owner, self.line]

    def moments(self, log_q: Array, count: int) -> tuple[Array, Array, Array]:
        """The weighted means (B, s) and covariances (B, s, s) of the crossings of each experiment.

        Also returns the share (B,) of the set that lines in other directions represent better.
        """
        owner, xi = self.owner, self.xi
        log_share = self.log_value - log_q[owner, self.line]
        top = np.full(count, -np.inf)
        np.maximum.at(top, owner, log_share)
        share = np.exp(log_share - top[owner])
        whole = np.bincount(owner, share, count)
        share = share / whole[owner]
        mean = np.zeros((count, xi.shape[1]))
        np.add.at(mean, owner, share[:, None] * xi)
        off = xi - mean[owner]
        square = np.zeros((count, xi.shape[1], xi.shape[1]))
        np.add.at(square, owner, share[:, None, None] * off[:, :, None] * off[:, None, :])
        with np.errstate(invalid="ignore", over="ignore"):
            others = np.minimum(share * np.expm1(-self.log_part), 1.0)
        left = np.where(whole > 0.0, np.bincount(owner, np.nan_to_num(others, nan=1.0), count), 1.0)
        return mean, square, left


def gaussian(u: Array, mean: Array, factor: Array, wide: float = 1.0) -> Array:
    """The log-density (B, J) at u (B, J, d) of normal laws with these means and Cholesky factors.

    `wide` multiplies the factors.
    """
    factor = np.broadcast_to(factor, (len(u), *factor.shape[-2:]))
    own = np.linalg.solve(wide * factor, (u - mean[:, None]).transpose(0, 2, 1)).astype(np.float64)
    volume = np.log(np.diagonal(wide * factor, axis1=1, axis2=2)).sum(axis=1)[:, None]
    return np.asarray(normal(own.transpose(0, 2, 1)) - volume)


def normal(u: Array) -> Array:
    """The standard normal log-density (...) at u (..., d)."""
    return np.asarray(-0.5 * np.sum(u**2, axis=-1) - 0.5 * u.shape[-1] * np.log(2.0 * np.pi))


def fitted(u: Array, value: Array, settings: Crossings) -> tuple[Array, Array]:
    """Normal laws fitted to log values (B, J) at u (B, J, d): means (B, d), Cholesky (B, d, d).

    A quadratic function is fitted to the log values by least squares, in which the largest values
    have most weight. The fit is exact if the values are those of a normal law.
    """
    count, _, d = u.shape
    pairs = np.triu_indices(d)
    top = np.max(value, axis=1, initial=-np.inf, keepdims=True)
    with np.errstate(invalid="ignore"):
        weight = np.exp(settings.weight * (value - np.where(np.isfinite(top), top, 0.0)))
    weight = np.where(np.isfinite(value), weight, 0.0)
    terms = np.concatenate(
        [np.ones((*value.shape, 1)), u, u[..., pairs[0]] * u[..., pairs[1]]], axis=2
    )
    beyond = np.where(np.isfinite(value), value + 0.5 * np.sum(u**2, axis=2), 0.0)
    weighted = terms * weight[..., None]
    square = np.einsum("bjk,bjl->bkl", weighted, weighted)
    ridge = settings.ridge * (1.0 + np.trace(square, axis1=1, axis2=2))[:, None, None]
    right = np.einsum("bjk,bj->bk", weighted, weight * beyond)
    found = np.linalg.solve(square + ridge * np.eye(terms.shape[2]), right[..., None])[..., 0]
    bend = np.zeros((count, d, d))
    bend[:, pairs[0], pairs[1]] = found[:, 1 + d :]
    precision = np.eye(d) - bend - bend.transpose(0, 2, 1)
    values, vectors = np.linalg.eigh(precision)
    values = np.clip(values, settings.narrow[0], settings.narrow[1])
    slope = np.einsum("bij,bi->bj", vectors, found[:, 1 : 1 + d]) / values
    mean = np.clip(np.einsum("bij,bj->bi", vectors, slope), -settings.reach, settings.reach)
    covariance = np.einsum("bik,bk,bjk->bij", vectors, 1.0 / values, vectors)
    return mean, np.linalg.cholesky(covariance)
