"""Build surfaces from runs: rounds of nested points until the estimated error is small enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aleator.errors import InputsError
from aleator.quadrature import Cubature
from aleator.surrogates.points import CANDIDATES, low_discrepancy
from aleator.surrogates.refinement import Refinement, Run
from aleator.surrogates.surface import Surface
from aleator.types import Array

Progress = Callable[[int, int, int], None]

GROWTH = 1.3
# The tolerance where none is chosen.
EXACT = 0.005


@dataclass(frozen=True)
class ResponseSurface:
    """The choice of response surfaces: how exact, and at what price.

    tolerance: estimated root-mean-square error over the scatter of the outcome on the region, in
    (0, 1). None, for an identification: no more exact than the answer needs, and where the law has
    its mass; where there is no answer to look at, 0.005.
    max_runs: the most runs for one experiment, at most 4096.
    validation: runs of each experiment that are never fitted, at least 4.
    accuracy: relative accuracy of the simulator, in [0, 1); an error below accuracy times the size
    of the outcome counts as converged.
    seed: of the validation points.
    nodes: Gauss nodes a parameter, or a cubature, when the surfaces are propagated; None leaves it
    open.
    shared: whether all experiments share one surface, over conditions and parameters; with None
    the estimated error decides. Only without a tolerance.

    Raises InputsError for a value outside these ranges.

    >>> ResponseSurface(tolerance=0.01).max_runs
    1000
    """

    tolerance: float | None = None
    max_runs: int = 1000
    validation: int = 12
    accuracy: float = 1e-6
    seed: int = 0
    nodes: int | Cubature | None = None
    shared: bool | None = False

    @property
    def name(self) -> str:
        """How the result names this choice."""
        return "response_surface"

    def __post_init__(self) -> None:
        checks = (
            (
                "tolerance",
                0.0 < (self.tolerance or EXACT) < 1.0 and self.tolerance != 0.0,
                "choose one in (0, 1), e.g. 0.02",
            ),
            ("validation", self.validation >= 4, "choose at least 4 runs"),
            (
                "max_runs",
                self.validation < self.max_runs <= CANDIDATES,
                f"allow more runs than for validation, and at most {CANDIDATES}",
            ),
            ("accuracy", 0.0 <= self.accuracy < 1.0, "choose one in [0, 1), e.g. 1e-6"),
            ("seed", self.seed >= 0, "choose a seed >= 0"),
            (
                "shared",
                self.shared is False or self.tolerance is None,
                "leave out the tolerance: a shared surface is made exact where the law is",
            ),
            ("nodes", not isinstance(self.nodes, int) or self.nodes >= 1, "choose at least 1"),
        )
        for name, good, remedy in checks:
            if not good:
                raise InputsError(f"response surface: {name} {getattr(self, name)}", remedy)


def build_surface(
    run: Run,
    box: Array,
    experiments: int,
    choice: ResponseSurface | None = None,
    progress: Progress | None = None,
) -> Surface:
    """Return surfaces of all experiments over the box, each refined until it is exact enough.

    `run(index (R,), x (R, n)) -> (R,)` is called once a round, with all experiments that still
    need runs: about 10 calls to 500 runs an experiment. `box` (n, 2) has rows [lower, upper], n
    from 1 to 10. `progress(done runs, converged experiments, experiments)` is told after each.

    All experiments share one nested sequence of points; a round adds a third. Each surface is
    fitted with the prior of least leave-one-out error (module `fit`), and its error is taken as
    the largest of: the root-mean-square residual of the validation runs; what the prior expects;
    and the leave-one-out residuals, weighted by each run's part of the box, times 0.7 (1 + 8/M);
    and half of the same a round before.

    A run that failed has the outcome NaN; a surface is fitted through the runs that worked. What
    failures cost is in the error: the prior expects most where no run is, and the runs around a
    hole stand for it with their share of the box; in a large hole the surface is an extrapolation,
    wrong by up to thrice the estimate. A failed validation run tells nothing and is left out. With
    fewer than 2 n + 2 runs that worked out of the first 5 n + 10 an experiment has no surface: it
    is given up, a constant with an infinite error.

    Raises InputsError for an inadmissible box or too few runs, SimulatorError for outcomes of the
    wrong shape or infinite. An experiment that does not converge within `max_runs`, or stalls at
    the simulator's noise, is returned with `converged` False and its estimated error. A feature
    smaller than the distance between points can be missed by every estimate.

    Cost besides the runs: 108 experiments of two parameters with up to 500 runs, a few seconds.

    >>> surface = build_surface(lambda i, x: i + x[:, 0] * x[:, 1], np.array([[0, 1], [0, 1]]), 2)
    >>> surface.evaluate(np.array([[0.5, 0.5]]))
    array([[0.25], [1.25]])
    """
    choice = choice or ResponseSurface()
    box = _checked_box(box)
    if experiments < 1:
        raise InputsError(f"surfaces of {experiments} experiments", "pass at least one experiment")
    # Twice the terms of total degree two up to four parameters: quadratics are exact at once.
    first = 5 * len(box) + 10
    if choice.max_runs < first + choice.validation:
        raise InputsError(
            f"response surface: max_runs {choice.max_runs} for {len(box)} parameters",
            f"allow at least {first + choice.validation} runs an experiment",
        )
    state = Refinement(
        run, box, experiments,
        most=choice.max_runs - choice.validation,
        check=_validation_points(choice, len(box)),
        tolerance=choice.tolerance or EXACT,
        accuracy=choice.accuracy,
    )  # fmt: skip
    count = first
    while True:
        state.refine(count)
        if progress:
            progress(int(state.runs.sum()), int(state.converged.sum()), experiments)
        if not state.active.size or count >= state.most:
            return state.surface()
        count = min(int(np.ceil(GROWTH * count)), state.most)


def _validation_points(choice: ResponseSurface, n: int) -> Array:
    shift = np.random.default_rng(choice.seed).random(n)
    return low_discrepancy(choice.validation, n, shift)


def _checked_box(box: Array) -> Array:
    box = np.asarray(box, dtype=np.float64)
    if box.ndim != 2 or box.shape[1] != 2 or not len(box):
        raise InputsError(f"box of shape {box.shape}", "pass one row [lower, upper] a parameter")
    for i, (low, high) in enumerate(box):
        if not (np.isfinite(low) and np.isfinite(high) and low < high):
            raise InputsError(
                f"box: parameter {i}: lower {low} >= upper {high}, or not finite",
                "pass two finite numbers, the smaller one first",
            )
    return box
