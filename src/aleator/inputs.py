"""The uncertain parameters and their joint law: x = T(theta | alpha)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.indices import total_degree
from aleator.laws import Hyperparameter, Law, Rule
from aleator.quadrature import tensor
from aleator.threads import single_threaded

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Nodes:
    """A cubature rule of J nodes in n parameters with K hyperparameters.

    `x` (J, n), `weights` (J,) that sum to one, and the derivatives by alpha: `dx` (J, n, K),
    `dweights` (J, K). `dx[:, i, k]` lies in one piece in memory.
    """

    x: Array
    weights: Array
    dx: Array
    dweights: Array


class Inputs:
    """Named parameters with independent marginal laws, in a fixed order.

    alpha (K,) holds the hyperparameters of all laws, fixed ones included, named
    ``<parameter>.<hyperparameter>``. Raises InputsError when there is no parameter, when none
    scatters and nothing is to be identified, or when a name is not an identifier.

    >>> from aleator.laws import Constant, Free, Normal
    >>> inputs = Inputs({"v": Normal(mean=Free(-1, 1), sd=0.5), "b0": Constant(2.0)})
    >>> [h.name for h in inputs.hyperparameters]
    ['v.mean', 'v.sd', 'b0.value']
    """

    def __init__(self, laws: Mapping[str, Law]) -> None:
        if not laws:
            raise InputsError("no parameter is given", "name at least one parameter with a law")
        for name in laws:
            if not name.isidentifier():
                raise InputsError(
                    f"parameter name '{name}' is not an identifier",
                    "use letters, digits and underscores, not starting with a digit",
                )
        self.laws = dict(laws)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return tuple(self.laws)

    @cached_property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha."""
        return tuple(h.named(name) for name, law in self.laws.items() for h in law.hyperparameters)

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

    def nodes(self, alpha: Array, per_dimension: int) -> Nodes:
        """The tensor Gauss rule of the joint law, with its derivatives by alpha.

        J = per_dimension ** (number of scattering parameters). Exact for polynomials of degree
        2 per_dimension - 1 in each parameter. Cost O(J n K). Other rules: `aleator.cubature`.
        """
        rules = self.axes(alpha, per_dimension)
        return self.product(alpha, rules, tensor(tuple(rule.x.size for rule in rules)))

    def axes(self, alpha: Array, per_dimension: int) -> list[Rule]:
        """The Gauss rule of each parameter (n of them), whose product is a rule of the joint law.

        A constant has one node.
        """
        return [
            law.rule(alpha[part], per_dimension)
            for law, part in zip(self.laws.values(), self.slices, strict=True)
        ]

    @single_threaded
    def product(self, alpha: Array, rules: Sequence[Rule], picks: NDArray[np.int64]) -> Nodes:  # noqa: ARG002
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
                others = np.prod(factors[:i] + factors[i + 1 :], axis=0)
                dweights[:, part] = (
                    np.multiply.outer(others, np.ones(1)) * (rule.dweights[picks[:, i]])
                )
        return Nodes(x, weights, dx, dweights)

    @single_threaded
    def image(self, alpha: Array, germ: Array) -> tuple[Array, Array]:
        """Parameters x (J, n) of independent standard normal germs (J, scattering), and dx/dalpha.

        x_i = F_i^-1(Phi(theta_i) | alpha) with theta held: smooth in alpha, so that averages over
        fixed germs have exact derivatives `dx` (J, n, K).

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
            own = law.standard(alpha[part], theta[i])
            x[:, i] = own.x
            dx[:, i, part] = own.dvalues
        return x, dx

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
        return self.marginal(alpha, uniform)

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
        laws = zip(self.laws.values(), self.slices, rules, strict=True)
        for i, (law, part, rule) in enumerate(laws):
            table = law.polynomials(alpha[part], rule.germ, limits[i])
            basis *= table[picks[:, i]][:, indices[:, i]]
            weights *= rule.weights[picks[:, i]]
        return basis, weights


def _room(count: int, n: int, size: int) -> tuple[Array, Array]:
    """Zeros for x (J, n) and dx (J, n, K), laid out so that a derivative is one piece.

    Memory that no law writes to, because x_i does not depend on the hyperparameters of the others,
    is then never touched.
    """
    return np.zeros((n, count)).T, np.zeros((n, size, count)).transpose(2, 0, 1)
