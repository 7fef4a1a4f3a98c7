"""Build surfaces from runs: rounds of nested points until the estimated error is small enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from aleator.errors import InputsError, SimulatorError
from aleator.response.lattice import (
    Floats,
    Ints,
    first_indices,
    grown,
    low_discrepancy,
    points_of,
    products,
)
from aleator.response.surface import Group, Surface

Run = Callable[[Ints, Floats], Floats]
Progress = Callable[[int, int, int], None]

GROWTH = 0.4
ROUNDING = 1e-12
STALL = 4


@dataclass(frozen=True)
class ResponseSurface:
    """The choice of response surfaces: how exact, and at what price.

    tolerance: estimated root-mean-square error over the scatter of the outcome, in (0, 1).
    max_runs: the most runs for one experiment. validation: runs of each experiment that are never
    fitted. accuracy: relative accuracy of the simulator; an error below accuracy times the largest
    |outcome| counts as converged. seed: of the validation points.
    """

    tolerance: float = 0.02
    max_runs: int = 1000
    validation: int = 12
    accuracy: float = 1e-6
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance < 1.0:
            raise InputsError(
                f"response surface: tolerance {self.tolerance}", "choose one in (0, 1), e.g. 0.02"
            )
        if self.validation < 4:
            raise InputsError(
                f"response surface: {self.validation} validation runs", "choose at least 4"
            )
        if self.max_runs <= self.validation:
            raise InputsError(
                f"response surface: max_runs {self.max_runs} <= validation {self.validation}",
                "allow more runs an experiment, e.g. 1000",
            )
        if not 0.0 <= self.accuracy < 1.0:
            raise InputsError(
                f"response surface: accuracy {self.accuracy}", "choose one in [0, 1), e.g. 1e-6"
            )
        if self.seed < 0:
            raise InputsError(f"response surface: seed {self.seed}", "choose a seed >= 0")


def build_surface(
    run: Run,
    box: Floats,
    experiments: int,
    choice: ResponseSurface | None = None,
    progress: Progress | None = None,
) -> Surface:
    """Return surfaces of all experiments over the box, refined until each is exact enough."""
    choice = choice or ResponseSurface()
    box = _checked_box(box)
    if experiments < 1:
        raise InputsError(f"surface of {experiments} experiments", "pass at least one experiment")
    most = choice.max_runs - choice.validation
    if most < 2 * len(box) + 1:
        raise InputsError(
            f"response surface: max_runs {choice.max_runs} for {len(box)} parameters",
            f"allow at least {choice.validation + 2 * len(box) + 1} runs an experiment",
        )
    bench = _Bench(run, box, experiments)
    check = low_discrepancy(choice.validation, len(box), choice.seed)
    indices = first_indices(len(box), most)
    fresh = indices
    active = np.arange(experiments)
    size = np.zeros(experiments, dtype=np.intp)
    error = np.full(experiments, np.inf)
    scatter = np.zeros(experiments)
    runs = np.zeros(experiments, dtype=np.intp)
    converged = np.zeros(experiments, dtype=bool)
    idle = np.zeros(experiments, dtype=np.intp)
    values = np.empty((experiments, 0))
    truth = np.empty((experiments, 0))
    old = np.empty((0, experiments))
    while True:
        first = not truth.size
        z = np.vstack([points_of(fresh), check]) if first else points_of(fresh)
        outcome = bench(active, z)
        if first:
            truth = outcome[:, len(fresh) :]
        grow = np.full((experiments, len(fresh)), np.nan)
        grow[active] = outcome[:, : len(fresh)]
        values = np.hstack([values, grow])
        runs[active] += len(z)
        terms = np.linalg.solve(products(indices, points_of(indices)).T, values[active].T)
        spread = np.sqrt((terms[1:] ** 2).sum(axis=0))
        level = np.abs(terms[0]) + spread
        misfit = _rms(terms.T @ products(indices, check) - truth[active])
        jump = terms.copy()
        jump[: len(old)] -= old
        jump = np.sqrt((jump**2).sum(axis=0))
        if first:
            estimate = 5.0 * misfit
        else:
            estimate = np.maximum(misfit, 0.5 * jump)
        better = estimate < 0.9 * error[active]
        idle[active] = np.where(better, 0, idle[active] + 1)
        better = estimate < error[active]
        keep = active[better]
        size[keep], error[keep], scatter[keep] = len(indices), estimate[better], spread[better]
        floor = np.maximum(choice.tolerance * spread, max(choice.accuracy, ROUNDING) * level)
        converged[active] = estimate <= floor
        going = ~converged[active] & (idle[active] < STALL)
        old, active = terms[:, going], active[going]
        if progress:
            progress(int(runs.sum()), int(converged.sum()), experiments)
        room = most - len(indices)
        if not active.size or room <= 0:
            break
        relative = old / np.maximum(spread[going], ROUNDING * level[going])
        weight = np.sqrt((relative**2).mean(axis=1))
        wanted = int(np.ceil(GROWTH * len(indices)))
        fresh = grown(indices, weight, min(wanted, room))
        indices = np.vstack([indices, fresh])
    surface = _assembled(box, indices, values, size, error, scatter, converged, runs)
    return _with_range(surface, np.hstack([values, truth]))


class _Bench:
    """The simulator as it is asked: whole experiments at points of the unit box."""

    def __init__(self, run: Run, box: Floats, experiments: int) -> None:
        self.run, self.box, self.experiments = run, box, experiments

    def __call__(self, experiments: Ints, z: Floats) -> Floats:
        low, high = self.box.T
        x = np.clip(0.5 * (low + high) + 0.5 * (high - low) * z, low, high)
        index = np.repeat(experiments, len(x))
        outcome = np.asarray(self.run(index, np.tile(x, (len(experiments), 1))), dtype=np.float64)
        if outcome.shape != index.shape or not np.isfinite(outcome).all():
            raise SimulatorError(
                f"run: outcomes of shape {outcome.shape} for {index.shape[0]} runs, or not finite",
                "return one finite number a run",
            )
        return outcome.reshape(len(experiments), len(z))


def _checked_box(box: Floats) -> Floats:
    box = np.asarray(box, dtype=np.float64)
    if box.ndim != 2 or box.shape[1] != 2 or not len(box):
        raise InputsError(f"box of shape {box.shape}", "pass one row [lower, upper] a parameter")
    for i, (low, high) in enumerate(box):
        if not (np.isfinite(low) and np.isfinite(high) and low < high):
            raise InputsError(
                f"box: parameter {i}: lower {low} >= upper {high}",
                "pass two finite numbers, the smaller one first",
            )
    return box


def _rms(residual: Floats) -> Floats:
    return np.sqrt((residual**2).mean(axis=1))


def _assembled(
    box: Floats,
    indices: Ints,
    values: Floats,
    size: Ints,
    error: Floats,
    scatter: Floats,
    converged: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
    runs: Ints,
) -> Surface:
    groups = []
    degrees = np.zeros((len(size), len(box)), dtype=np.intp)
    for count in np.unique(size):
        members = np.flatnonzero(size == count)
        prefix = indices[:count]
        matrix = products(prefix, points_of(prefix)).T
        groups.append(Group(members, np.linalg.solve(matrix, values[members, :count].T).T.copy()))
        degrees[members] = prefix.max(axis=0)
    used = indices[: size.max()]
    return Surface(box, used, tuple(groups), error, scatter, converged, runs, degrees)


def _with_range(surface: Surface, outcomes: Floats) -> Surface:
    n = len(surface.box)
    unit = 0.5 * (low_discrepancy(2048, n, 0) + 1.0)
    x = surface.box[:, 0] + unit * (surface.box[:, 1] - surface.box[:, 0])
    lower, upper = np.nanmin(outcomes, axis=1), np.nanmax(outcomes, axis=1)
    for part in range(0, len(x), 256):
        y = surface.evaluate(x[part : part + 256])
        lower, upper = np.minimum(lower, y.min(axis=1)), np.maximum(upper, y.max(axis=1))
    return replace(surface, lower=lower, upper=upper)
