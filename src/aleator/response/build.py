"""Build surfaces from runs: rounds of nested points until the estimated error is small enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from aleator.cubature import Cubature
from aleator.errors import InputsError, SimulatorError
from aleator.response.assembly import Piece, degrees_of, merged, outcome_range
from aleator.response.basis import products
from aleator.response.fit import Judged, Prior, first_priors, fitted, judged, search
from aleator.response.points import (
    CANDIDATES,
    Floats,
    Ints,
    low_discrepancy,
    shares,
    spread,
)
from aleator.response.surface import Surface

Run = Callable[[Ints, Floats], Floats]
Progress = Callable[[int, int, int], None]

GROWTH = 1.3
# Outcomes that differ by less than this part of their size do not depend on the parameters.
ROUNDING = 1e-12
# The error is at the simulator's own noise where it has fallen by less than a fifth while the runs
# grew by GROWTH^6 to GROWTH^8, 5 to 8 times. Sooner would give up fronts that are still unresolved.
STALL = 0.8
# An error that falls by more than half in one round, or seems to, is believed by half only.
DOUBT = 0.5


@dataclass(frozen=True)
class ResponseSurface:
    """The choice of response surfaces: how exact, and at what price.

    tolerance: estimated root-mean-square error over the scatter of the outcome, in (0, 1).
    max_runs: the most runs for one experiment, at most 4096.
    validation: runs of each experiment that are never fitted, at least 4.
    accuracy: relative accuracy of the simulator, in [0, 1); an error below accuracy times the size
    of the outcome counts as converged.
    seed: of the validation points.
    nodes: Gauss nodes a parameter, or a cubature, when the surfaces are propagated; None leaves it
    open.

    Raises InputsError for a value outside these ranges.

    >>> ResponseSurface(tolerance=0.01).max_runs
    1000
    """

    tolerance: float = 0.005
    max_runs: int = 1000
    validation: int = 12
    accuracy: float = 1e-6
    seed: int = 0
    nodes: int | Cubature | None = None

    def __post_init__(self) -> None:
        checks = (
            ("tolerance", 0.0 < self.tolerance < 1.0, "choose one in (0, 1), e.g. 0.02"),
            ("validation", self.validation >= 4, "choose at least 4 runs"),
            (
                "max_runs",
                self.validation < self.max_runs <= CANDIDATES,
                f"allow more runs than for validation, and at most {CANDIDATES}",
            ),
            ("accuracy", 0.0 <= self.accuracy < 1.0, "choose one in [0, 1), e.g. 1e-6"),
            ("seed", self.seed >= 0, "choose a seed >= 0"),
            ("nodes", not isinstance(self.nodes, int) or self.nodes >= 1, "choose at least 1"),
        )
        for name, good, remedy in checks:
            if not good:
                raise InputsError(f"response surface: {name} {getattr(self, name)}", remedy)


def build_surface(
    run: Run,
    box: Floats,
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

    Raises InputsError for an inadmissible box or too few runs, SimulatorError for outcomes of the
    wrong shape or not finite. An experiment that does not converge within `max_runs`, or stalls at
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
    state = _Refinement(run, box, experiments, choice)
    count = first
    while True:
        state.refine(count)
        if progress:
            progress(int(state.runs.sum()), int(state.converged.sum()), experiments)
        if not state.active.size or count >= state.most:
            return state.surface()
        count = min(int(np.ceil(GROWTH * count)), state.most)


class _Refinement:
    """What is known after each round. An experiment that is done keeps its prior and its size."""

    def __init__(self, run: Run, box: Floats, experiments: int, choice: ResponseSurface) -> None:
        n = len(box)
        self.run, self.box, self.choice = run, box, choice
        self.most = choice.max_runs - choice.validation
        shift = np.random.default_rng(choice.seed).random(n)
        self.check = low_discrepancy(choice.validation, n, shift)
        self.z = np.empty((0, n))
        self.values = np.empty((experiments, 0))
        self.truth = np.empty((experiments, 0))
        self.active = np.arange(experiments)
        self.pool = first_priors(n)
        self.prior: list[Prior] = [self.pool[0]] * experiments
        self.error = np.full(experiments, np.inf)
        self.last = np.zeros(experiments)
        self.history: list[Floats] = []
        self.runs = np.zeros(experiments, dtype=np.intp)
        self.size = np.zeros(experiments, dtype=np.intp)
        self.converged = np.zeros(experiments, dtype=np.bool_)

    def refine(self, count: int) -> None:
        """Run the active experiments at points up to `count` and judge them anew."""
        active = self.active
        self._ask(count)
        y = self.values[active].T
        priors, best, self.pool = search(self.pool, self.z, y)
        share = shares(self.z)
        scatter, level, estimate = (np.empty(len(active)) for _ in range(3))
        for k in np.unique(best):
            rows = np.flatnonzero(best == k)
            fit = judged(priors[k], self.z, y[:, rows])
            scatter[rows] = np.sqrt((fit.coefficients[1:] ** 2).sum(axis=0))
            level[rows] = np.abs(y[:, rows]).max(axis=0)
            misfit = fit.coefficients.T @ products(fit.indices, self.check)
            misfit -= self.truth[active[rows]]
            estimate[rows] = _estimate(fit, share, misfit)
            for row in active[rows]:
                self.prior[row] = priors[k]
        error = np.maximum(estimate, DOUBT * self.last[active])
        self.last[active], self.error[active], self.size[active] = estimate, error, count
        constant = np.ptp(np.vstack([y, self.truth[active].T]), axis=0) <= ROUNDING * level
        self.error[active[constant]] = 0.0
        good = error <= np.maximum(self.choice.tolerance * scatter, self.choice.accuracy * level)
        self.converged[active] = good | constant
        self.history.append(self.error.copy())
        self.active = active[~(self.converged[active] | self._stalled(active))]

    def _ask(self, count: int) -> None:
        """Run the simulator once, for all active experiments at all new points."""
        done, active = len(self.z), self.active
        fresh = spread(count, len(self.box))[done:]
        self.z = np.vstack([self.z, fresh])
        if not done:
            fresh = np.vstack([fresh, self.check])
        low, high = self.box.T
        x = np.clip(0.5 * (low + high) + 0.5 * (high - low) * fresh, low, high)
        index = np.repeat(active, len(x))
        outcome = np.asarray(self.run(index, np.tile(x, (len(active), 1))), dtype=np.float64)
        if outcome.shape != index.shape or not np.isfinite(outcome).all():
            raise SimulatorError(
                f"outcomes of shape {outcome.shape} for {len(index)} runs, or not finite",
                "return one finite number for each run",
            )
        outcome = outcome.reshape(len(active), len(x))
        values = np.full((len(self.values), count), np.nan)
        values[:, :done] = self.values
        values[active, done:] = outcome[:, : count - done]
        self.values = values
        if not done:
            self.truth = outcome[:, count:]
        self.runs[active] += len(x)

    def _stalled(self, active: Ints) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        if len(self.history) < 9:
            return np.zeros(len(active), dtype=np.bool_)
        before = np.max([errors[active] for errors in self.history[-9:-6]], axis=0)
        return np.asarray(self.history[-1][active] > STALL * before)

    def surface(self) -> Surface:
        """Fit every experiment through the runs it had when it was done."""
        shared: dict[tuple[int, Prior], list[int]] = {}
        for row, prior in enumerate(self.prior):
            shared.setdefault((int(self.size[row]), prior), []).append(row)
        pieces: list[Piece] = []
        for (count, prior), rows in shared.items():
            members = np.array(rows, dtype=np.intp)
            pieces.append((members, *fitted(prior, self.z[:count], self.values[members, :count].T)))
        indices, groups, terms = merged(pieces, self.error)
        scatter = np.sqrt((terms[:, indices.any(axis=1)] ** 2).sum(axis=1))
        surface = Surface(
            box=self.box,
            indices=indices,
            groups=groups,
            error=self.error,
            scatter=scatter,
            converged=self.converged,
            runs=self.runs,
            degrees=degrees_of(indices, terms, self.error),
        )
        lower, upper = outcome_range(surface, np.hstack([self.values, self.truth]))
        return replace(surface, lower=lower, upper=upper)


def _estimate(fit: Judged, share: Floats, misfit: Floats) -> Floats:
    """Return the estimated root-mean-square error (A,) over the box.

    A run left out of well-spread ones leaves a hole twice as wide as any other, so its residual is
    larger than the error elsewhere: hence 0.7. The least of some forty leave-one-out errors is
    too small by chance when the runs are few: hence 1 + 8/M. Both were set on the wet clutch at
    tolerance 0.02, where 95 % of true errors then stay below the estimate (86 to 89 % at 0.01 and
    0.005). On outcomes that were not used to set them: 95 to 98 % on other boxes of the clutch,
    random fronts and random peaks, but 72 % on random kinks, with true errors up to 1.9 times the
    estimate. So it is an estimate, not a bound.
    """
    left_out = np.sqrt(share @ fit.residual**2) * 0.7 * (1.0 + 8.0 / len(share))
    checked = np.sqrt((misfit**2).mean(axis=1))
    return np.asarray(np.maximum(np.maximum(left_out, fit.expected), checked))


def _checked_box(box: Floats) -> Floats:
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
