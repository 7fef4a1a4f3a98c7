"""A rule of nodes from outside the package, in Python and named in a study.toml."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from aleator import Free, Inputs, Normal
from aleator.study import load_study


def test_a_rule_of_nodes(install: Callable[..., None], study: Callable[..., Path]) -> None:
    """Of a normal law the weighted nodes have its mean and sd, and so do their slopes."""
    install("aleator.cubatures", "halton", "halton:Halton")
    halton = importlib.import_module("halton").Halton
    inputs = Inputs({"x": Normal(Free(-2.0, 4.0), Free(0.05, 3.0))})
    rule = halton(4096).nodes(inputs, np.array([1.0, 0.5]))
    x, dx = rule.x[:, 0], rule.dx[:, 0]
    assert rule.weights @ x == pytest.approx(1.0, abs=1e-3)
    assert rule.weights @ (x - 1.0) ** 2 == pytest.approx(0.25, abs=1e-3)
    assert rule.weights @ dx == pytest.approx([1.0, 0.0], abs=2e-3)
    y = stats.norm(1.0, 0.6).rvs(10, random_state=4)
    text = (
        '[simulator]\nfunction = "model.py:y"\n[parameters.x]\nlaw = "normal"\n'
        "mean = {lower = -2.0, upper = 4.0}\nsd = {lower = 0.05, upper = 3.0}\n"
        '[propagation]\nmethod = "collocation"\nnodes = {rule = "halton", points = 64}\n'
    )
    path = study(y.tolist(), text, "def y(x): return x\n")
    assert load_study(path).propagation.nodes == halton(64)
