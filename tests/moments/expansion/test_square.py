"""The square of an expansion by pairs of its functions."""

import numpy as np
import pytest

from aleator.moments.expansion import Basis
from aleator.moments.expansion.indices import TotalDegree
from aleator.moments.expansion.moments.linearization import linearization
from aleator.moments.expansion.moments.products import Square

STRIDES = np.array([9, 1])
"""Of two parameters whose degrees stay below nine."""


@pytest.fixture
def basis() -> Basis:
    return Basis.normal(2)


@pytest.fixture
def indices() -> np.ndarray:
    # not in the order of their keys
    return TotalDegree(3).indices((None, None))[::-1]


def square(basis: Basis, indices: np.ndarray) -> Square:
    tables = tuple(linearization(basis, k, 3, 3, 6) for k in range(2))
    return Square.of(indices, STRIDES, tables, order=4)


def test_the_square_has_the_values_of_the_square(basis: Basis, indices: np.ndarray) -> None:
    found, rng = square(basis, indices), np.random.default_rng(0)
    z, theta = rng.standard_normal((len(indices), 2)), rng.standard_normal((50, 2))
    names = np.stack(np.divmod(found.keys, 9), axis=1)
    values = basis.evaluate(theta, indices) @ z
    assert basis.evaluate(theta, names) @ found.multiplied(z) == pytest.approx(values**2)


def test_projections_are_a_fourth_of_the_slope_of_the_fourth_moment(
    basis: Basis, indices: np.ndarray
) -> None:
    """d E[Z^4]/d z_i = 4 E[Z^3 psi_i], and E[Z^4] is the sum of squares of Z^2."""
    found, z = square(basis, indices), np.random.default_rng(1).standard_normal((len(indices), 1))

    def fourth(z: np.ndarray) -> float:
        return float(np.sum(found.multiplied(z) ** 2))

    step = 1e-4 * np.eye(len(indices))[:, :, None]
    slopes = [(fourth(z + up) - fourth(z - up)) / 2e-4 for up in step]
    assert found.projected(z, found.multiplied(z))[:, 0] == pytest.approx(
        np.array(slopes) / 4.0, rel=1e-6
    )
