"""alpha -> moments of every experiment: the seam that the likelihood sees.

Both ways are one computation, moments of a response at the nodes of the law; they differ in who
answers for the response: the simulator itself (collocation, the paper's way, q^n runs an experiment
for every alpha) or surfaces built once on the box (no run at all).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from aleator.errors import InputsError
from aleator.inputs import Inputs, Nodes
from aleator.moments import Moments
from aleator.outcomes import Outcomes

Array = NDArray[np.float64]
Run = Callable[[NDArray[np.int64], Array], Array]

DEFAULT_NODES = {0: 1, 1: 20, 2: 20, 3: 12, 4: 8}
"""Nodes a dimension by the number of scattering parameters, where the user does not choose."""


class Response(Protocol):
    """Outcomes of all N experiments at the same points of the box."""

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) at points x (J, n)."""
        ...

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes (N, J) and their derivatives (N, J, n) at points x (J, n)."""
        ...


class Propagation(Protocol):
    """alpha (K,) to what is known of the N outcomes, without noise."""

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments up to `order`, with jacobians by alpha if asked for."""
        ...


@runtime_checkable
class NodePropagation(Propagation, Protocol):
    """A propagation that knows the outcomes at nodes, as a `NodeDensity` needs them."""

    def outcomes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        """Outcomes at the nodes of the law, with derivatives by alpha if asked for."""
        ...


@dataclass(frozen=True)
class Collocation:
    """The user's choice to run the simulator at the q^n nodes of the law for every alpha.

    `nodes` is q, a dimension (None: 20, 20, 12, 8 for 1 to 4 scattering parameters). `moments`
    takes them by plain "quadrature" of the outcomes or from the polynomial chaos "expansion" of
    total degree `degree` (default q - 1), as the paper does with q = 5 and degree 4.
    `difference_step` is the step of the central differences that give the derivative by the
    parameters, relative to the spread of the nodes; a gradient costs 2 n q^n runs more.
    Raises InputsError for values out of range.

    >>> Collocation(nodes=5, moments="expansion", degree=4).degree
    4
    """

    nodes: int | None = None
    moments: Literal["quadrature", "expansion"] = "quadrature"
    degree: int | None = None
    difference_step: float = 1e-4

    def __post_init__(self) -> None:
        """Check at once, so that the mistake is reported where it was made."""
        check_nodes(self.nodes)
        if self.moments not in ("quadrature", "expansion"):
            raise InputsError(
                f"moments '{self.moments}' unknown", "use 'quadrature' or 'expansion'"
            )
        if self.degree is not None and not (
            self.degree >= 1 and (self.nodes is None or self.degree < self.nodes)
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

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return f"collocation({self.moments})"


@dataclass(frozen=True)
class DirectResponse:
    """The simulator itself: every call runs it, gradients by central differences.

    `run(index (R,), x (R, n))` runs it, `box` (n, 2) keeps the differences inside.
    """

    run: Run
    experiments: int
    box: Array
    difference_step: float = 1e-4

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) of N J runs."""
        index = np.repeat(np.arange(self.experiments), x.shape[0])
        outcome = self.run(index, np.tile(x, (self.experiments, 1)))
        return outcome.reshape(self.experiments, x.shape[0])

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes and central differences, from N J (2 n + 1) runs in one call.

        The step is relative to the spread of the points, or to the box of a constant; where it
        would leave the box the point moves less far on that side.
        """
        count, n = x.shape
        # exactly zero for a constant, which np.std of equal numbers is not
        spread = np.where(np.ptp(x, axis=0) > 0.0, np.std(x, axis=0), 0.0)
        width = self.box[:, 1] - self.box[:, 0]
        step = self.difference_step * np.where(spread > 0.0, spread, 0.1 * width)
        moved = np.flatnonzero(step > 0.0)
        points, gaps = [x], []
        for i in moved:
            ends = []
            for sign in (1.0, -1.0):
                shifted = x.copy()
                # a node of a rule with many nodes may itself lie beyond the box of an open law
                low, high = np.minimum(x[:, i], self.box[i, 0]), np.maximum(x[:, i], self.box[i, 1])
                shifted[:, i] = np.clip(x[:, i] + sign * step[i], low, high)
                ends.append(shifted)
            gaps.append(ends[0][:, i] - ends[1][:, i])
            points += ends
        outcome = self.evaluate(np.concatenate(points))
        parts = outcome.reshape(self.experiments, 1 + 2 * len(moved), count)
        gradient = np.zeros((self.experiments, count, n))
        for k, i in enumerate(moved):
            gradient[:, :, i] = (parts[:, 1 + 2 * k] - parts[:, 2 + 2 * k]) / gaps[k]
        return parts[:, 0], gradient


def moving_parameters(region: Array) -> NDArray[np.intp]:
    """Indices of the parameters whose region (n, 2) has a width; the others are known."""
    return np.flatnonzero(region[:, 1] > region[:, 0])


@dataclass(frozen=True)
class Confined:
    """A response known only inside a region (n, 2): outside, the value at its nearest point.

    Surfaces explode when extrapolated; a search that is still far away must not see that. An
    answer is accepted only if its law stays inside. A parameter whose region has no width is
    known: the inner response is one of the others alone.
    """

    inner: Response
    region: Array

    @cached_property
    def moving(self) -> NDArray[np.intp]:
        """The parameters that the inner response takes."""
        return moving_parameters(self.region)

    def evaluate(self, x: Array) -> Array:
        """Outcomes (N, J) at points x (J, n) moved into the region."""
        return self.inner.evaluate(self._inside(x)[:, self.moving])

    def evaluate_with_gradient(self, x: Array) -> tuple[Array, Array]:
        """Outcomes and derivatives; the derivative by a coordinate that was moved is zero."""
        inside = self._inside(x)
        value, slope = self.inner.evaluate_with_gradient(inside[:, self.moving])
        if self.moving.size == x.shape[1] and np.array_equal(inside, x):
            return value, slope
        full = np.zeros((*value.shape, x.shape[1]))
        full[:, :, self.moving] = slope
        return value, full * (inside == x)

    def _inside(self, x: Array) -> Array:
        return np.clip(x, self.region[:, 0], self.region[:, 1])


@dataclass(frozen=True)
class QuadraturePropagation:
    """Outcomes of a response at the nodes of the law, and their moments.

    With `degree` None the moments are the plain weighted sums at the nodes; else those of the
    expansion of that degree, integrated exactly (paper, eqs. (quadrature) and (moments)).
    Cost: one evaluation of the response at J = q^n points and O(N J K M).
    """

    inputs: Inputs
    response: Response
    nodes: int
    degree: int | None = None

    def moments(self, alpha: Array, order: int, *, gradient: bool) -> Moments:
        """Moments of the N outcomes, with the derivatives of just what is computed."""
        outcomes = self.outcomes(alpha, gradient=gradient)
        if self.degree is not None:
            outcomes = self._expanded(alpha, order, self.degree, outcomes)
        return outcomes.moments(order)

    def outcomes(self, alpha: Array, *, gradient: bool) -> Outcomes:
        """The outcomes of the response at the nodes, whether expanded for the moments or not."""
        nodes = self.inputs.nodes(alpha, self.nodes)
        if not gradient:
            return Outcomes(self.response.evaluate(nodes.x), nodes.weights)
        outcome, slope = self.response.evaluate_with_gradient(nodes.x)
        return Outcomes(outcome, nodes.weights, _along_alpha(slope, nodes), nodes.dweights)

    def _expanded(self, alpha: Array, order: int, degree: int, outcomes: Outcomes) -> Outcomes:
        """The expansion through the outcomes, at finer nodes that integrate its powers exactly."""

        def expansion(at: Array) -> tuple[Array, Array]:
            return self.inputs.expansion_map(at, self.nodes, degree, order)

        matrix, weights = expansion(alpha)
        fine = outcomes.y @ matrix.T
        if outcomes.dy is None:
            return Outcomes(fine, weights)
        dfine = np.einsum("fj,njk->nfk", matrix, outcomes.dy, optimize=True)
        dweights = np.zeros((weights.size, alpha.size))
        for k, h in enumerate(self.inputs.hyperparameters):
            # a basis that depends on alpha moves too; its map costs no run, so differences serve
            if not h.free:
                continue
            step = np.zeros_like(alpha)
            step[k] = 1e-5 * (alpha[k] if h.log else h.upper - h.lower)
            (up, weights_up), (down, weights_down) = (
                expansion(alpha + step),
                expansion(alpha - step),
            )
            dfine[:, :, k] += outcomes.y @ ((up - down) / (2.0 * step[k])).T
            dweights[:, k] = (weights_up - weights_down) / (2.0 * step[k])
        return Outcomes(fine, weights, dfine, dweights)


def _along_alpha(slope: Array, nodes: Nodes) -> Array:
    """dY/dalpha (N, J, K) = sum_i (d eta/d x_i)(d x_i/d alpha)."""
    dy = np.zeros((slope.shape[0], slope.shape[1], nodes.dx.shape[2]))
    for i in range(slope.shape[2]):
        for k in np.flatnonzero(np.any(nodes.dx[:, i], axis=0)):
            dy[:, :, k] += slope[:, :, i] * nodes.dx[:, i, k]
    return dy


def default_nodes(inputs: Inputs, chosen: int | None) -> int:
    """Nodes a dimension: the user's choice, or the default for the number of parameters."""
    if chosen is not None:
        return chosen
    if inputs.scattering > max(DEFAULT_NODES):
        raise InputsError(
            f"{inputs.scattering} scattering parameters make a tensor rule of too many nodes",
            "choose fewer uncertain parameters (a constant does not count), or set `nodes`",
        )
    return DEFAULT_NODES[inputs.scattering]


def check_nodes(nodes: int | None) -> None:
    """Raise InputsError unless nodes is None or between 2 and 100."""
    if nodes is not None and not 2 <= nodes <= 100:
        raise InputsError(f"nodes {nodes} is not between 2 and 100", "5 to 20 serve most cases")
