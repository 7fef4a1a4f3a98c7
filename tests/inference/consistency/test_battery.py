"""Which tests there are."""

import numpy as np

from aleator.inference.consistency.battery import Battery
from aleator.inference.consistency.residuals import Residuals


def test_what_can_hardly_be_told_apart_has_no_sandwich() -> None:
    """Along a flat direction a replicate's maximum is anywhere, and so are its scores."""
    names, covariance = ("a.mean", "b.mean", "a.sd"), np.eye(3)
    covariance[0, 1] = covariance[1, 0] = 0.999
    battery = Battery.of((), np.arange(20), names, covariance)
    asked = [s.of for s in battery.subjects if s.kind == "sandwich"]
    rng = np.random.default_rng(0)
    none = np.zeros((20, 0))
    residuals = Residuals(
        rng.standard_normal(20), np.ones(20, dtype=bool), rng.standard_normal((20, 3)), none,
        none[:, :, None],
    )  # fmt: skip
    assert asked == ["a.sd"]
    assert len(battery.values(residuals)) == len(battery.subjects)
