"""The check without noise: what surfaces have wrong on the level sets of the measured outcomes.

The points where a surface s gives an outcome y have a mean error m(y) = E[eta - s | s = y] under
the law. The simulator moves their probability by it, P(eta <= y) = P(s <= y) - f_s(y) m(y) to first
order, so that its density is

    f(y) = f_s(y - m(y)) (1 - m'(y)).

Runs on the sets of two outcomes y - h and y + h tell m and its slope. Nothing is smoothed, and
nothing ends within the width of a kernel: a density may be infinite at the extreme of a response.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.densities import Status
from aleator.inference.verification.choice import Score, Verification
from aleator.inference.verification.emulator import Emulator
from aleator.inference.verification.near import enough
from aleator.inference.verification.samples import Run, made
from aleator.likelihood.level_sets import LevelLikelihood
from aleator.progress import Progress
from aleator.search.value import LogLikelihood
from aleator.types import Array, Flags

OFFSET = 0.02
"""Distance h over the scatter of the outcome."""
BESIDE = 0.3
"""The same of two more sets: what a surface misses there may hide a root of the simulator."""
WAVE = 0.1
"""Distance, over the scatter, within which the error of a surface is another."""
LARGEST = 0.5
"""Change of a log-density by the error of its surface above which first order does not hold."""
FARTHER = 3.0
"""Times the largest error that was seen by which a surface may be off."""
COUNTED = 1e-3
"""Share of a density that a point has at least to be looked at."""
COPIES = 2
"""Independent sets of points, whose difference tells the error of the check."""


def verify_on_levels(
    run: Run,
    levels: LevelLikelihood,
    emulator: Emulator,
    alpha: Array,
    scatter: Array,
    expected: Array,
    most: int,
    progress: Progress,
) -> Verification:
    """Estimate every log f_l(y_l | alpha) from runs of the simulator on level sets of a surface.

    `levels` are those of the surfaces, `emulator` the surfaces, `scatter` (N,) the standard
    deviations of the outcomes under the law, and `expected` (N,) the errors that the surfaces
    expect of themselves. A set of one parameter has a run at each of its points; of two it has so
    many as the errors ask for, `most` for each experiment. First order is not enough, and an
    experiment is not reached, where the log-density changes by more than LARGEST.
    """
    points = max(1, enough(expected / (WAVE * scatter), most) // (2 * COPIES))
    y, offset = levels.outcomes, OFFSET * scatter
    ends = [_within(levels, alpha, y + side * offset) for side in (-1.0, 1.0)]
    looks = [_looked(levels.given(end), alpha, run, emulator, points, progress) for end in ends]
    low, high = (look.means for look in looks)
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (high - low) / (ends[1] - ends[0])[:, None]
    shift = low + (y - ends[0])[:, None] * slope
    before = levels.evaluate(alpha).each
    whole = _corrected(levels, alpha, shift.mean(axis=1), slope.mean(axis=1))
    parts = [_corrected(levels, alpha, *one) for one in zip(shift.T, slope.T, strict=True)]
    assert whole.scores is not None
    assert parts[0].scores is not None
    assert parts[-1].scores is not None
    apart = 0.5 * (parts[0].scores - parts[-1].scores)
    change = whole.each - before
    # what the second order may add, and half of what two copies differ by
    errors = np.concatenate([look.errors for look in looks], axis=1)
    around = [
        _looked(levels.given(_within(levels, alpha, y + side * scatter)), alpha, run, emulator, 1,
                progress).errors for side in (-BESIDE, BESIDE)
    ]  # fmt: skip
    near = _mean(np.abs(errors), largest=True)
    apart_each, bent = 0.5 * (parts[0].each - parts[-1].each), _bent(levels, alpha, before, near)
    bias = 0.5 * change**2 + bent
    reached: Flags = (whole.status == Status.SOLVED) & (np.abs(change) + bent < LARGEST)
    return Verification(
        each=whole.each,
        each_error=np.where(reached, np.hypot(bias, apart_each), np.inf),
        effective=np.isfinite(errors).sum(axis=1).astype(float),
        reached=reached,
        total=float(whole.each[reached].sum()),
        standard_error=float(np.hypot(bias[reached].sum(), np.linalg.norm(apart_each[reached]))),
        scatter=scatter,
        surface_error=_mean(errors**2) ** 0.5,
        near_error=_mean(np.abs(np.concatenate([errors, *around], axis=1)), largest=True),
        contradicted=np.zeros(y.size, dtype=np.bool_),
        score=Score(whole.scores, apart.T @ apart) if reached.all() else None,
    )


@dataclass(frozen=True)
class _Look:
    """Errors (N, J) of the surfaces at the points of sets, and their means (N, COPIES)."""

    errors: Array
    means: Array


def _looked(
    levels: LevelLikelihood, alpha: Array, run: Run, emulator: Emulator, points: int,
    progress: Progress,
) -> _Look:  # fmt: skip
    """Runs on the sets of outcomes."""
    x, weight = levels.sets(alpha).chosen(alpha, COPIES, points)
    count = len(x)
    index = np.arange(count)
    owner = np.broadcast_to(index[:, None, None], weight.shape)
    used = weight > COUNTED
    outcome = made(run, owner[used], x[used][:, None], progress)[:, 0]
    error = np.full(weight.shape, np.nan)
    error[used] = outcome - emulator.at(owner[used], x[used])
    weight = np.where(np.isfinite(error), weight, 0.0)
    sums = np.sum(weight * np.nan_to_num(error), axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        means = sums / weight.sum(axis=2)
    return _Look(error.reshape(count, -1), means)


def _bent(levels: LevelLikelihood, alpha: Array, before: Array, error: Array) -> Array:
    """What the second order may add (N,) to a log-density, by a surface that is off by `error`.

    Infinite where the outcome is within that of the end of the surface: an extreme.
    """
    off = FARTHER * np.nan_to_num(error, nan=0.0)
    up, down = (levels.given(levels.outcomes + side * off).evaluate(alpha) for side in (1.0, -1.0))
    ends = (up.status == Status.SOLVED) & (down.status == Status.SOLVED) & np.isfinite(error)
    bent = 0.5 * np.abs(up.each + down.each - 2.0 * before)
    return np.where(ends, bent, np.inf)


def _within(levels: LevelLikelihood, alpha: Array, y: Array) -> Array:
    """Outcomes y (N,), or those measured where a surface does not go so far."""
    beyond = levels.given(y).sets(alpha).empty
    return np.where(beyond, levels.outcomes, y)


def _corrected(levels: LevelLikelihood, alpha: Array, shift: Array, slope: Array) -> LogLikelihood:
    """The log-densities of the simulator, with their scores."""
    known = np.isfinite(shift) & (slope < 1.0)
    moved = levels.outcomes - np.where(known, shift, 0.0)
    found = levels.given(moved)(alpha)
    each = found.each + np.log1p(-np.where(known, slope, 0.0))
    status = np.where(known, found.status, int(Status.DEGENERATE))
    return LogLikelihood(each, found.scores, status)


def _mean(errors: Array, *, largest: bool = False) -> Array:
    """Their mean (N,), or the largest; NaN where there is none."""
    known = np.isfinite(errors)
    some = known.any(axis=1)
    if largest:
        return np.where(some, np.where(known, errors, 0.0).max(axis=1), np.nan)
    total = np.where(known, errors, 0.0).sum(axis=1)
    return np.where(some, total / np.maximum(known.sum(axis=1), 1), np.nan)
