"""alpha -> moments of every experiment: the seam that the likelihood sees.

The ways are one computation, averages of a response over the law; they differ in who answers for
the response: the simulator itself (`Collocation`, the paper's way, runs for every alpha) or
surfaces built once on the box (no run at all); and in how the average is taken: at the nodes of a
cubature, or exactly from an expansion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Literal, Protocol

import numpy as np

from aleator.core.types import Array, Indices
from aleator.errors import InputsError
from aleator.laws import Inputs
from aleator.laws.quadrature import Cubature, CubatureNodes, SobolPoints, TensorGauss
from aleator.moments.exact_moments import ExpansionMoments, prepare
from aleator.moments.expansion import Basis, ExpansionDesign, TotalDegree
from aleator.moments.moments import Moments, NodeOutcomes
from aleator.moments.projection import Projection, Regression, expansion_map
from aleator.simulators.response_functions import Divisible, ResponseFunction

Fit = Projection | Regression


@dataclass(frozen=True)
class Collocation:
    """The user's choice to run the simulator at nodes of the law for every alpha.

    `nodes` is q, the nodes of Gauss rules a dimension (None: 20, 20, 12, 8 for 1 to 4 scattering
    parameters), or any cubature: `Smolyak(3)`, `SobolPoints(1024)`, `MonteCarloPoints(1000)`, the
    paper's `ProbabilityGrid(30)`. `moments` takes them by plain "quadrature" of the outcomes or
    from the polynomial chaos "expansion" of total degree `degree` (default q - 1), as the paper
    does with q = 5 and degree 4, in the laws' own polynomials. `fit`, instead, is an expansion in
    standard normal variates for many parameters, `Regression(TotalDegree(2))`, whose moments are
    exact too.

    `difference_step` is the step of the central differences that give the derivative by the
    parameters, relative to the spread of the nodes; a gradient costs 2 n times the runs more.
    Raises InputsError for values out of range or choices that do not go together.

    >>> Collocation(nodes=5, moments="expansion", degree=4).degree
    4
    """

    nodes: int | Cubature | None = None
    moments: Literal["quadrature", "expansion"] = "quadrature"
    degree: int | None = None
    difference_step: float = 1e-4
    fit: Fit | None = None

    def __post_init__(self) -> None:
        check_nodes(self.nodes)
        if self.moments not in ("quadrature", "expansion"):
            raise InputsError(
                f"moments '{self.moments}' unknown", "use 'quadrature' or 'expansion'"
            )
        if self.moments == "expansion" and not isinstance(self.nodes, int | None):
            raise InputsError(
                "the paper's expansion is projected on a tensor rule",
                "give nodes as a number, or choose fit=Regression(...) without nodes",
            )
        most = self.nodes - 1 if isinstance(self.nodes, int) else None
        if self.degree is not None and not (
            self.degree >= 1 and (most is None or self.degree <= most)
        ):
            raise InputsError(
                f"degree {self.degree} is not between 1 and nodes - 1",
                "a rule of q nodes determines coefficients up to degree q - 1",
            )
        if not 0.0 < self.difference_step < 0.1:
            raise InputsError(
                f"difference_step {self.difference_step} is not between 0 and 0.1",
                "use about the cube root of the simulator's relative accuracy",
            )
        self._check_fit()

    def _check_fit(self) -> None:
        if self.fit is None:
            return
        if not isinstance(self.fit, Fit):
            raise InputsError(
                f"fit {type(self.fit).__name__} is not linear in the outcomes, so that a "
                "likelihood with it would jump",
                "use Regression or Projection",
            )
        if self.nodes is not None or self.degree is not None:
            raise InputsError("fit brings nodes and degree of its own", "leave them out")
        if isinstance(self.fit, Regression) and self.fit.adaptive:
            # a degree that changes with alpha would make the likelihood jump
            object.__setattr__(self, "fit", replace(self.fit, adaptive=False))

    @property
    def name(self) -> str:
        """How the result names this choice."""
        if self.fit is not None:
            return f"collocation({type(self.fit).__name__.lower()})"
        return f"collocation({self.moments})"


def default_cubature(
    inputs: Inputs, *, runs: bool, per_dimension: tuple[int, ...] = (1, 20, 20, 12, 8)
) -> Cubature:
    """The nodes where the user does not choose; `runs` says that each of them costs runs.

    `per_dimension` are those of a tensor rule by the number of scattering parameters; 2,048 Sobol'
    points where such a rule has too many nodes. Raises InputsError where each node costs runs and a
    tensor rule has too many of them.
    """
    dimensions = inputs.scattering
    if dimensions < len(per_dimension):
        return TensorGauss(per_dimension[dimensions])
    if runs:
        raise InputsError(
            f"{dimensions} scattering parameters make a tensor rule of too many nodes",
            "set nodes = SobolPoints(512) or fit = Regression(TotalDegree(2)), or take response "
            "surfaces",
        )
    return SobolPoints(2048)


def as_cubature(nodes: int | Cubature) -> Cubature:
    """A number of nodes a dimension as a tensor rule; a cubature as it is.

    >>> as_cubature(5)
    TensorGauss(per_dimension=5)
    """
    return TensorGauss(nodes) if isinstance(nodes, int) else nodes


def finer(cubature: Cubature) -> Cubature | None:
    """A rule with more nodes, to see whether there are enough; None where that is not known.

    >>> finer(TensorGauss(8))
    TensorGauss(per_dimension=12)
    """
    if isinstance(cubature, TensorGauss):
        more = cubature.per_dimension + cubature.per_dimension // 2
        return TensorGauss(more) if more <= 100 else None
    if isinstance(cubature, SobolPoints) and cubature.points < 2**20:
        return SobolPoints(2 * cubature.points, cubature.seed)
    return None


def check_nodes(nodes: int | Cubature | None) -> None:
    """Raise InputsError unless nodes is None, a cubature, or between 2 and 100."""
    if isinstance(nodes, int) and not 2 <= nodes <= 100:
        raise InputsError(f"nodes {nodes} is not between 2 and 100", "5 to 20 serve most cases")


# ---------------------------------------------------------------------------- ways


class Propagation(Protocol):
    """alpha (K,) to what is known of the N outcomes, without noise."""

    @property
    def inputs(self) -> Inputs:
        """The joint law."""

    def at(self, alpha: Array) -> Array:
        """The points x (J, n) at which the response is evaluated."""

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments up to `order`, with jacobians by alpha if `gradient`."""


@dataclass(frozen=True)
class QuadraturePropagation:
    """Moments of the outcomes of a response, as weighted sums at the nodes of the law.

    Cost: one evaluation of the response at J points and O(N J K M).
    """

    inputs: Inputs
    response: ResponseFunction
    cubature: Cubature

    def take(self, conditions: Indices) -> QuadraturePropagation:
        """Of some of the conditions, each at most once."""
        assert isinstance(self.response, Divisible)
        return replace(self, response=self.response.take(conditions))

    def at(self, alpha: Array) -> Array:
        """The nodes of the law (J, n)."""
        return self.cubature.nodes(self.inputs, alpha).x

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the N outcomes, with the derivatives of just what is computed."""
        nodes = self.cubature.nodes(self.inputs, alpha)
        return outcomes_at(self.response, nodes, gradient=gradient).moments(order)


def outcomes_at(
    response: ResponseFunction, nodes: CubatureNodes, *, gradient: bool
) -> NodeOutcomes:
    """The outcomes of a response at nodes of the law, with derivatives by alpha if `gradient`."""
    if not gradient:
        return NodeOutcomes(response.evaluate(nodes.x), nodes.weights)
    outcome, slope = response.evaluate_with_gradient(nodes.x)
    return NodeOutcomes(outcome, nodes.weights, along_alpha(slope, nodes.dx), nodes.dweights)


def along_alpha(slope: Array, dx: Array) -> Array:
    """dY/dalpha (N, J, K) = sum_i (d eta/d x_i)(d x_i/d alpha)."""
    dy = np.zeros((slope.shape[0], slope.shape[1], dx.shape[2]))
    for i in range(slope.shape[2]):
        for k in np.flatnonzero(np.any(dx[:, i], axis=0)):
            dy[:, :, k] += slope[:, :, i] * dx[:, i, k]
    return dy


@dataclass(frozen=True)
class ProjectedPropagation:
    """Moments of the expansion that is projected on a tensor rule of `nodes` a parameter.

    The polynomials to total degree `degree` are those of the laws at alpha, and move with it; the
    moments are integrated exactly (paper, eqs. (quadrature) and (moments)). `step` is that of the
    differences of the basis by alpha, in widths of the limits or in parts of an sd. Cost: one
    evaluation of the response at J points and O(N J K M).
    """

    inputs: Inputs
    response: ResponseFunction
    nodes: int
    degree: int
    step: float = 1e-5

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the N expansions, with the derivatives of just what is computed."""
        nodes = TensorGauss(self.nodes).nodes(self.inputs, alpha)
        outcomes = outcomes_at(self.response, nodes, gradient=gradient)
        matrix, weights = self._expansion(alpha, order)
        fine = outcomes.y @ matrix.T
        if outcomes.dy is None:
            return NodeOutcomes(fine, weights).moments(order)
        dfine = np.einsum("fj,njk->nfk", matrix, outcomes.dy, optimize=True)
        dweights = np.zeros((weights.size, alpha.size))
        for k, h in enumerate(self.inputs.hyperparameters):
            # a basis that depends on alpha moves too; its map costs no run, so differences serve
            if not h.free:
                continue
            step = np.zeros_like(alpha)
            step[k] = self.step * (alpha[k] if h.log else h.upper - h.lower)
            up, weights_up = self._expansion(alpha + step, order)
            down, weights_down = self._expansion(alpha - step, order)
            dfine[:, :, k] += outcomes.y @ ((up - down) / (2.0 * step[k])).T
            dweights[:, k] = (weights_up - weights_down) / (2.0 * step[k])
        return NodeOutcomes(fine, weights, dfine, dweights).moments(order)

    def at(self, alpha: Array) -> Array:
        """The nodes of the tensor rule (J, n)."""
        return TensorGauss(self.nodes).nodes(self.inputs, alpha).x

    def _expansion(self, alpha: Array, order: int) -> tuple[Array, Array]:
        return expansion_map(self.inputs, alpha, self.nodes, self.degree, order)


@dataclass(frozen=True)
class ExpandedPropagation:
    """Moments of eta(T(theta | alpha)) expanded in Hermite polynomials of theta ~ N(0, 1).

    The points of the design, in theta, do not depend on alpha, and the coefficients are linear in
    the outcomes there, so that their derivative by alpha is that of the outcomes. The moments of
    the expansion are exact (paper, eq. (moments3.0); here by tensor Gauss rules or Galerkin
    products). `order` is the highest moment that will be needed. Cost: one evaluation of the
    response at the points, and O(N J P) besides the moments.
    """

    inputs: Inputs
    response: ResponseFunction
    fit: Fit
    order: int

    @cached_property
    def _basis(self) -> Basis:
        return Basis.normal(self.inputs.scattering)

    @cached_property
    def design(self) -> ExpansionDesign:
        """The points in theta, (J, scattering)."""
        return self.fit.design(self._basis)

    @cached_property
    def _operator(self) -> Array:
        """From outcomes at the points to coefficients, (J, P): the fit of every unit vector."""
        return self.fit.fit(self._basis, self.design, np.eye(len(self.design))).coefficients

    @cached_property
    def _exact(self) -> ExpansionMoments:
        expansion = self.fit.fit(self._basis, self.design, np.zeros((1, len(self.design))))
        return prepare(self._basis, expansion.indices, self.order)

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the expansions of the N outcomes, with derivatives if `gradient`."""
        x, dx = self.inputs.image(alpha, self.design.t)
        none = np.zeros((len(self.design), self.inputs.size))
        points = CubatureNodes(x, self.design.weights, dx, none)
        outcomes = outcomes_at(self.response, points, gradient=gradient)
        coefficients = outcomes.y @ self._operator
        if outcomes.dy is None:
            return self._exact.moments(coefficients).lowered(order)
        m = self._exact.moments_with_gradient(coefficients)
        assert m.mean_jac is not None
        assert m.sd_jac is not None
        assert m.standardized_jac is not None
        # by the outcomes first: moments are fewer than hyperparameters and polynomials
        own = np.stack(
            [m.mean_jac, m.sd_jac, *np.moveaxis(m.standardized_jac[:, 3:], 1, 0)], axis=1
        )
        change = (own @ self._operator.T) @ outcomes.dy
        standardized = np.zeros((*m.standardized.shape, self.inputs.size))
        standardized[:, 3:] = change[:, 2:]
        whole = Moments(m.mean, m.sd, m.standardized, change[:, 0], change[:, 1], standardized)
        return whole.lowered(order)

    def at(self, alpha: Array) -> Array:
        """The points of the design as parameters (J, n)."""
        return self.inputs.image(alpha, self.design.t)[0]


# ---------------------------------------------------------------------------- which way


@dataclass(frozen=True)
class NodeSettings:
    """How many nodes are of use where they cost no run (tests/moments/test_propagation.py).

    Moments, in standard deviations, that agree to `alike` (rms over experiments) are the same to a
    likelihood. Nodes are compared at laws whose standard deviation is the region's width over each
    of `shares`, from `fewest` a dimension on; in many parameters expansions of `degrees` are tried,
    the last only to compare.
    """

    alike: float = 1e-3
    shares: tuple[float, ...] = (12.0, 24.0)
    fewest: int = 4
    degrees: tuple[int, ...] = (2, 3, 4)


NODE_SETTINGS = NodeSettings()


def on_surfaces(
    inputs: Inputs,
    nodes: int | Cubature | None,
    order: int,
    response: ResponseFunction,
    region: Array,
    settings: NodeSettings = NODE_SETTINGS,
) -> Propagation:
    """The way from the law to `order` moments of outcomes that cost no run.

    The surfaces are known on a `region` (n, 2). Without `nodes` there are as many as are of use.
    """
    if nodes is not None:
        return QuadraturePropagation(inputs, response, as_cubature(nodes))
    cubature = default_cubature(inputs, runs=False)
    way = QuadraturePropagation(inputs, response, cubature)
    if isinstance(cubature, TensorGauss):
        return _enough_nodes(way, cubature.per_dimension, region, order, settings)
    return _enough_degrees(way, region, order, settings)


def collocated(
    inputs: Inputs, chosen: Collocation, order: int, response: ResponseFunction
) -> Propagation:
    """The way from the law to `order` moments of outcomes that are simulated for every alpha."""
    if chosen.fit is not None:
        return ExpandedPropagation(inputs, response, chosen.fit, order)
    if chosen.nodes is None:
        cubature = default_cubature(inputs, runs=True)
    else:
        cubature = as_cubature(chosen.nodes)
    if chosen.moments == "quadrature":
        return QuadraturePropagation(inputs, response, cubature)
    assert isinstance(cubature, TensorGauss)
    degree = chosen.degree or cubature.per_dimension - 1
    return ProjectedPropagation(inputs, response, cubature.per_dimension, degree)


def _enough_nodes(
    best: QuadraturePropagation, most: int, region: Array, order: int, settings: NodeSettings
) -> QuadraturePropagation:
    """The fewest nodes a dimension whose moments to `order` agree with those of `most`.

    Compared at laws in the middle of the region (n, 2) that span a sixth and a twelfth of it with
    one standard deviation on either side: smooth surfaces need few nodes, fronts need many. Every
    node saved is saved in each of the search's evaluations.
    """
    dense = _compared(best, region, order, settings)
    for nodes in range(settings.fewest, most):
        way = replace(best, cubature=TensorGauss(nodes))
        if _alike(_compared(way, region, order, settings), dense, settings):
            return way
    return best


def _enough_degrees(
    sampled: QuadraturePropagation, region: Array, order: int, settings: NodeSettings
) -> Propagation:
    """The expansion of degree 2 or 3 where one more degree changes nothing, else the samples.

    In many parameters the moments of an expansion are exact where samples are not; a surface that
    bends more than such a degree is left to the samples.
    """
    inputs, response = sampled.inputs, sampled.response
    ways = [
        ExpandedPropagation(
            inputs, response, Regression(TotalDegree(degree), adaptive=False), order
        )
        for degree in settings.degrees
    ]
    lower = _compared(ways[0], region, order, settings)
    for way, other in pairwise(ways):
        higher = _compared(other, region, order, settings)
        if _alike(lower, higher, settings):
            return way
        lower = higher
    return sampled


def _alike(some: list[Array], others: list[Array], settings: NodeSettings) -> bool:
    gaps = (one - other for one, other in zip(some, others, strict=True))
    return all(np.mean(np.max(np.abs(gap), axis=1) ** 2) < settings.alike**2 for gap in gaps)


def _compared(way: Propagation, region: Array, order: int, settings: NodeSettings) -> list[Array]:
    """Moments at each law on a common scale: mean and sd in sds, the others damped if large."""
    found = []
    for share in settings.shares:
        alpha = way.inputs.filling(region, share)
        m = way.moments(alpha, order + order % 2, gradient=False)
        sd = np.where(m.sd > 0.0, m.sd, 1.0)
        # an even moment bounds the odd one below it
        above = np.arange(3, order + 1) + np.arange(3, order + 1) % 2
        shape = m.standardized[:, 3 : order + 1] / (1.0 + np.abs(m.standardized[:, above]))
        columns = [(m.mean / sd)[:, None], np.log(sd)[:, None], shape]
        found.append(np.concatenate(columns, axis=1))
    return found
