"""A search from outside the package: the simplex of Nelder and Mead, by SciPy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import optimize

from aleator.core.types import Array
from aleator.search import CustomSearch


def nelder_mead(tolerance: float = 1e-6, restarts: int = 1) -> CustomSearch:
    """No derivatives: it shrinks until the log-likelihoods at its corners are `tolerance` apart."""

    def search(
        value: Callable[[Array], float],
        lower: Array,
        upper: Array,
        start: Array,
        rng: np.random.Generator,  # noqa: ARG001  nothing here is random
    ) -> Array:
        for _ in range(1 + restarts):
            start = optimize.minimize(
                lambda alpha: -value(alpha),
                start,
                method="Nelder-Mead",
                bounds=optimize.Bounds(lower, upper),
                options={"fatol": tolerance, "xatol": np.inf},
            ).x
        return start

    return CustomSearch(search, polish=False, name="nelder_mead")
