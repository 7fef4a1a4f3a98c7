"""How many outcomes lie outside 95 %: the range of the count is that of independent values."""

import re
from types import SimpleNamespace

import numpy as np
from scipy import special

from aleator.report.html.predicted import _caption
from aleator.report.html.rows import Measured


def test_the_range_of_the_count_holds_though_observations_of_one_experiment_depend() -> None:
    rng, inside = np.random.default_rng(4), 0
    for _ in range(200):
        a, e = rng.standard_normal((30, 1)), 0.2 * rng.standard_normal((30, 10))
        y, mean, variance = a + e, np.zeros(30), np.ones(30)
        w = np.empty_like(y)
        for k in range(10):
            total = variance + 0.04
            w[:, k] = (y[:, k] - mean) / np.sqrt(total)
            gain = variance / total
            mean, variance = mean + gain * (y[:, k] - mean), variance * (1.0 - gain)
        end = 1.96 * np.sqrt(1.04)
        columns = {
            "id": range(300), "value": y.ravel(), "pit": special.ndtr(w.ravel()),
            "kind": ["measured"] * 300,
            "q0.025": np.full(300, -end), "q0.975": np.full(300, end),
        }  # fmt: skip
        seen = Measured.__new__(Measured)
        object.__setattr__(seen, "columns", {k: list(v) for k, v in columns.items()})
        source = SimpleNamespace(data={"id": [0] * 300})
        text = _caption(seen, source).split("experiment,")[1]
        beyond, _, low, high = map(int, re.findall(r"\d+", text)[:4])
        inside += low <= beyond <= high
    assert inside >= 180
