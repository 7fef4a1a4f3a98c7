"""Whether other nodes or another density would serve an answer better: asked at the answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aleator.densities import Status
from aleator.likelihood.comparison import exact_movement
from aleator.likelihood.model import STAND_IN, Model
from aleator.likelihood.problem import Problem
from aleator.likelihood.propagation import QuadraturePropagation, finer
from aleator.quadrature import GermGrid, SobolPoints, TensorGauss
from aleator.types import Array

COARSE = 0.1
"""Change of the log-likelihood with more nodes that says that they are too few."""
FEWER = {1: 161, 2: 41}
"""Nodes a dimension that tell a probability to a thousandth, by scattering parameters."""
MOVES = 0.1
"""Standard errors by which the exact density has to move an estimate to be worth its time."""


def better_model(problem: Problem, alpha: Array) -> Model | None:
    """The model whose density does better at the answer alpha, where it is open; None if this does.

    The exact density takes the place of moments where it would move an estimate; four moments take
    the place of the exact density where its nodes are too few.
    """
    model = problem.model
    if not model.open:
        return None
    if problem.levels is not None:
        return None
    if model.exact:
        return model.by_moments() if _moments_serve(problem, alpha) else None
    return model.exactly() if exact_movement(problem, alpha) > MOVES else None


def quadrature_gap(problem: Problem, alpha: Array) -> float:
    """Change of the log-likelihood when every parameter gets half as many nodes again.

    Zero for collocation, where nodes cost runs, and for level sets, which have none.
    """
    way = _more_nodes(problem)
    if way is None or problem.levels is not None:
        return 0.0
    more = replace(problem, predictive=replace(problem.predictive, propagation=way))
    found = problem.likelihood.evaluate(alpha).likelihood
    return more.likelihood.evaluate(alpha).likelihood - found


def with_fewer_nodes(problem: Problem, alpha: Array) -> Problem:
    """The same with the fewest nodes of a lattice that probabilities at alpha are told by."""
    predictive = problem.predictive
    way, few = predictive.propagation, FEWER.get(problem.model.inputs.scattering)
    if few is None or not isinstance(way, QuadraturePropagation):
        return problem
    if not isinstance(way.cubature, GermGrid) or way.cubature.per_dimension <= few:
        return problem
    fewer = replace(predictive, propagation=replace(way, cubature=GermGrid(few)))
    if np.any(fewer.fitted(alpha).status == Status.TOO_COARSE):
        return problem
    return replace(problem, predictive=fewer)


def nodes_remedy(problem: Problem) -> str:
    """The key of a study that makes the nodes more, with a value to try."""
    way = _more_nodes(problem)
    assert way is not None
    assert problem.model.surfaces is not None
    more = way.cubature
    if isinstance(more, TensorGauss):
        return f"raise propagation.nodes, to {more.per_dimension}"
    if isinstance(more, GermGrid):
        alone = problem.model.inputs.scattering == 1 and problem.model.surfaces.nodes is None
        if alone and problem.model.exact:
            kind = 'with density.kind = "convolution" '
            return f"{kind}raise density.points, to {more.per_dimension}"
        rule = f'{{rule = "germ_grid", per_dimension = {more.per_dimension}}}'
    else:
        assert isinstance(more, SobolPoints)
        rule = f'{{rule = "sobol", points = {more.points}}}'
    return f"raise the nodes: propagation.nodes = {rule}"


def density_remedy(model: Model) -> str:
    """What to try where the density is not that of the simulator."""
    if model.exact:
        return "lower the tolerance of the surface, or take more points of the convolution"
    if model.lattice:
        return 'take density.kind = "convolution", which is exact, or a higher order'
    return "take a higher order (6), and compare"


def _more_nodes(problem: Problem) -> QuadraturePropagation | None:
    way = problem.predictive.propagation
    if problem.surface is None or not isinstance(way, QuadraturePropagation):
        return None
    more = finer(way.cubature)
    return None if more is None else replace(way, cubature=more)


def _moments_serve(problem: Problem, alpha: Array) -> bool:
    """Whether a density over nodes needs more of them, so that four moments do better.

    By its status, or because more nodes change it and four moments are nearer to what those give.
    """
    predictive, likelihood = problem.predictive, problem.by_densities
    if np.any(predictive.fitted(alpha).status == Status.TOO_COARSE):
        return True
    gap = quadrature_gap(problem, alpha)
    if abs(gap) <= max(COARSE, 1e-3 * problem.outcomes.size):
        return False
    of_moments = replace(likelihood, predictive=predictive.by(STAND_IN)).evaluate(alpha)
    return abs(of_moments.total - likelihood.evaluate(alpha).total - gap) < abs(gap)
