"""How many outcomes lie outside 95 %: the range of the count is that of independent values."""

import io
import re
from types import SimpleNamespace

import numpy as np
from rich.console import Console
from scipy import special, stats

from aleator.report.html.predicted import _caption
from aleator.report.html.rows import Measured
from aleator.report.individual import worst


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


def test_the_text_report_counts_values_given_the_earlier_ones_of_their_experiment() -> None:
    pit = [0.01, 0.5, 0.99, 0.6, 0.3, 0.7] * 20
    rows = [
        {
            "id": "1", "row": k + 1, "response": "y", "lower": 1.0, "upper": 1.0, "predicted": 1.0,
            "scale": 0.1, "residual": 0.0, "conditions": {}, "pit": p,
        }
        for k, p in enumerate(pit)
    ]  # fmt: skip
    console = Console(record=True, width=120, file=io.StringIO())
    console.print(worst({"observations": rows, "responses": {"y": "none"}}))
    found = re.findall(r"(\d+) of (\d+) are, and (\d+) to (\d+)", console.export_text())
    low, high = stats.binom.ppf([0.025, 0.975], 120, 0.05).astype(int)
    assert [tuple(map(int, row)) for row in found] == [(40, 120, low, high)]
