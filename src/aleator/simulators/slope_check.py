"""The derivatives that a simulator gives are compared with differences of its values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aleator.core.types import Array, Indices
from aleator.errors import SimulatorError
from aleator.simulators.runner import Runner


@dataclass(frozen=True)
class SlopeCheckSettings:
    """Settings of the check of derivatives. The values are chosen by judgement."""

    step: float = 0.01
    """The step of the differences, over the width of the region. An error of the values of a
    millionth of their range then makes the differences wrong by a ten-thousandth."""
    tolerated: float = 0.05
    """The relative error that is tolerated, besides what the curvature of three values shows."""
    rounding: float = 1e-9
    """The error of values, over their size, that is tolerated."""


SLOPE_CHECK = SlopeCheckSettings()


def require_slopes(
    runner: Runner,
    x: Array,
    region: Array,
    moving: Indices,
    settings: SlopeCheckSettings = SLOPE_CHECK,
) -> None:
    """Check the derivatives of the first run at x (n,) by two runs on both sides of it.

    All parameters `moving` of a region (n, 2) change at once, by different steps. If the difference
    of the values is not what the derivatives say, two runs for each parameter find the one at
    fault. Nothing is compared where a run fails.

    Raises SimulatorError for a derivative that is missing or contradicts the values.
    """
    steps = settings.step * (region[:, 1] - region[:, 0])
    point = np.clip(x, region[:, 0] + steps, region[:, 1] - steps)
    value, slope = (one[0] for one in runner.with_slopes([0], point[None]))
    measured = np.unique(runner.column[runner.unit == 0])
    for i in moving:
        if not np.isfinite(slope[measured, i]).all() and np.isfinite(value[measured]).all():
            raise SimulatorError(
                f"simulator '{runner.simulator.name}' gives no derivative by "
                f"'{runner.parameters[i]}' {_at(runner, point)}",
                "return it, or leave out jac",
            )
    # Different steps, so that derivatives in a wrong order are noticed.
    share = np.zeros(len(x))
    share[moving] = 1.0 / (1.0 + 0.5 * np.arange(moving.size))
    if _differing(runner, point, value, slope, share * steps, measured, settings) is None:
        return
    for i in moving:
        along = steps * (np.arange(len(x)) == i)
        found = _differing(runner, point, value, slope, along, measured, settings)
        if found is not None:
            given, difference = (one / along[i] for one in found)
            raise SimulatorError(
                f"simulator '{runner.simulator.name}' gives the derivative {given:.6g} by "
                f"'{runner.parameters[i]}' {_at(runner, point)}, where differences of its values "
                f"give {difference:.6g}",
                "mend the derivative, see to the order of the parameters "
                f"({', '.join(runner.parameters)}), or leave out jac",
            )


def _differing(
    runner: Runner,
    x: Array,
    value: Array,
    slope: Array,
    along: Array,
    measured: Indices,
    settings: SlopeCheckSettings,
) -> tuple[float, float] | None:
    """The change of a value along a step (n,), by slopes and by differences, if they disagree."""
    before, after = runner.values([0, 0], np.stack([x - along, x + along]))
    for k in measured:
        given, found = float(slope[k] @ along), float(after[k] - before[k]) / 2.0
        bend = abs(float(after[k] - 2.0 * value[k] + before[k])) / 2.0
        size = max(float(np.abs(slope[k] * along).sum()), abs(found))
        near = settings.tolerated * size + bend + settings.rounding * abs(float(value[k]))
        if abs(given - found) > near:  # False where a run failed.
            return given, found
    return None


def _at(runner: Runner, x: Array) -> str:
    values = ", ".join(f"{n}={v:.6g}" for n, v in zip(runner.parameters, x, strict=True))
    return f"for experiment '{runner.ids[runner.experiment[0]]}' with {values}"
