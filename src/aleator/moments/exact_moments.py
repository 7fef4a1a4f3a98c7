"""Moments of a polynomial chaos expansion, exact to rounding, with derivatives.

`prepare(basis, indices, order)` is the offline step of the paper: it computes all that does not
depend on the coefficients. Its result gives the moments for any coefficients. Let
Z = sum_i z_i psi_i be an expansion without the constant. Then `means` are E[Z^m] for m = 0..M, and
`projections` are E[Z^m psi_i] for m = 0..M-1, the derivative of E[Z^(m+1)]/(m+1) by z_i. There are
two exact methods: `ExactQuadrature` for few parameters, `Galerkin` for many.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, prod

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from aleator.core.blocks import blocks
from aleator.core.threads import single_threaded
from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.moments.expansion import Basis, constant, highest
from aleator.moments.moments import Moments


@dataclass(frozen=True)
class ExpansionMoments:
    """The moments to `order` of Y = sum_i c_i psi_i as functions of the coefficients c.

    It is the result of `prepare`, the offline step of the paper; `moments` is the online step.
    """

    indices: Indices
    order: int
    powers: QuadraturePowers | GalerkinPowers

    @single_threaded
    def moments(self, coefficients: ArrayLike) -> Moments:
        """Mean, sd and standardized moments to `order` of the expansions c (N, P).

        The mean is c_0, and the variance is the sum of the other c_i^2. Powers are taken of
        z = (Y - mean)/sd, whose coefficients are c_i/sd without the constant, because raw moments
        of an outcome with little scatter lose all digits. An expansion without scatter has sd 0 and
        standardized moments of zero from order 3 on. Raises InputsError for coefficients of another
        shape.

        >>> indices = np.array([[0], [1], [2]])
        >>> ready = prepare(Basis.normal(1), indices, 4)
        >>> chi = ready.moments([[1.0, 0.0, 2**0.5]])                            # Y = theta^2
        >>> chi.mean.tolist(), chi.sd.round(6).tolist(), chi.standardized[0, 3:].round(6).tolist()
        ([1.0], [1.414214], [2.828427, 15.0])
        """
        c = self._checked(coefficients)
        mean, sd, z = self._standardized(c)
        return Moments(mean, sd, _exact_by_definition(self.powers.means(z)))

    @single_threaded
    def moments_with_gradient(self, coefficients: ArrayLike) -> Moments:
        """The moments of `moments` with their derivatives by the coefficients, on a last axis P.

        The central moments mu_m have d mu_m/d c_i = m E[(Y - mean)^(m-1) psi_i]. With z_i = c_i/sd,
        d E[z^m]/d c_i = (m/sd) (E[z^(m-1) psi_i] - E[z^m] z_i), and zero for the constant.
        """
        c = self._checked(coefficients)
        mean, sd, z = self._standardized(c)
        projections = self.powers.projections(z)
        mean_at = constant(self.indices)
        standardized = np.zeros((c.shape[0], self.order + 1))
        # The moments follow from the projections: E[z^m] = sum_i z_i E[z^(m-1) psi_i].
        standardized[:, 1:] = np.einsum("np,nmp->nm", z, projections)
        _exact_by_definition(standardized)
        scale = np.where(sd > 0.0, sd, np.inf)[:, None, None]
        jac = np.zeros((*standardized.shape, c.shape[1]))
        m = np.arange(3, self.order + 1)
        change = projections[:, 2:] - standardized[:, 3:, None] * z[:, None, :]
        jac[:, 3:] = m[:, None] * change / scale
        jac[:, :, mean_at] = 0.0
        mean_jac = np.zeros_like(c)
        mean_jac[:, mean_at] = 1.0
        return Moments(mean, sd, standardized, mean_jac, z, jac)

    def _checked(self, coefficients: ArrayLike) -> Array:
        c = np.asarray(coefficients, dtype=float)
        if c.ndim != 2 or c.shape[1] != len(self.indices):
            raise InputsError(
                f"coefficients of shape {c.shape} for {len(self.indices)} polynomials",
                f"give an array (N, {len(self.indices)}), one row an experiment",
            )
        return c

    def _standardized(self, c: Array) -> tuple[Array, Array, Array]:
        mean_at = constant(self.indices)
        scattering = c.copy()
        scattering[:, mean_at] = 0.0
        # The coefficients are scaled before they are squared, against overflow and underflow.
        largest = np.abs(scattering).max(axis=1)
        safe = np.where(largest > 0.0, largest, 1.0)[:, None]
        sd = largest * np.linalg.norm(scattering / safe, axis=1)
        # Scatter as small as the rounding error counts as no scatter, as for weighted outcomes.
        sd = np.where(sd > 1e-14 * np.abs(c[:, mean_at]), sd, 0.0)
        return c[:, mean_at].copy(), sd, scattering / np.where(sd > 0.0, sd, np.inf)[:, None]


def prepare(
    basis: Basis, indices: Indices, order: int, way: ExactQuadrature | Galerkin | None = None
) -> ExpansionMoments:
    """The offline step: compute all that the moments to `order` need besides the coefficients.

    `indices` (P, n) are the multi-indices in the order of the coefficients; they may be any set in
    any order that includes the constant. `order` M is at least 2. `way` is the method, by default
    the `cheapest`; its cost is given there. Raises InputsError for indices that are negative,
    double or without the constant, and where the method would need too much memory.

    >>> normal = prepare(Basis.normal(1), np.array([[0], [1]]), 8).moments([[3.0, 0.1]])
    >>> normal.standardized.round(9).tolist()
    [[1.0, 0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0]]
    """
    if order < 2:
        raise InputsError(f"order {order} of the moments", "ask for order 2 or more")
    indices = _checked(basis, indices)
    chosen = way or cheapest(basis, indices, order)
    return ExpansionMoments(indices, order, chosen.powers(basis, indices, order))


def _checked(basis: Basis, given: ArrayLike) -> Indices:
    """The multi-indices (P, n) as a read-only array of whole numbers; InputsError if not valid."""
    array = np.asarray(given)
    indices = np.array(array, dtype=np.intp, order="C", copy=True)
    if indices.ndim != 2 or indices.shape[1] != len(basis.laws) or indices.size == 0:
        raise InputsError(
            f"multi-indices of shape {array.shape} for {len(basis.laws)} parameters",
            "give an array (P, n), a row for each polynomial",
        )
    if np.any(indices != array) or indices.min() < 0:
        raise InputsError("a multi-index is negative or not whole", "give degrees 0, 1, 2, ...")
    if len(np.unique(indices, axis=0)) < len(indices):
        raise InputsError("a multi-index occurs twice", "give each once")
    if np.all(indices.any(axis=1)):
        raise InputsError(
            "the multi-indices lack the constant", "add the row of zeros: it carries the mean"
        )
    indices.setflags(write=False)
    return indices


def _exact_by_definition(standardized: Array) -> Array:
    """Set the standardized moments of orders 0, 1, 2 to 1, 0, 1, free of rounding errors."""
    standardized[:, 0], standardized[:, 1], standardized[:, 2] = 1.0, 0.0, 1.0
    return standardized


def cheapest(
    basis: Basis, indices: Indices, order: int, nodes_an_entry: float = 0.1
) -> ExactQuadrature | Galerkin:
    """The method that should take less time: quadrature or Galerkin products.

    The cost of quadrature grows with its number of nodes, that of Galerkin products with their
    number of coefficients that are not zero (entries), for which there is a bound. The estimate
    compares the nodes with `nodes_an_entry` times this bound: one node takes about as long as ten
    entries. This was timed on one core for 1 to 10 parameters, degrees 2 to 8, orders 4 to 8,
    Hermite and Laguerre polynomials (`python -m benchmarks moments`). Quadrature is faster with few
    parameters, Galerkin products with five or more.

    >>> from aleator.moments.expansion import TotalDegree
    >>> def choice(n, d, order):
    ...     return cheapest(Basis.normal(n), TotalDegree(d).indices((None,) * n), order)
    >>> choice(2, 3, 5) == ExactQuadrature(), choice(10, 2, 4) == Galerkin()
    (True, True)
    """
    quadrature, galerkin = ExactQuadrature(), Galerkin()
    nodes, entries = node_count(indices, order), entry_bound(basis, indices, order)
    cheap = nodes < nodes_an_entry * entries or entries > galerkin.most
    return quadrature if cheap and nodes <= quadrature.most else galerkin


# ---------------------------------------------------------------------------- quadrature


@dataclass(frozen=True)
class ExactQuadrature:
    """The method that integrates powers of the polynomial by tensor Gauss quadrature.

    Parameter k, of degree d_k, has floor(M d_k/2) + 1 Gauss nodes, which are exact for polynomials
    of degree M d_k.

    The polynomial is evaluated on the tensor grid one parameter at a time (sum factorization), so
    that a node costs about d_k + 1 multiplications instead of P. The offline step takes almost no
    time. The online cost is O(N J (d + M)) with J = prod_k (floor(M d_k/2) + 1) nodes: 4,096 nodes
    for n = 4 parameters, degree d = 3 and order M = 5. Beyond six parameters there are too many
    nodes, and `Galerkin` should be used. Raises InputsError for more than `most` nodes (5e7), whose
    values fill 400 MB.
    """

    most: int = 50_000_000

    def powers(self, basis: Basis, indices: Indices, order: int) -> QuadraturePowers:
        """The quadrature rule for moments to `order`, and the polynomials at its nodes."""
        nodes, degrees = node_count(indices, order), highest(indices)
        if nodes > self.most:
            raise InputsError(
                f"tensor Gauss quadrature needs {nodes:.3g} nodes for {len(degrees)} "
                f"parameters of degree {max(degrees)} and order {order}",
                "use Galerkin()",
            )
        tables, weights = [], np.ones(())
        for k, degree in enumerate(degrees):
            _, w, p = basis.exact_rule(k, order * degree)
            # From order 2 on there are more nodes than degrees.
            tables.append(np.ascontiguousarray(p[:, : degree + 1]))
            weights = np.multiply.outer(weights, w)
        shape = tuple(degree + 1 for degree in degrees)
        places = np.ravel_multi_index(tuple(indices.T), shape)
        return QuadraturePowers(order, shape, places, tuple(tables), weights.reshape(-1))


def node_count(indices: Indices, order: int) -> int:
    """J, the number of nodes of the tensor rule that is exact for moments to `order`."""
    return prod(order * degree // 2 + 1 for degree in highest(indices))


@dataclass(frozen=True, eq=False)
class QuadraturePowers:
    """Moments of expansions by a tensor Gauss rule with J nodes.

    `weights` (J,) are those of the rule. `tables` hold each parameter's polynomials at its q_k
    nodes, (q_k, d_k + 1). `shape` and `places` say where each coefficient stands in a tensor of all
    degrees. At most about `at_once` values are computed at a time, so that they stay in the cache.
    """

    order: int
    shape: tuple[int, ...]
    places: Indices
    tables: tuple[Array, ...]
    weights: Array
    at_once: int = 100_000

    def means(self, z: Array) -> Array:
        """The moments E[Z^m], m = 0..M, of expansions Z = sum_i z_i psi_i, z (N, P): (N, M+1)."""
        means = np.ones((z.shape[0], self.order + 1))
        for part in blocks(z.shape[0], self.weights.size, self.at_once):
            values = self._values(z[part])
            power = np.ones_like(values)
            for m in range(1, self.order + 1):
                power *= values
                means[part, m] = power @ self.weights
        return means

    def projections(self, z: Array) -> Array:
        """Expectations E[Z^m psi_i], m = 0..M-1, with Z = sum_i z_i psi_i, z (N, P): (N, M, P)."""
        found = np.zeros((z.shape[0], self.order, z.shape[1]))
        for part in blocks(z.shape[0], self.weights.size, self.at_once):
            values = self._values(z[part])
            weighted = np.broadcast_to(self.weights, values.shape)
            for m in range(self.order):
                found[part, m] = self._project(weighted)
                weighted = weighted * values
        return found

    def _values(self, z: Array) -> Array:
        """The values of the expansions with coefficients z (N, P) at all nodes, (N, J)."""
        grid = np.zeros((z.shape[0], int(np.prod(self.shape))))
        grid[:, self.places] = z
        grid = grid.reshape(-1, *self.shape)
        for table in self.tables:
            # Each turn sums over the first axis of degrees and appends its nodes as the last axis.
            grid = np.tensordot(grid, table, axes=(1, 1))
        return grid.reshape(z.shape[0], -1)

    def _project(self, weighted: Array) -> Array:
        """Sums (N, P) over the nodes of weighted values (N, J) times each polynomial psi_i."""
        grid = weighted.reshape(-1, *(table.shape[0] for table in self.tables))
        for table in self.tables:
            grid = np.tensordot(grid, table, axes=(1, 0))
        return grid.reshape(weighted.shape[0], -1)[:, self.places]


# ---------------------------------------------------------------------------- Galerkin products


@dataclass(frozen=True)
class Galerkin:
    """The method of repeated Galerkin products, in which powers of an expansion are expansions.

    Z^(k+1) = Z^k Z, E[Z^(2k)] = <Z^k, Z^k>, E[Z^(2k+1)] = <Z^k, Z^(k+1)>, with <f, g> = E[f g]. The
    products are exact: Z^k is expanded in all polynomials that can occur in it, with the
    linearization coefficients <psi_i psi_j psi_l> = prod_k <p_(i_k) p_(j_k) p_(l_k)>, of which few
    are not zero. Powers to floor(M/2) are enough; Z^k has degree k d. Even moments are sums of
    squares and suffer no cancellation. The cost, offline and online for each experiment, is
    proportional to the number of coefficients that are not zero (entries). With degree d there are
    at most P |D_k| 2^d entries, where |D_k| polynomials occur in Z^k and k = floor((M - 1)/2). For
    ten parameters degree 2 is possible up to M = 8, and degree 3 up to M = 4. Raises InputsError
    where there may be more than `most` entries (1e8), which fill 1.2 GB.
    """

    most: int = 100_000_000

    def powers(self, basis: Basis, indices: Indices, order: int) -> GalerkinPowers:
        """The products of the polynomials with powers of an expansion, for moments to `order`."""
        entries, degrees = entry_bound(basis, indices, order), highest(indices)
        levels = _levels(order)
        strides = _strides(degrees, order)
        if entries > self.most or strides is None:
            raise InputsError(
                f"Galerkin products to order {order} of {len(indices)} functions of "
                f"{len(degrees)} parameters may need {entries:.3g} entries",
                "lower the degree or the order of the moments, or use fewer parameters",
            )
        tables = tuple(
            linearization(basis, k, degree, levels * degree, order // 2 * degree)
            for k, degree in enumerate(degrees)
        )
        keys, products = indices @ strides, []
        for level in range(1, levels + 1):
            # E[Z^(2k+1)] needs of Z^(k+1) only the polynomials that occur in Z^k.
            within = np.unique(keys) if order == 2 * level + 1 else None
            products.append(Product.of(indices, keys, strides, tables, within))
            keys = products[-1].keys
        return GalerkinPowers(order, constant(indices), tuple(products))


def entry_bound(basis: Basis, indices: Indices, order: int) -> float:
    """An upper bound of the number of coefficients that are not zero in the last Galerkin product.

    psi_i psi_j is a sum of at most prod_k (i_k + 1) polynomials if all laws are symmetric, and of
    prod_k (2 i_k + 1) otherwise. Z^k has at most as many as its largest degree in each parameter
    and its largest total degree allow.
    """
    level = _levels(order)
    degrees = highest(indices)
    alike = [basis.symmetric(k, order * d // 2 + 1) for k, d in enumerate(degrees)]
    spread = np.where(alike, 1, 2)
    split = float(np.sum(np.prod(spread * indices + 1.0, axis=1)))
    total = int(indices.sum(axis=1).max())
    functions = min(
        float(prod(level * degree + 1 for degree in degrees)),
        float(comb(len(degrees) + level * total, level * total)),
    )
    return split * functions


def _levels(order: int) -> int:
    """The number of products Z^k Z that the moments to `order` need."""
    return max((order - 1) // 2, 1)


def _strides(degrees: tuple[int, ...], order: int) -> Indices | None:
    """Strides s (n,) that turn a multi-index k of any power into one key, the whole number k . s.

    None where the keys would exceed 62 bits.
    """
    sizes = [order * degree + 1 for degree in degrees]
    if prod(sizes) >= 2**62:
        return None
    return np.array([prod(sizes[k + 1 :]) for k in range(len(sizes))], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class GalerkinPowers:
    """Moments of expansions Z by products that give Z^2, Z^3, .. one after the other.

    The experiments are taken in parts, with about `at_once` coefficients of a power at a time.
    """

    order: int
    constant: int
    products: tuple[Product, ...]
    at_once: int = 1_000_000

    def means(self, z: Array) -> Array:
        """The moments E[Z^m], m = 0..M, of expansions Z = sum_i z_i psi_i, z (N, P): (N, M+1)."""
        means = np.zeros((z.shape[0], self.order + 1))
        means[:, 0] = 1.0
        means[:, 2] = np.sum(z**2, axis=1)
        for part in self._parts(z.shape[0]):
            factor = power = z[part].T
            for level, product in enumerate(self.products, 1):
                following = product.multiplied(factor, power)
                if 2 * level + 1 <= self.order:
                    means[part, 2 * level + 1] = np.sum(following[product.places] * power, axis=0)
                if 2 * level + 2 <= self.order:
                    means[part, 2 * level + 2] = np.sum(following**2, axis=0)
                power = following
        return means

    def projections(self, z: Array) -> Array:
        """Expectations E[Z^m psi_i], m = 0..M-1, with Z = sum_i z_i psi_i, z (N, P): (N, M, P)."""
        found = np.zeros((z.shape[0], self.order, z.shape[1]))
        found[:, 0, self.constant] = 1.0
        found[:, 1] = z
        for part in self._parts(z.shape[0]):
            factor = power = z[part].T
            for level, product in enumerate(self.products, 1):
                following = product.multiplied(factor, power)
                even, odd = product.projected(power, following)
                if 2 * level < self.order:
                    found[part, 2 * level] = even.T
                if 2 * level + 1 < self.order:
                    found[part, 2 * level + 1] = odd.T
                power = following
        return found

    def _parts(self, count: int) -> list[slice]:
        largest = max(product.keys.size for product in self.products)
        return blocks(count, largest, self.at_once)


@dataclass(frozen=True, eq=False)
class Product:
    """The multiplication of Z^k, an expansion with J terms, by each polynomial psi_i of the basis.

    `keys` (L,) are the keys of the polynomials in the result (see `_strides`); `places` (J,) are
    the positions of the polynomials of Z^k among them. Multiplication by psi_i changes only the
    coefficients `rows[i]` (R_i,) of the result, by the sparse matrix `matrices[i]` (R_i, J).
    """

    keys: Indices
    places: Indices
    rows: tuple[Indices, ...]
    matrices: tuple[sparse.csr_array, ...]

    @classmethod
    def of(
        cls,
        functions: Indices,
        keys: Indices,
        strides: Indices,
        tables: tuple[Linearization, ...],
        within: Indices | None,
    ) -> Product:
        """Build the product of the polynomials psi_i of the basis with those of a power Z^k.

        `functions` (P, n) are the multi-indices of the psi_i, `keys` (J,) the polynomials of Z^k.
        If the keys `within` are given, the result is restricted to these polynomials.
        """
        indices = _decoded(keys, strides)
        entries = [multiply(factor, indices, strides, tables) for factor in functions]
        if within is None:
            within = np.unique(np.concatenate([np.unique(found) for _, found, _ in entries]))
        reached, matrices = [], []
        for columns, found, values in entries:
            places, kept = _among(within, found)
            rows, row = np.unique(places[kept], return_inverse=True)
            triplets = (values[kept], (row, columns[kept]))
            reached.append(rows)
            matrices.append(sparse.csr_array(triplets, shape=(rows.size, keys.size)))
        return cls(within, np.searchsorted(within, keys), tuple(reached), tuple(matrices))

    def multiplied(self, z: Array, power: Array) -> Array:
        """Coefficients of Z^(k+1) (L, N) from those of Z, z (P, N), and of Z^k, `power` (J, N)."""
        following = np.zeros((self.keys.size, z.shape[1]))
        for factor, rows, matrix in zip(z, self.rows, self.matrices, strict=True):
            if factor.any():
                following[rows] += (matrix @ power) * factor
        return following

    def projected(self, power: Array, following: Array) -> tuple[Array, Array]:
        """The projections of Z^(2k) and Z^(2k+1) on each polynomial psi_i, both (P, N).

        E[Z^(2k) psi_i] = <Z^k psi_i, Z^k> and E[Z^(2k+1) psi_i] = <Z^k psi_i, Z^(k+1)>, where
        `power` and `following` are the coefficients of Z^k and Z^(k+1).
        """
        embedded = np.zeros_like(following)
        embedded[self.places] = power
        even, odd = np.empty((2, len(self.rows), power.shape[1]))
        for i, (rows, matrix) in enumerate(zip(self.rows, self.matrices, strict=True)):
            # The product is computed again, since keeping all of them would fill the memory.
            image = matrix @ power
            even[i] = np.sum(image * embedded[rows], axis=0)
            odd[i] = np.sum(image * following[rows], axis=0)
        return even, odd


def _among(keys: Indices, found: Indices) -> tuple[Indices, np.ndarray]:
    """The place of each number `found` among the sorted keys, and whether it is one of them."""
    places = np.minimum(np.searchsorted(keys, found), keys.size - 1)
    return places, keys[places] == found


def _decoded(keys: Indices, strides: Indices) -> Indices:
    indices = np.empty((keys.size, strides.size), dtype=np.intp)
    rest = keys
    for k, stride in enumerate(strides):
        indices[:, k], rest = np.divmod(rest, stride)
    return indices


@dataclass(frozen=True, eq=False)
class Linearization:
    """Coefficients of products of one parameter's polynomials, p_g p_j = sum_l C_(gjl) p_l.

    Only coefficients that are not zero are listed. Those of the pair (g, j) begin at starts[g, j]
    and are counts[g, j] in number; `shift` holds l - j, and `value` holds C_(gjl) = <p_g p_j p_l>.
    """

    starts: Indices
    counts: Indices
    shift: Indices
    value: Array


def linearization(basis: Basis, k: int, degree: int, most: int, highest: int) -> Linearization:
    """The coefficients C_(gjl) of parameter k for g <= `degree`, j <= `most` and l <= `highest`.

    They are computed by a Gauss rule of q nodes, which is exact to the sum of these degrees. Those
    that vanish by orthogonality are left out: l outside |g - j| .. g + j, and an odd g + j + l if
    the law is symmetric. Cost O(degree most highest q).

    >>> products = linearization(Basis.normal(1), 0, 2, 2, 4)    # theta * theta = 1 + sqrt(2) p_2
    >>> row = slice(products.starts[1, 1], products.starts[1, 1] + products.counts[1, 1])
    >>> products.shift[row].tolist(), products.value[row].round(6).tolist()
    ([-1, 1], [1.0, 1.414214])
    """
    g, j, l = np.ogrid[: degree + 1, : most + 1, : highest + 1]
    t, weights, _ = basis.exact_rule(k, degree + most + highest)
    p = basis.table(k, t, max(degree, most, highest))
    dense = np.einsum(
        "q,qg,qj,ql->gjl", weights, p[:, g.ravel()], p[:, j.ravel()], p[:, l.ravel()], optimize=True
    )
    possible = (l >= np.abs(g - j)) & (l <= g + j)
    if basis.symmetric(k, t.size):
        possible &= (g + j + l) % 2 == 0
    counts = possible.sum(axis=2)
    starts = np.cumsum(counts).reshape(counts.shape) - counts
    shift = np.broadcast_to(l - j, possible.shape)[possible]
    return Linearization(starts, counts, shift, dense[possible])


def multiply(
    factor: Indices, indices: Indices, strides: Indices, tables: tuple[Linearization, ...]
) -> tuple[Indices, Indices, Array]:
    """The products psi_factor psi_j = sum_l T_l psi_l, for every multi-index j in `indices`.

    Returns one entry for each term: the row of j, the key sum_k l_k strides_k of l, and T_l. The
    entries are built one parameter after the other by the products of one parameter's polynomials.
    A parameter of degree zero in `factor` is skipped, so that the cost is proportional to the
    number of entries.
    """
    rows = np.arange(indices.shape[0])
    keys = indices @ strides
    values = np.ones(indices.shape[0])
    for k in np.flatnonzero(factor):
        table, degree = tables[k], indices[rows, k]
        counts = table.counts[factor[k], degree]
        parent = np.repeat(np.arange(rows.size), counts)
        first = np.cumsum(counts) - counts
        entry = table.starts[factor[k], degree][parent] + np.arange(parent.size) - first[parent]
        rows = rows[parent]
        keys = keys[parent] + table.shift[entry] * strides[k]
        values = values[parent] * table.value[entry]
    return rows, keys, values
