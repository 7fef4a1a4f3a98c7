"""The uncertain parameters and their joint law: x = T(theta | alpha)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse, special

from aleator.errors import InputsError
from aleator.laws import Hyperparameter, Law, Normal, Rule, Specification
from aleator.laws.correlation import Correlation, Pair, between
from aleator.polynomials.gauss import gauss_hermite, tensor
from aleator.polynomials.indices import total_degree
from aleator.polynomials.recurrence import evaluate
from aleator.threads import single_threaded
from aleator.types import Array

GERM: Law = Normal(0.0, 1.0)
"""The law of the germ of a correlated parameter."""
SMALLEST, LARGEST = 1e-300, 1.0 - 2.0**-53
"""Probabilities between which the germ of a sample is finite."""


@dataclass(frozen=True)
class Lattice:
    """How J nodes lie on an even grid of the standard normal germ.

    `distance2` (J,) is their squared distance from the origin. `width`, below one, is the standard
    deviation in the germ of the smoothing that leaves no spikes of a sum over the nodes. `first`
    and `second` hold for each axis of the grid the matrix (J, J) of central differences, first and
    second; at the border of the grid one-sided ones, and no curvature.
    """

    distance2: Array
    width: float
    first: tuple[sparse.csr_array, ...]
    second: tuple[sparse.csr_array, ...]


@dataclass(frozen=True)
class Nodes:
    """A cubature rule of J nodes in n parameters with K hyperparameters.

    `x` (J, n), `weights` (J,) that sum to one, and the derivatives by alpha: `dx` (J, n, K),
    `dweights` (J, K). `dx[:, i, k]` lies in one piece in memory. `lattice` tells how the nodes lie
    in the germ, where that is an even grid.
    """

    x: Array
    weights: Array
    dx: Array
    dweights: Array
    lattice: Lattice | None = None


class Inputs:
    """Named parameters with their marginal laws, in a fixed order, and what ties them.

    alpha (K,) holds the hyperparameters of all laws, fixed ones included, named
    ``<parameter>.<hyperparameter>``, and after them the correlations. Parameters are independent
    but for the pairs in `correlation`, each a number or `Free(lower, upper)` within [-1, 1]. The
    joint law of correlated parameters is a Gaussian copula: x_i = F_i^-1(Phi(theta_i)) with normal
    theta of that correlation; for normal laws that is the normal law with full covariance. Their
    nodes and polynomials are those of the germ. See `aleator.correlation.between` for more than two
    correlated parameters. Raises InputsError when there is no parameter, when a name is not an
    identifier, and for a pair or limits that are inadmissible.

    >>> from aleator.laws import Constant, Free, Normal
    >>> inputs = Inputs({"v": Normal(mean=Free(-1, 1), sd=0.5), "b0": Constant(2.0)})
    >>> [h.name for h in inputs.hyperparameters]
    ['v.mean', 'v.sd', 'b0.value']
    >>> tied = Inputs({"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, {("a", "b"): Free(-0.9, 0.9)})
    >>> tied.hyperparameters[-1].name
    'correlation.a.b'
    >>> tied.correlation_matrix(np.array([0.0, 1.0, 0.0, 1.0, 0.6])).tolist()
    [[1.0, 0.6], [0.6, 1.0]]
    """

    def __init__(
        self,
        laws: Mapping[str, Law],
        correlation: Mapping[Pair, Specification] | None = None,
    ) -> None:
        if not laws:
            raise InputsError("no parameter is given", "name at least one parameter with a law")
        for name in laws:
            if not name.isidentifier():
                raise InputsError(
                    f"parameter name '{name}' is not an identifier",
                    "use letters, digits and underscores, not starting with a digit",
                )
        self.laws = dict(laws)
        scattered = [name for name, law in laws.items() if law.scatters]
        self.correlation: Correlation = between(scattered, correlation or {})

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return tuple(self.laws)

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha."""
        own = [h.named(name) for name, law in self.laws.items() for h in law.hyperparameters]
        return (*own, *self.correlation.hyperparameters)

    @property
    def size(self) -> int:
        """K, the length of alpha without the noise's part."""
        return len(self.hyperparameters)

    @cached_property
    def box(self) -> Array:
        """Limits (n, 2) that hold every node for every admissible alpha."""
        return np.array([law.box for law in self.laws.values()])

    @property
    def bounded(self) -> bool:
        """Whether the user stated the box of every parameter."""
        return all(law.bounded for law in self.laws.values())

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """Where each law's hyperparameters stand in alpha."""
        ends = np.cumsum([len(law.hyperparameters) for law in self.laws.values()]).tolist()
        return tuple(slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True))

    @property
    def scattering(self) -> int:
        """How many parameters vary between experiments."""
        return len(self.scattered)

    @cached_property
    def scattered(self) -> tuple[int, ...]:
        """Which parameters vary between experiments; each has a germ."""
        return tuple(i for i, law in enumerate(self.laws.values()) if law.scatters)

    @cached_property
    def correlated(self) -> tuple[int, ...]:
        """Which parameters are correlated with another, in the order of `correlation`."""
        return tuple(self.scattered[i] for i in self.correlation.members)

    def correlation_matrix(self, alpha: Array) -> Array:
        """Correlations R (n, n) of the normal germs theta, and of x itself where laws are normal.

        Rank correlations of any continuous laws are 6/pi arcsin(R/2).
        """
        matrix = np.eye(len(self.names))
        at = np.ix_(self.correlated, self.correlated)
        matrix[at] = self.correlation.matrix(alpha[self._partials])[0]
        return matrix

    def correlation_slope(self, alpha: Array) -> Array:
        """dR/dalpha (n, n, K), for the standard errors of the correlations."""
        n = len(self.names)
        slope = np.zeros((n, n, self.size))
        at = np.ix_(self.correlated, self.correlated, range(*self._partials.indices(self.size)))
        slope[at] = self.correlation.matrix(alpha[self._partials])[1]
        return slope

    def nodes(self, alpha: Array, per_dimension: int) -> Nodes:
        """The tensor Gauss rule of the joint law, with its derivatives by alpha.

        J = per_dimension ** (number of scattering parameters). Exact for polynomials of degree
        2 per_dimension - 1 in each parameter. Cost O(J n K). Other rules: `aleator.cubature`.
        """
        rules = self.axes(alpha, per_dimension)
        return self.product(alpha, rules, tensor(tuple(rule.x.size for rule in rules)))

    def axes(self, alpha: Array, per_dimension: int) -> list[Rule]:
        """A Gauss rule for each parameter (n of them), whose product is a rule of the joint law.

        A constant has one node; a correlated parameter has the rule of its standard normal germ.
        """
        rules = []
        for i, (law, part) in enumerate(zip(self.laws.values(), self.slices, strict=True)):
            if i in self.correlated:
                germ, weights = gauss_hermite(per_dimension)
                still = np.zeros((per_dimension, len(law.hyperparameters)))
                rules.append(Rule(germ, weights, germ, still, still))
            else:
                rules.append(law.rule(alpha[part], per_dimension))
        return rules

    @single_threaded
    def product(self, alpha: Array, rules: Sequence[Rule], picks: NDArray[np.int64]) -> Nodes:
        """Nodes that combine one node of each parameter's rule (n of them), by `picks` (J, n).

        The weights are the products of those of the rules.
        """
        count, n = picks.shape
        x, dx = _room(count, n, self.size)
        weights, dweights = np.ones(count), np.zeros((count, self.size))
        factors = [rule.weights[picks[:, i]] for i, rule in enumerate(rules)]
        for i, (rule, part) in enumerate(zip(rules, self.slices, strict=True)):
            x[:, i] = rule.x[picks[:, i]]
            dx[:, i, part] = rule.dx[picks[:, i]]
            weights *= factors[i]
            if np.any(rule.dweights):
                others = np.prod([np.ones(count), *factors[:i], *factors[i + 1 :]], axis=0)
                dweights[:, part] = others[:, None] * rule.dweights[picks[:, i]]
        germ = np.stack([rule.germ[picks[:, i]] for i, rule in enumerate(rules)])
        self._place_correlated(alpha, germ, x, dx)
        return Nodes(x, weights, dx, dweights)

    @single_threaded
    def image(self, alpha: Array, germ: Array) -> tuple[Array, Array]:
        """Parameters x (J, n) of independent standard normal germs (J, scattering), and dx/dalpha.

        x_i = F_i^-1(Phi(theta_i) | alpha) with theta held: smooth in alpha, so that averages over
        fixed germs have exact derivatives `dx` (J, n, K). theta is the germ itself, or L germ for
        correlated parameters.

        >>> from aleator.laws import Normal
        >>> x, dx = Inputs({"v": Normal(1.0, 0.5)}).image(np.array([1.0, 0.5]), np.array([[2.0]]))
        >>> x.tolist(), dx.tolist()
        ([[2.0]], [[[1.0, 2.0]]])
        """
        count, n = germ.shape[0], len(self.names)
        theta = np.zeros((n, count))
        theta[list(self.scattered)] = germ.T
        x, dx = _room(count, n, self.size)
        for i, (law, part) in enumerate(zip(self.laws.values(), self.slices, strict=True)):
            if i not in self.correlated:
                own = law.standard(alpha[part], theta[i])
                x[:, i] = own.x
                dx[:, i, part] = own.dvalues
        self._place_correlated(alpha, theta, x, dx)
        return x, dx

    def independent(self, alpha: Array) -> tuple[tuple[Law, ...], tuple[Array, ...]]:
        """Laws and their values (n each) of the independent variables that x is made of.

        That is the parameter's own law, or N(0, 1), the germ's, where the parameter is correlated:
        polynomials of these are orthonormal under the joint law. `joined` gives x.
        """
        tied = set(self.correlated)
        laws = [GERM if i in tied else law for i, law in enumerate(self.laws.values())]
        values = [
            np.array([0.0, 1.0]) if i in tied else alpha[part] for i, part in enumerate(self.slices)
        ]
        return tuple(laws), tuple(values)

    def joined(self, alpha: Array, own: Array) -> Array:
        """Parameters x (J, n) made of the `independent` variables (J, n): the germs are mixed.

        >>> from aleator.laws import Normal
        >>> pair = Inputs({"a": Normal(1.0, 2.0), "b": Normal(0.0, 1.0)}, {("a", "b"): 0.6})
        >>> pair.joined(np.array([1.0, 2.0, 0.0, 1.0, 0.6]), np.ones((1, 2))).round(9).tolist()
        [[3.0, 1.4]]
        """
        x, dx = _room(own.shape[0], own.shape[1], self.size)
        x[:] = own
        self._place_correlated(alpha, own.T, x, dx)
        return x

    def expansion_map(
        self, alpha: Array, per_dimension: int, degree: int, order: int
    ) -> tuple[Array, Array]:
        """Matrix (F, J) from outcomes at the nodes to the expansion at F finer nodes, and weights.

        The coefficients are c_i = sum_j eta_j psi_i(theta_j) w_j (paper, eq. (quadrature)) in the
        total-degree basis; the finer rule, with floor(order degree / 2) + 1 nodes a dimension,
        integrates the expansion to the power `order` exactly (paper, eq. (moments)).
        """
        limits = tuple(degree if law.scatters else 0 for law in self.laws.values())
        indices = total_degree(limits, degree)
        fine_nodes = order * degree // 2 + 1
        coarse, coarse_weights = self._basis(alpha, per_dimension, limits, indices)
        fine, fine_weights = self._basis(alpha, fine_nodes, limits, indices)
        return fine @ (coarse * coarse_weights[:, None]).T, fine_weights

    def marginal(self, alpha: Array, probability: Array) -> Array:
        """Quantiles (R, n) of each parameter's own law at probabilities (R, n)."""
        columns = [
            law.quantile(alpha[part], probability[:, i])
            for i, (law, part) in enumerate(zip(self.laws.values(), self.slices, strict=True))
        ]
        return np.stack(columns, axis=1)

    def sample(self, alpha: Array, uniform: Array) -> Array:
        """Parameters (R, n) of the joint law from independent uniform numbers (R, n)."""
        x = self.marginal(alpha, uniform)
        if self.correlated:
            germ = special.ndtri(np.clip(uniform.T, SMALLEST, LARGEST))
            self._place_correlated(alpha, germ, x, _room(x.shape[0], x.shape[1], self.size)[1])
        return x

    def log_density(self, alpha: Array, x: Array) -> Array:
        """log p(x | alpha) at each x (J, n), minus infinity outside the support.

        The sum of the marginal log-densities and, for correlated parameters, the log-density of
        the Gaussian copula: -1/2 log det R - 1/2 theta' (R^-1 - I) theta with the normal scores
        theta of x (Song, 2000). A constant counts as a probability: zero at its value. Cost O(J n).

        >>> from aleator.laws import Normal
        >>> pair = Inputs({"a": Normal(0.0, 1.0), "b": Normal(0.0, 1.0)}, {("a", "b"): 0.6})
        >>> alpha = np.array([0.0, 1.0, 0.0, 1.0, 0.6])
        >>> pair.log_density(alpha, np.zeros((1, 2))).round(6).tolist()   # -log(2 pi 0.8)
        [-1.614734]
        """
        laws, parts = list(self.laws.values()), self.slices
        found = np.zeros(x.shape[0])
        for i, law in enumerate(laws):
            found += law.log_density(alpha[parts[i]], x[:, i])
        if not self.correlated:
            return found
        inside = np.flatnonzero(found > -np.inf)
        scores = [laws[i].normal_score(alpha[parts[i]], x[inside, i]) for i in self.correlated]
        theta = np.stack(scores)
        factor, _ = self.correlation.cholesky(alpha[self._partials])
        xi = linalg.solve_triangular(factor, theta, lower=True)
        found[inside] -= np.log(np.diag(factor)).sum() + 0.5 * np.sum(xi**2 - theta**2, axis=0)
        return found

    @property
    def _partials(self) -> slice:
        """Where the partial correlations stand in alpha."""
        return slice(self.slices[-1].stop, self.size)

    def _place_correlated(self, alpha: Array, germ: Array, x: Array, dx: Array) -> None:
        """Write the correlated parameters at independent germs (n, J) into x and dx."""
        if not self.correlated:
            return
        laws, xi = list(self.laws.values()), germ[list(self.correlated)]
        factor, slope = self.correlation.cholesky(alpha[self._partials])
        theta = factor @ xi
        for row, i in enumerate(self.correlated):
            own = laws[i].standard(alpha[self.slices[i]], theta[row])
            x[:, i] = own.x
            dx[:, i, self.slices[i]] = own.dvalues
            for k in np.flatnonzero(np.any(slope[row], axis=0)):
                dx[:, i, self._partials.start + k] = own.dtheta * (slope[row, :, k] @ xi)

    def _basis(
        self,
        alpha: Array,
        per_dimension: int,
        limits: tuple[int, ...],
        indices: NDArray[np.int64],
    ) -> tuple[Array, Array]:
        rules = self.axes(alpha, per_dimension)
        picks = tensor(tuple(rule.x.size for rule in rules))
        basis = np.ones((picks.shape[0], indices.shape[0]))
        weights = np.ones(picks.shape[0])
        for i, (law, values) in enumerate(zip(*self.independent(alpha), strict=True)):
            a, b = law.recurrence(values, limits[i] + 1)
            table = evaluate(a, b, rules[i].germ, limits[i])
            basis *= table[picks[:, i]][:, indices[:, i]]
            weights *= rules[i].weights[picks[:, i]]
        return basis, weights


def _room(count: int, n: int, size: int) -> tuple[Array, Array]:
    """Zeros for x (J, n) and dx (J, n, K), laid out so that a derivative is one piece.

    Memory that no law writes to, because x_i does not depend on the hyperparameters of the others,
    is then never touched.
    """
    return np.zeros((n, count)).T, np.zeros((n, size, count)).transpose(2, 0, 1)
