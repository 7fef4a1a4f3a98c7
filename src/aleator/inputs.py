"""The uncertain parameters and their joint law: x = T(theta | alpha)."""

from __future__ import annotations

from collections.abc import Mapping
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
    """A tensor quadrature rule in n parameters with K hyperparameters.

    `x` (J, n), `weights` (J,), and the derivatives by alpha: `dx` (J, n, K), `dweights` (J, K).
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
        return sum(law.scatters for law in self.laws.values())

    @single_threaded
    def nodes(self, alpha: Array, per_dimension: int) -> Nodes:
        """The tensor Gauss rule of the joint law, with its derivatives by alpha.

        J = per_dimension ** (number of scattering parameters). Exact for polynomials of degree
        2 per_dimension - 1 in each parameter. Cost O(J n K).
        """
        rules = [
            law.rule(alpha[part], per_dimension)
            for law, part in zip(self.laws.values(), self.slices, strict=True)
        ]
        return _tensor_nodes(rules, self.slices)

    def expansion_map(
        self, alpha: Array, per_dimension: int, degree: int, order: int
    ) -> tuple[Array, Array]:
        """Matrix (F, J) from outcomes at the nodes to the expansion at F finer nodes, and weights.

        The coefficients are c_i = sum_j eta_j psi_i(theta_j) w_j (paper, eq. (quadrature)) in the
        total-degree basis; the finer rule, with floor(order degree / 2) + 1 nodes a dimension,
        integrates the expansion to the power `order` exactly (paper, eq. (moments)).
        """
        laws = list(self.laws.values())
        values = [alpha[part] for part in self.slices]
        limits = tuple(degree if law.scatters else 0 for law in laws)
        indices = total_degree(limits, degree)
        fine_nodes = order * degree // 2 + 1
        coarse, coarse_weights = self._basis(laws, values, per_dimension, limits, indices)
        fine, fine_weights = self._basis(laws, values, fine_nodes, limits, indices)
        return fine @ (coarse * coarse_weights[:, None]).T, fine_weights

    def sample(self, alpha: Array, uniform: Array) -> Array:
        """Parameters (R, n) at probabilities `uniform` (R, n), by the quantiles of the laws."""
        columns = [
            law.quantile(alpha[part], uniform[:, i])
            for i, (law, part) in enumerate(zip(self.laws.values(), self.slices, strict=True))
        ]
        return np.stack(columns, axis=1)

    @staticmethod
    def _basis(
        laws: list[Law],
        values: list[Array],
        per_dimension: int,
        limits: tuple[int, ...],
        indices: NDArray[np.int64],
    ) -> tuple[Array, Array]:
        rules = [law.rule(v, per_dimension) for law, v in zip(laws, values, strict=True)]
        picks = tensor(tuple(rule.x.size for rule in rules))
        basis = np.ones((picks.shape[0], indices.shape[0]))
        weights = np.ones(picks.shape[0])
        for i, (law, rule) in enumerate(zip(laws, rules, strict=True)):
            table = law.polynomials(values[i], rule.germ, limits[i])
            basis *= table[picks[:, i]][:, indices[:, i]]
            weights *= rule.weights[picks[:, i]]
        return basis, weights


def _tensor_nodes(rules: list[Rule], slices: tuple[slice, ...]) -> Nodes:
    picks = tensor(tuple(rule.x.size for rule in rules))
    count, n, k = picks.shape[0], len(rules), slices[-1].stop
    x = np.stack([rule.x[picks[:, i]] for i, rule in enumerate(rules)], axis=1)
    factors = np.stack([rule.weights[picks[:, i]] for i, rule in enumerate(rules)], axis=1)
    dx = np.zeros((count, n, k))
    dweights = np.zeros((count, k))
    for i, (rule, part) in enumerate(zip(rules, slices, strict=True)):
        dx[:, i, part] = rule.dx[picks[:, i]]
        others = np.prod(np.delete(factors, i, axis=1), axis=1)
        dweights[:, part] = others[:, None] * rule.dweights[picks[:, i]]
    return Nodes(x, np.prod(factors, axis=1), dx, dweights)
