"""A column that a law follows is not held against the law: the maximum pins what it asks."""

import numpy as np
import pandas as pd
import pytest

from aleator import By, Free, GradientMultistart, Inputs, Noise, Normal, identify

SUBJECTS, TIMES = 27, np.array([-3.0, -1.0, 1.0, 3.0])


def line(time, level, slope):
    return level + slope * time


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_what_a_law_follows_does_not_contradict_it(seed: int) -> None:
    """Sums over a part of the column are zero at the maximum, and nearly so in replicates."""
    rng = np.random.default_rng(seed)
    kind = (np.arange(SUBJECTS) < 16).astype(int)
    level = 22.6 + 2.3 * kind + 1.7 * rng.standard_normal(SUBJECTS)
    slope = 0.48 + 0.3 * kind + 0.15 * rng.standard_normal(SUBJECTS)
    y = level[:, None] + slope[:, None] * TIMES + 1.3 * rng.standard_normal((SUBJECTS, 4))
    rows = pd.DataFrame(
        {
            "id": np.repeat(np.arange(SUBJECTS), 4),
            "time": np.tile(TIMES, SUBJECTS),
            "kind": np.repeat(np.where(kind == 1, "new", "old"), 4),
            "y": y.ravel(),
        }
    )
    laws = {
        "level": Normal(By("1 + kind", 10.0, 40.0), Free(0.0, 6.0)),
        "slope": Normal(By("1 + kind", -2.0, 4.0), Free(0.0, 2.0)),
    }
    found = identify(
        line, rows, Inputs(laws), outcome="y", vectorized=True, noise=Noise(Free(0.05, 6.0)),
        search=GradientMultistart(2), best_law=False,
    )  # fmt: skip
    assert found.consistency is not None
    pinned = [t for t in found.consistency.tests if t.column == "kind" and ".mean" in t.of]
    assert len(pinned) == 4
    assert min(test.p for test in pinned) > 0.5
    assert found.consistent
