"""A likelihood ready to be searched, built from experiments, a simulator and the user's choices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from aleator.densities import Convolution, Density, MaximumEntropy, NodeDensity
from aleator.expansion import Regression
from aleator.laws import Hyperparameter
from aleator.laws.inputs import Inputs
from aleator.likelihood.likelihood import Likelihood
from aleator.likelihood.propagation import (
    Collocation,
    ExpandedPropagation,
    NodePropagation,
    Propagation,
    QuadraturePropagation,
    as_cubature,
    default_cubature,
)
from aleator.observations.noise import Noise
from aleator.polynomials.indices import TotalDegree
from aleator.progress import Progress
from aleator.quadrature import Cubature, GermGrid, TensorGauss
from aleator.simulators import NoOutcome, Runner
from aleator.surrogates import ResponseSurface, Surface, build_surface
from aleator.surrogates.attempts import attempts
from aleator.surrogates.responses import Confined, DirectResponse, Response, Run, moving_parameters
from aleator.types import Array, Indices

ALIKE = 1e-3
"""Moments, in standard deviations, that agree to this (rms over experiments) are the same to a
likelihood."""

SHARES = (12.0, 24.0)
"""Width of the region over the standard deviation of the laws at which nodes are compared."""
DEGREES = (2, 3, 4)
"""Degrees of the expansions that are tried in many parameters, with one more to compare."""

MOST_ON_LATTICE = 3
"""Scattering parameters up to which the nodes of a density over nodes are a lattice."""


@dataclass(frozen=True)
class Model:
    """The user's choices that make a likelihood of a simulator and a table."""

    inputs: Inputs
    noise: Noise | None
    propagation: ResponseSurface | Collocation
    density: Density | NodeDensity

    @property
    def hyperparameters(self) -> tuple[Hyperparameter, ...]:
        """All hyperparameters in the order of alpha: the inputs', then the noise's."""
        noise = (self.noise.hyperparameter,) if self.noise else ()
        return self.inputs.hyperparameters + noise

    def noise_sd(self, alpha: Array) -> float:
        """The noise's standard deviation in alpha (K,); zero without noise."""
        return float(alpha[-1]) if self.noise else 0.0


def default_density(
    inputs: Inputs, noise: Noise | None, propagation: ResponseSurface | Collocation
) -> Density | NodeDensity:
    """The density where the user does not choose one.

    The convolution where nodes cost no run, and there is noise or they are a lattice: it is exact.
    Else maximum entropy of four moments.

    >>> from aleator.laws import Normal
    >>> inputs = Inputs({"x": Normal(0.0, 1.0)})
    >>> default_density(inputs, None, ResponseSurface()).name, default_density(
    ...     inputs, None, Collocation()).name
    ('convolution', 'maximum_entropy(4)')
    """
    surfaces = isinstance(propagation, ResponseSurface)
    if surfaces and (
        noise is not None or (inputs.scattering == 1 and has_lattice(inputs, propagation))
    ):
        return Convolution()
    return MaximumEntropy(order=4)


def has_lattice(inputs: Inputs, propagation: ResponseSurface | Collocation) -> bool:
    """Whether a density over nodes gets a lattice of them, which it needs without noise.

    A number of nodes a dimension is one of such a lattice; other nodes carry none.
    """
    if isinstance(propagation, Collocation) or not 1 <= inputs.scattering <= MOST_ON_LATTICE:
        return False
    return propagation.nodes is None or isinstance(propagation.nodes, int | GermGrid)


@dataclass(frozen=True)
class Problem:
    """Response, likelihood, and which of the U distinct conditions each experiment has, (N,).

    `region` (n, 2) is where the response is known: the box, or the part of it in focus. `surface`
    are the response surfaces of the parameters that are not known, or None for collocation.
    """

    model: Model
    likelihood: Likelihood
    response: Response
    surface: Surface | None
    region: Array
    condition: Indices
    name: str

    @property
    def moving(self) -> Indices:
        """The parameters that are not known, in the order of the surfaces' columns."""
        return moving_parameters(self.region)


def prepare(
    runner: Runner,
    outcomes: Array,
    model: Model,
    region: Array,
    progress: Progress | None = None,
    surface: Surface | None = None,
) -> Problem:
    """Build the likelihood of outcomes (N,); response surfaces on the region (n, 2) first.

    Unless they are given: `surface`, of the parameters whose region has a width.

    Experiments under equal conditions are one to the simulator: U surfaces for N experiments.
    Surfaces go through the runs that worked; collocation needs every run. Raises NoOutcome that
    names the experiments in which hardly a run worked, and where too many runs failed altogether.
    """
    first, condition = np.unique(runner.group, return_inverse=True)
    count, inputs = first.size, model.inputs

    chosen = model.propagation
    propagation: NodePropagation
    if isinstance(chosen, ResponseSurface):
        surface = surface or _built(attempts(runner, region), region, count, chosen, progress)
        _require_surfaces(surface, runner, condition)
        # the surface's own error must not shut an outcome out of the reachable range
        margin = 3.0 * surface.error
        lower, upper = surface.lower - margin, surface.upper + margin
        response: Response = Confined(surface, region)
        name = "response_surface"
        propagation = _surface_propagation(model, response, region, chosen.nodes)
    else:
        surface, name = None, chosen.name
        response = DirectResponse(
            lambda index, x: runner(first[index], x), count, inputs.box, chosen.difference_step
        )
        lower, upper = np.full(count, -np.inf), np.full(count, np.inf)
        propagation = _direct_propagation(model, response, chosen)
    likelihood = Likelihood(
        propagation,
        model.density,
        outcomes,
        condition,
        lower[condition],
        upper[condition],
        model.hyperparameters,
        bool(model.noise),
    )
    return Problem(model, likelihood, response, surface, region, condition, name)


def _surface_propagation(
    model: Model, response: Response, region: Array, chosen: int | Cubature | None
) -> QuadraturePropagation | ExpandedPropagation:
    """Nodes cost no run here: as many as are of use."""
    inputs = model.inputs
    own = isinstance(model.density, NodeDensity) and isinstance(chosen, int)
    if chosen is not None and not own:
        return QuadraturePropagation(inputs, response, as_cubature(chosen))
    cubature = default_cubature(inputs, model.density, runs=False)
    if isinstance(cubature, GermGrid) and isinstance(chosen, int):
        # of a Gauss rule, no less than what such a density asks for
        cubature = GermGrid(max(cubature.per_dimension, chosen))
    way = QuadraturePropagation(inputs, response, cubature)
    order = _order(model.density)
    if isinstance(cubature, TensorGauss):
        return _enough_nodes(way, cubature.per_dimension, region, order)
    if isinstance(model.density, NodeDensity):
        return way
    return _enough_degrees(way, region, order)


def _direct_propagation(
    model: Model, response: Response, chosen: Collocation
) -> QuadraturePropagation | ExpandedPropagation:
    inputs = model.inputs
    if chosen.fit is not None:
        return ExpandedPropagation(inputs, response, chosen.fit, _order(model.density))
    if chosen.nodes is None:
        cubature = default_cubature(inputs, model.density, runs=True)
    else:
        cubature = as_cubature(chosen.nodes)
    if chosen.moments == "quadrature":
        return QuadraturePropagation(inputs, response, cubature)
    assert isinstance(cubature, TensorGauss)
    degree = chosen.degree or cubature.per_dimension - 1
    return QuadraturePropagation(inputs, response, cubature, degree)


def _order(density: Density | NodeDensity) -> int:
    """Moments that tell whether there are enough nodes: those matched, at least four."""
    return 4 if isinstance(density, NodeDensity) else max(density.order, 4)


def _built(
    run: Run, region: Array, count: int, choice: ResponseSurface, progress: Progress | None
) -> Surface:
    """Surfaces of the parameters whose region has a width; the others are known."""
    return build_surface(run, region[moving_parameters(region)], count, choice, told(progress))


def _require_surfaces(surface: Surface, runner: Runner, condition: Indices) -> None:
    """Raise NoOutcome for experiments with so few runs that worked that they have no surface."""
    lost = np.flatnonzero(np.isinf(surface.error)[condition])
    if not lost.size:
        return
    mine = condition == condition[lost[0]]
    failures = runner.failures
    failed = np.isin(failures.index, np.flatnonzero(mine))
    raise NoOutcome(
        f"experiment '{runner.ids[lost[0]]}': {surface.failed[condition[lost[0]]]} of its "
        f"{surface.runs[condition[lost[0]]]} runs failed, too many for a response surface"
        + (f"; so it is with {lost.size - 1} more of {len(runner.ids)}" if lost.size > 1 else ""),
        "see why they failed, check the conditions of the experiment, or narrow the box or the "
        f"bounds of {' or '.join(runner.parameters)}; or leave the experiment out",
        failures.x[failed],
        failures.index[failed],
    )


def _enough_nodes(
    best: QuadraturePropagation, most: int, region: Array, order: int
) -> QuadraturePropagation:
    """The fewest nodes a dimension whose moments to `order` agree with those of `most` to ALIKE.

    Compared at laws in the middle of the region (n, 2) that span a sixth and a
    twelfth of it with one standard deviation on either side: smooth surfaces need few nodes,
    fronts need many. Every node saved is saved in each of the search's evaluations.
    """
    alphas = [_filling(best.inputs, region, share) for share in SHARES]
    wanted = [_compared(best, a, order) for a in alphas]
    for nodes in range(4, most):
        way = replace(best, cubature=TensorGauss(nodes))
        if _alike([_compared(way, a, order) for a in alphas], wanted):
            return way
    return best


def _enough_degrees(
    sampled: QuadraturePropagation, region: Array, order: int
) -> QuadraturePropagation | ExpandedPropagation:
    """The expansion of degree 2 or 3 where one more degree changes nothing, else the samples.

    In many parameters the moments of an expansion are exact where samples are not; a surface that
    bends more than its own degree tells is left to the samples.
    """
    inputs, response = sampled.inputs, sampled.response
    alphas = [_filling(inputs, region, share) for share in SHARES]
    ways = [
        ExpandedPropagation(
            inputs, response, Regression(TotalDegree(degree), adaptive=False), order
        )
        for degree in DEGREES
    ]
    lower = [_compared(ways[0], a, order) for a in alphas]
    for way, other in pairwise(ways):
        higher = [_compared(other, a, order) for a in alphas]
        if _alike(lower, higher):
            return way
        lower = higher
    return sampled


def _alike(some: list[Array], others: list[Array]) -> bool:
    gaps = (one - other for one, other in zip(some, others, strict=True))
    return all(np.mean(np.max(np.abs(gap), axis=1) ** 2) < ALIKE**2 for gap in gaps)


def _filling(inputs: Inputs, region: Array, share: float) -> Array:
    """alpha of laws in the middle of the region whose sd is its width over `share`."""
    alpha = np.array([h.start for h in inputs.hyperparameters])
    for law, part, (low, high) in zip(inputs.laws.values(), inputs.slices, region, strict=True):
        alpha[part] = law.filling(0.5 * (low + high), (high - low) / share)
    return alpha


def _compared(way: Propagation, alpha: Array, order: int) -> Array:
    """Moments on a common scale: mean and sd in sds, standardized moments damped if large."""
    m = way.moments(alpha, order + order % 2, gradient=False)
    sd = np.where(m.sd > 0.0, m.sd, 1.0)
    # an even moment bounds the odd one below it
    above = np.arange(3, order + 1) + np.arange(3, order + 1) % 2
    shape = m.standardized[:, 3 : order + 1] / (1.0 + np.abs(m.standardized[:, above]))
    return np.concatenate([(m.mean / sd)[:, None], np.log(sd)[:, None], shape], axis=1)


def told(progress: Progress | None) -> Callable[[int, int, int], None] | None:
    """A listener to surfaces that become exact."""
    if progress is None:
        return None
    listener = progress

    def tell(runs: int, converged: int, total: int) -> None:
        text = f"{runs} runs, {converged} of {total} surfaces converged"
        listener.update(text, converged, total)

    return tell
