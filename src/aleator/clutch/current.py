"""Feed-forward current of the valve: piecewise linear, set by three control parameters."""

from __future__ import annotations

import numpy as np

from aleator.clutch.parameters import CLUTCH
from aleator.types import Array


def offsets() -> Array:
    """Return the times [s] after the filling pulse at which the slope of the current changes."""
    current = CLUTCH.current
    start = current.hold_end
    steps = [current.flank, current.pulse, current.fall, current.rise]
    return np.array([0.0, current.flank, *np.cumsum([start, *steps])])


def breakpoints(
    pulse_duration: Array, hold_current: Array, pulse_current: Array, delay: Array | float = 0.0
) -> tuple[Array, Array]:
    """Return times [s] and currents [A] of the breakpoints, each of shape (9, S), for S signals.

    `delay` [s] is the time before which the valve sees nothing but the idle current.
    """
    c = CLUTCH.current
    pulse_duration = np.asarray(pulse_duration, dtype=np.float64)
    rest = np.zeros_like(pulse_duration)
    early = np.stack([rest, rest + c.flank])
    times = np.concatenate([early, pulse_duration + offsets()[:, None]]) + delay
    peak = hold_current + pulse_current
    fallen = hold_current + c.fall_fraction * pulse_current
    levels: list[Array | float] = [
        c.idle,
        c.high,
        c.high,
        hold_current,
        hold_current,
        peak,
        peak,
        fallen,
        c.high,
    ]
    return times, np.stack([rest + level for level in levels])


def current_at(time: Array, times: Array, levels: Array) -> Array:
    """Return the current [A] of one signal at `time` [s], from its breakpoints."""
    return np.interp(time, times, levels)
