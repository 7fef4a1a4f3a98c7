"""The nodes near an outcome tell the density that all nodes tell."""

from collections.abc import Callable

import numpy as np
import pytest

from aleator.moments.densities import Convolution
from aleator.moments.densities.convolution import _of_lattice
from aleator.moments.densities.interface import NodeSensitivity
from aleator.moments.densities.linearized import Linearized
from aleator.moments.densities.outcomes import Outcomes
from aleator.moments.densities.windows import WIDEST, windowed
from aleator.laws import TruncatedNormal
from aleator.laws.inputs import Inputs
from aleator.moments.quadrature import GermGrid
from aleator.types import Array

ALPHA = np.array([0.5, 0.15])
LAW = Inputs({"a": TruncatedNormal(box=(0.0, 1.0))})
RESPONSES: dict[str, Callable[[Array, Array], Array]] = {
    "rising": lambda a, z: 2.0 * np.exp(a * z),
    "falling": lambda a, z: -z * a**3 - a,
    "turning": lambda a, z: z * np.cos(9.0 * a),
    "flat at an end": lambda a, z: z * np.maximum(a - 0.4, 0.0) ** 2,
    "constant": lambda a, z: z + 0.0 * a,
}


def of(name: str, points: int = 401) -> tuple[Array, Linearized]:
    """Outcomes of 60 experiments, some of them out of reach, and what lies around the nodes."""
    rng = np.random.default_rng(3)
    z = rng.uniform(0.5, 2.0, (60, 1))
    nodes = GermGrid(points).nodes(LAW, ALPHA)
    assert nodes.lattice is not None
    y = RESPONSES[name](nodes.x[:, 0], z)
    outcome = RESPONSES[name](np.clip(rng.normal(0.5, 0.15, 60), 0.0, 1.0), z[:, 0])
    outcome[::7] += rng.normal(0.0, 2.0, outcome[::7].size)
    return outcome, Linearized(y, nodes.weights, nodes.lattice)


@pytest.mark.parametrize("points", [41, 401])
@pytest.mark.parametrize("name", RESPONSES)
def test_a_window_tells_what_all_nodes_tell(name: str, points: int) -> None:
    outcome, around = of(name, points)
    inside, value, d_y = windowed(outcome, around)
    every, slope = _of_lattice(outcome, around)
    np.testing.assert_allclose(value[inside], every[inside], rtol=1e-12, atol=1e-12)
    largest = np.abs(slope[inside]).max(axis=1, keepdims=True, initial=1e-300)
    np.testing.assert_allclose(d_y[inside] / largest, slope[inside] / largest, atol=1e-11)
    assert not value[~inside].any()
    assert not d_y[~inside].any()


def test_windows_are_those_of_the_experiments_within_reach() -> None:
    outcome, around = of("rising")
    inside, *_ = windowed(outcome, around)
    within = (outcome > around.y[:, 20]) & (outcome < around.y[:, -20])
    assert inside[within].all()
    assert not inside[(outcome < around.y[:, 0]) | (outcome > around.y[:, -1])].any()


def test_two_windows_are_none() -> None:
    outcome, around = of("turning")
    crossed = np.diff(np.sign(around.y - outcome[:, None]), axis=1) != 0
    first, last = crossed.argmax(axis=1), crossed.shape[1] - crossed[:, ::-1].argmax(axis=1)
    apart = crossed.any(axis=1) & (last - first > WIDEST)
    inside, *_ = windowed(outcome, around)
    assert apart.any()
    assert not inside[apart].any()


@pytest.mark.parametrize("name", RESPONSES)
def test_the_partials_are_the_differences_of_the_value(name: str) -> None:
    outcome, around = of(name)

    def sensitivity(y: Array) -> NodeSensitivity:
        nodes = Outcomes(y, around.weights, lattice=around.lattice)
        return Convolution().fit_nodes(nodes, -np.inf, np.inf).node_sensitivity(outcome)

    found = sensitivity(around.y)
    direction = np.cos(np.linspace(0.0, 3.0, around.y.shape[1]))
    step = 1e-6
    ends = [sensitivity(around.y + sign * step * direction).value for sign in (1.0, -1.0)]
    expected = (ends[0] - ends[1]) / (2.0 * step)
    there = np.isfinite(found.value) & (found.status == 0)
    np.testing.assert_allclose(
        (found.d_y @ direction)[there], expected[there], rtol=1e-4, atol=1e-4
    )
