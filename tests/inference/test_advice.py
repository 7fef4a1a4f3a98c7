"""Remedies name what helps, and following them does help."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest
from identifications import unjudged

from aleator import (
    Check,
    Constant,
    Free,
    GradientMultistart,
    Identification,
    Inputs,
    MaximumEntropy,
    Noise,
    Normal,
    ResponseSurface,
)
from aleator.core.types import Array
from aleator.laws import Law
from aleator.moments.densities import Density

TEMPERATURE = np.linspace(300.0, 350.0, 40)
LENGTH = 2.0 + 0.05 * TEMPERATURE + 0.3 * np.random.default_rng(0).standard_normal(40)


def remedies(found: Identification, about: str) -> list[str]:
    return [w.remedy for w in found.warnings if w.about == about]


def to_center(found: Identification) -> list[str]:
    """Remedies of two parameters and the condition that makes them alike."""
    return [w.remedy for w in found.warnings if w.concerns == ("a", "b", "T")]


# ------------------------------------------------------------------------------ centering


def expanded(model: Callable[..., Array], a: Law, noise: Noise | None = None) -> Identification:
    table = pd.DataFrame({"T": TEMPERATURE, "day": 20.0, "length": LENGTH})
    return unjudged(
        model, table, Inputs({"a": a, "b": Constant(Free(0.0, 0.1))}), outcome="length",
        vectorized=True, noise=noise, search=GradientMultistart(2), verification=Check(0),
    )  # fmt: skip


def test_with_noise_the_same_is_told() -> None:
    law, noise = Normal(Free(-20.0, 20.0), 0.2), Noise(0.2)
    (advice,) = to_center(expanded(lambda T, a, b: a + b * T, law, noise))
    assert "(T - 325)" in advice
    law = Normal(Free(10.0, 30.0), 0.2)
    assert to_center(expanded(lambda T, a, b: a + b * (T - 325.0), law, noise)) == []


def test_a_condition_far_from_zero_is_to_be_measured_from_its_middle() -> None:
    far = expanded(lambda T, a, b: a + b * T, Normal(Free(-20.0, 20.0), Free(0.01, 2.0)))
    (advice,) = to_center(far)
    assert "(T - 325)" in advice
    near = expanded(lambda T, a, b: a + b * (T - 325.0), Normal(Free(10.0, 30.0), Free(0.01, 2.0)))
    assert remedies(near, "identifiability") == []
    # the same line: at 325 the one is what the other says it is, and known better
    a, b = far.alpha["a.mean"], far.alpha["b.value"]
    assert near.alpha["a.mean"].estimate == pytest.approx(a.estimate + 325 * b.estimate, abs=1e-2)
    assert near.alpha["b.value"].estimate == pytest.approx(b.estimate, abs=1e-3)
    assert (near.alpha["a.mean"].standard_error or 1.0) < 0.1 * (a.standard_error or 0.0)


@pytest.mark.long
def test_parameters_alike_for_another_reason_get_no_such_advice() -> None:
    """The effects of a + b (1 + 0.02 k) are alike, and T has nothing to do with it."""
    k = np.tile([-1.0, 0.0, 1.0, 0.0], 5)

    def model(k: Array, a: Array, b: Array) -> Array:
        return a + 100.0 * b * (1.0 + 0.02 * k)

    table = pd.DataFrame({"T": TEMPERATURE[::2], "k": k, "y": LENGTH[::2]})
    found = unjudged(
        model, table,
        Inputs({"a": Normal(Free(-20.0, 40.0), Free(0.01, 4.0)), "b": Constant(Free(0.0, 0.3))}),
        outcome="y", vectorized=True, search=GradientMultistart(2), verification=Check(0),
    )  # fmt: skip
    assert remedies(found, "identifiability")
    assert to_center(found) == []


# ------------------------------------------------------------------------------ nodes


def found_with(density: Density, nodes: int, count: int = 12) -> Identification:
    rng = np.random.default_rng(0)
    z = np.linspace(1.0, 2.0, count)
    x = 1.0 + 0.3 * rng.standard_normal(count)
    y = np.exp(2.0 * z * x)
    return unjudged(
        lambda z, x: np.exp(2.0 * z * x), pd.DataFrame({"z": z, "y": y}),
        Inputs({"x": Normal(1.0, Free(0.05, 0.5))}), outcome="y", vectorized=True,
        density=density, propagation=ResponseSurface(nodes=nodes),
        search=GradientMultistart(2), verification=Check(0),
    )  # fmt: skip


def test_too_few_nodes_are_told_and_more_of_them_end_it() -> None:
    few = found_with(MaximumEntropy(4), 4, 60)
    (advice,) = remedies(few, "quadrature")
    assert "propagation.nodes" in advice
    assert remedies(found_with(MaximumEntropy(4), 14, 60), "quadrature") == []
