"""An even grid of standard normal variates."""

import numpy as np
import pytest
from scipy import stats

from aleator.errors import AleatorError
from aleator.laws import Constant, Normal, TruncatedNormal
from aleator.laws.inputs import Inputs
from aleator.moments.quadrature import GermGrid, TensorGauss

ONE = Inputs({"x": Normal(0.0, 1.0), "b": Constant(2.0)})
TWO = Inputs({"x": Normal(0.0, 1.0), "y": TruncatedNormal((-1.0, 2.0), 0.5, 1.0)})


def start(inputs: Inputs) -> np.ndarray:
    return np.array([h.start for h in inputs.hyperparameters])


def narrow(cubature, width: float) -> float:
    """Relative error of E[phi((x - 0.3)/width)/width] for a normal x."""
    nodes = cubature.nodes(ONE, start(ONE))
    found = nodes.weights @ stats.norm.pdf(nodes.x[:, 0], 0.3, width)
    exact = stats.norm.pdf(0.3, 0.0, np.hypot(1.0, width))
    return abs(found / exact - 1.0)


@pytest.mark.parametrize("width", [0.03, 0.1, 0.3])
def test_a_narrow_normal_is_integrated_as_theory_says(width: float) -> None:
    grid = GermGrid(401)
    bound = 2.0 * np.exp(-2.0 * np.pi**2 * (width * 25.0) ** 2)  # h = 0.04
    assert narrow(grid, width) < 1.1 * bound + 1e-13


def test_a_gauss_rule_of_a_quarter_of_the_nodes_misses_what_the_grid_resolves() -> None:
    assert narrow(TensorGauss(100), 0.05) > 1e-2
    assert narrow(GermGrid(401), 0.05) < 1e-10


def test_moments_of_two_parameters_agree_with_gauss_rules() -> None:
    grid, gauss = GermGrid(61).nodes(TWO, start(TWO)), TensorGauss(20).nodes(TWO, start(TWO))
    for powers in ((2, 0), (4, 2), (1, 3)):
        found = [
            n.weights @ (n.x[:, 0] ** powers[0] * n.x[:, 1] ** powers[1]) for n in (grid, gauss)
        ]
        assert found[0] == pytest.approx(found[1], abs=1e-8)
    assert np.all(grid.weights > 0.0)
    assert grid.weights.sum() == pytest.approx(1.0, abs=1e-14)
    assert grid.weights.size < 61**2


def test_derivatives_are_those_of_the_weighted_sum() -> None:
    alpha, step = start(TWO), 1e-6
    nodes = GermGrid(31).nodes(TWO, alpha)
    slope = 3.0 * np.einsum("j,j,jk->k", nodes.weights, nodes.x[:, 1] ** 2, nodes.dx[:, 1])
    for k in range(alpha.size):
        ends = []
        for sign in (1.0, -1.0):
            moved = alpha.copy()
            moved[k] += sign * step
            at = GermGrid(31).nodes(TWO, moved)
            ends.append(at.weights @ at.x[:, 1] ** 3)
        assert slope[k] == pytest.approx((ends[0] - ends[1]) / (2.0 * step), abs=1e-7)


def test_sizes_beyond_reason_are_refused() -> None:
    with pytest.raises(AleatorError, match="between 5 and 4001"):
        GermGrid(3)
    five = Inputs({name: Normal(0.0, 1.0) for name in "abcde"})
    with pytest.raises(AleatorError, match="more than"):
        GermGrid(61).nodes(five, start(five))
