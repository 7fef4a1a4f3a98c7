"""Individual laws that are a narrow bent ridge: an outcome of two parameters with little noise."""

import numpy as np
import pandas as pd
import pytest
from individual_cases import likelihood_of
from scipy import integrate, stats

from aleator import Free, Inputs, Normal, TruncatedNormal
from aleator.likelihood.individual import GaussHermite
from aleator.likelihood.individual.modes import modes

LAW = Inputs(
    {name: TruncatedNormal(box, Free(*box), Free(0.01, 1.0)) for name, box in
     {"a": (0.3, 2.0), "b": (0.2, 1.8)}.items()}
)  # fmt: skip
ALPHA = np.array([0.92, 0.09, 1.13, 0.3, 0.01])


def growth(time, x):
    return x[0] * np.exp(x[1] * time)


FRAME = pd.DataFrame({"id": range(4), "time": [0.5, 0.78, 1.2, 1.96], "y": [2.13, 3.52, 5.96, 6.5]})


def exact(time: float, y: float) -> float:
    """The density of an outcome by quadrature over b, the noise as a law of a alone."""
    a, b = (
        stats.truncnorm((low - m) / s, (high - m) / s, m, s)
        for m, s, low, high in ((0.92, 0.09, 0.3, 2.0), (1.13, 0.3, 0.2, 1.8))
    )
    error = np.linspace(-6.0, 6.0, 401)
    weight = stats.norm.pdf(error) * (error[1] - error[0])

    def of_b(b_value: float) -> float:
        slope = np.exp(b_value * time)
        return float(b.pdf(b_value) * (a.pdf((y - 0.01 * error) / slope) @ weight) / slope)

    return np.log(integrate.quad(of_b, 0.2, 1.8, limit=400, epsabs=0.0, epsrel=1e-10)[0])


@pytest.mark.parametrize("rule", [GaussHermite(29, 6), GaussHermite(105, 9), GaussHermite(200, 9)])
def test_more_nodes_do_not_count_a_part_twice(rule: GaussHermite) -> None:
    """Nodes far out, whose lines do not meet the ridge, once wandered back to where others are."""
    each = likelihood_of(growth, FRAME, LAW).by(rule, ALPHA).evaluate(ALPHA).each
    wanted = [exact(*row) for row in FRAME[["time", "y"]].to_numpy()]
    assert each == pytest.approx(wanted, abs=1e-3)


def test_a_mode_is_found_along_a_bent_ridge() -> None:
    """log f = -(r - 3)^2/(2 w^2) - |z - p|^2/8: a ring, its top where it is nearest to p."""
    width, p = 0.01, np.array([5.0, 0.0])

    def ring(z):
        r = np.linalg.norm(z, axis=2)
        slope = z / r[..., None]
        value = -((r - 3.0) ** 2) / (2.0 * width**2) - np.sum((z - p) ** 2, axis=2) / 8.0
        gradient = -((r - 3.0) / width**2)[..., None] * slope - (z - p) / 4.0
        information = slope[..., :, None] * slope[..., None, :] / width**2 + np.eye(2) / 4.0
        return value, gradient, information

    angle = np.linspace(0.1, 0.4, 6)
    start = 3.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[None]
    found = modes(ring, start)
    assert found.value == pytest.approx(np.full((1, 6), -0.5), abs=0.03)


SURFACE = Inputs(
    {
        "a": Normal(Free(0.0, 4.0), Free(0.01, 2.0)),
        "b": TruncatedNormal((0.1, 3.0), Free(0.1, 3.0), Free(0.01, 1.0)),
        "c": Normal(Free(-1.0, 2.0), Free(0.01, 1.0)),
    },
    {("a", "b"): Free(-0.9, 0.9)},
)
WIDE = np.array([2.2, 0.7, 1.2, 0.7, 0.5, 0.06, 0.88, 0.05])


def fading(time, x):
    return x[0] * np.exp(-x[1] * time) + x[2] * time


@pytest.mark.parametrize("count", [3, 6])
def test_one_observation_of_three_parameters_has_a_smooth_likelihood(count: int) -> None:
    """It tells of one direction alone: across it nodes lay as rounding errors had them."""
    time = np.linspace(0.4, 2.8, 7)
    frame = pd.DataFrame({"id": range(7), "time": time, "y": fading(time, WIDE[::2]) + 0.3})
    adapted = likelihood_of(fading, frame, SURFACE).by(GaussHermite(count), WIDE)
    beside = WIDE * (1.0 + 1e-7 * np.arange(5)[:, None])
    values = [adapted.adapted(alpha).evaluate(alpha).each for alpha in beside]
    np.testing.assert_allclose(values, values[:1] * np.ones((5, 1)), atol=1e-4)
