"""Propagation: from the hyperparameters alpha to the moments of every experiment's outcome.

Moments are averages of functions of the response over the law of the parameters. The response is
either the simulator itself, run anew for every alpha (`Collocation`, the method of the paper), or a
response surface that was built once, which needs no further run. The average is taken either at the
nodes of a cubature, or exactly from a polynomial expansion.
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
    """The user's choice to run the simulator at nodes of the law, anew for every alpha.

    `nodes` is the number q of Gauss nodes per scattering parameter (None: 20, 20, 12, 8 for 1 to 4
    scattering parameters), or a cubature: `Smolyak(3)`, `SobolPoints(1024)`,
    `MonteCarloPoints(1000)`, or the paper's `ProbabilityGrid(30)`. `moments` says how the moments
    are computed: by "quadrature" of the outcomes at the nodes, or from the polynomial chaos
    "expansion" of total degree `degree` (default q - 1) in the polynomials of the laws, as in the
    paper with q = 5 and degree 4. `fit` takes the place of both: an expansion in standard normal
    variates, as `Regression(TotalDegree(2))`, for many parameters; its moments are exact.

    `difference_step` is the step of the central differences for the derivative of the outcome by
    the parameters, relative to the spread of the nodes. A gradient costs 2 n times as many runs in
    addition, for n parameters. Raises InputsError for values out of range, or choices that exclude
    each other.

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
            # A degree that changes with alpha would make the likelihood jump.
            object.__setattr__(self, "fit", replace(self.fit, adaptive=False))

    @property
    def name(self) -> str:
        """The name of this choice in a result."""
        if self.fit is not None:
            return f"collocation({type(self.fit).__name__.lower()})"
        return f"collocation({self.moments})"


def default_cubature(
    inputs: Inputs, *, runs: bool, per_dimension: tuple[int, ...] = (1, 20, 20, 12, 8)
) -> Cubature:
    """The default cubature, where the user chooses none; `runs`: each node costs simulator runs.

    For up to 4 scattering parameters it is a tensor Gauss rule; `per_dimension` holds its nodes per
    parameter, by the number of scattering parameters. For more parameters it is 2,048 Sobol'
    points, or InputsError is raised if each node costs runs.
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
    """A cubature from `nodes`: a number becomes the tensor rule with so many nodes per parameter.

    >>> as_cubature(5)
    TensorGauss(per_dimension=5)
    """
    return TensorGauss(nodes) if isinstance(nodes, int) else nodes


def finer(cubature: Cubature) -> Cubature | None:
    """A cubature with more nodes, to test whether the given one has enough.

    None where the cubature has no larger one of its kind here.

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
    """A method that computes moments of N outcomes from alpha (K,), without measurement errors."""

    @property
    def inputs(self) -> Inputs:
        """The joint law of the parameters."""

    def at(self, alpha: Array) -> Array:
        """The parameters x (J, n) at which the response is evaluated for alpha (K,)."""

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the N outcomes up to `order`, with jacobians by alpha if `gradient`."""


@dataclass(frozen=True)
class QuadraturePropagation:
    """Moments of the outcomes of a response, as weighted sums at the nodes of the law.

    Cost: one evaluation of the response at J points and O(N J K M).
    """

    inputs: Inputs
    response: ResponseFunction
    cubature: Cubature

    def take(self, conditions: Indices) -> QuadraturePropagation:
        """This propagation for some of the conditions, each named at most once."""
        assert isinstance(self.response, Divisible)
        return replace(self, response=self.response.take(conditions))

    def at(self, alpha: Array) -> Array:
        """The nodes (J, n) of the cubature for the law at alpha."""
        return self.cubature.nodes(self.inputs, alpha).x

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the N outcomes; their derivatives are those of the sums themselves."""
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
    """Derivatives of outcomes by alpha (N, J, K), sum_i (d eta/d x_i)(d x_i/d alpha).

    `slope` (N, J, n) are the derivatives by the parameters, `dx` (J, n, K) those of the points.
    """
    dy = np.zeros((slope.shape[0], slope.shape[1], dx.shape[2]))
    for i in range(slope.shape[2]):
        for k in np.flatnonzero(np.any(dx[:, i], axis=0)):
            dy[:, :, k] += slope[:, :, i] * dx[:, i, k]
    return dy


@dataclass(frozen=True)
class ProjectedPropagation:
    """Moments of an expansion by projection, on a tensor rule with `nodes` nodes per parameter.

    The polynomials, to total degree `degree`, are those of the laws at alpha and change with it.
    The moments of the expansion are integrated exactly (paper, eqs. (quadrature) and (moments)).
    `step` is the relative step of the differences that give the derivative of the basis by a
    hyperparameter: relative to its value where it is searched on a logarithmic scale, otherwise to
    the width of its limits. Cost: one evaluation of the response at J points and O(N J K M).
    """

    inputs: Inputs
    response: ResponseFunction
    nodes: int
    degree: int
    step: float = 1e-5

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the N expansions, with jacobians by alpha if `gradient`."""
        nodes = TensorGauss(self.nodes).nodes(self.inputs, alpha)
        outcomes = outcomes_at(self.response, nodes, gradient=gradient)
        matrix, weights = self._expansion(alpha, order)
        fine = outcomes.y @ matrix.T
        if outcomes.dy is None:
            return NodeOutcomes(fine, weights).moments(order)
        dfine = np.einsum("fj,njk->nfk", matrix, outcomes.dy, optimize=True)
        dweights = np.zeros((weights.size, alpha.size))
        for k, h in enumerate(self.inputs.hyperparameters):
            # The basis depends on alpha too. It costs no run, so that differences can be used.
            if h.is_number:
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
    """Moments of an expansion in Hermite polynomials of standard normal variates theta.

    The response eta(x) is expanded as a function of theta, where x = T(theta | alpha) maps the
    variates to parameters that follow the law at alpha. The points of the design, in theta, do not
    depend on alpha, and the coefficients are linear in the outcomes there. Therefore their
    derivative by alpha follows linearly from that of the outcomes. The moments of the expansion are
    exact (paper, eq. (moments3.0); here by tensor Gauss rules or Galerkin products). `order` is the
    highest order of the moments. Cost: one evaluation of the response at the J points, and O(N J P)
    besides the moments.
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
        """The points of the design in theta, one column for each scattering parameter."""
        return self.fit.design(self._basis)

    @cached_property
    def _operator(self) -> Array:
        """The matrix (J, P) that maps outcomes at the points to the coefficients of their fit."""
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
        # The product runs over the outcomes first: the moments are few, which saves operations.
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
    """Settings of the choice of nodes on surfaces, set by tests/moments/test_propagation.py.

    `alike`: moments, in standard deviations, that agree to this (rms over experiments) count as
    equal. `shares`: two numbers of nodes are compared at test laws whose standard deviation is the
    width of the region divided by each of these. `fewest`: the first number of nodes per parameter
    that is tried. `degrees`: degrees of the expansions that are tried for many parameters; the last
    is only compared with.
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
    """The propagation from the law to `order` moments, where the response is a surface.

    The surfaces are known on a `region` (n, 2) of the parameters. Where `nodes` is None, the number
    of nodes is the smallest that gives sufficiently accurate moments.
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
    """The propagation from the law to `order` moments, where every alpha takes simulator runs."""
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
    """The quadrature with the fewest nodes per parameter that is as accurate as one with `most`.

    The moments to `order` are compared at two test laws in the middle of the region (n, 2), with
    standard deviations of 1/12 and 1/24 of its width. Smooth surfaces need few nodes, steep fronts
    need many. A node that is saved here is saved in every evaluation of the search.
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
    """An expansion of degree 2 or 3 if one more degree leaves the moments as they are.

    Otherwise the quadrature `sampled` on Sobol' points. In many parameters the moments of an
    expansion are exact, and those of Sobol' points are not; but a surface that bends more than
    degree 3 needs the points.
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
    """Moments at each test law, scaled for comparison.

    The mean is divided by the sd, the logarithm is taken of the sd, and a standardized moment is
    divided by one plus the size of the even moment at or above it.
    """
    found = []
    for share in settings.shares:
        alpha = way.inputs.filling(region, share)
        m = way.moments(alpha, order + order % 2, gradient=False)
        sd = np.where(m.sd > 0.0, m.sd, 1.0)
        # An even moment bounds the odd moment below it.
        above = np.arange(3, order + 1) + np.arange(3, order + 1) % 2
        shape = m.standardized[:, 3 : order + 1] / (1.0 + np.abs(m.standardized[:, above]))
        columns = [(m.mean / sd)[:, None], np.log(sd)[:, None], shape]
        found.append(np.concatenate(columns, axis=1))
    return found
