"""Shifting time of the wet clutch: from the start of the current to equal speeds of both shafts."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.clutch.converter import idle_speed
from aleator.clutch.drivetrain import Constants, Index, Stepper, constants, increments
from aleator.clutch.hydraulics import Signals, windows
from aleator.clutch.parameters import CLUTCH
from aleator.clutch.runs import Runs, make_runs

Array = NDArray[np.float64]

STEPS = 5  #: Runge-Kutta steps in a window of 10 ms
BLOCK = 2000  #: runs that advance together


def shifting_time(
    *,
    pulse_duration: ArrayLike,
    hold_current: ArrayLike,
    pulse_current: ArrayLike,
    motor_speed: ArrayLike,
    brake_torque: ArrayLike,
    c2_scale: ArrayLike,
    zp_scale: ArrayLike,
) -> Array:
    """Return the simulated shifting time [s] of each run, NaN where the shafts do not synchronize."""
    runs = make_runs(
        pulse_duration=pulse_duration,
        hold_current=hold_current,
        pulse_current=pulse_current,
        motor_speed=motor_speed,
        brake_torque=brake_torque,
        c2_scale=c2_scale,
        zp_scale=zp_scale,
    )
    return synchronization_time(runs)


def synchronization_time(runs: Runs, steps: int = STEPS) -> Array:
    """Return the time [s] at which w_1 = R w_2 for each run, NaN where that does not come to pass."""
    plates = CLUTCH.plates
    times = np.full(len(runs.c2_scale), np.nan)
    reach = plates.z_max / plates.z_contact
    possible = np.isfinite(runs.c2_scale) & (runs.zp_scale > 0) & (runs.zp_scale < reach)
    (todo,) = np.nonzero(possible)
    for first in range(0, len(todo), BLOCK):
        index = todo[first : first + BLOCK]
        times[index] = _block(runs.take(index), steps)
    return times


def signals_of(runs: Runs) -> tuple[Signals, Index]:
    """Return the different currents of `runs`, and for each run the position of its own."""
    key = np.stack(
        [
            runs.pulse_duration,
            runs.hold_current,
            runs.pulse_current,
            runs.delay,
            runs.frequency_factor,
        ]
    )
    different, inverse = np.unique(key, axis=1, return_inverse=True)
    return Signals(*different), inverse.reshape(-1)


def _block(runs: Runs, steps: int) -> Array:
    """Return the synchronization times of runs that advance together."""
    plates = CLUTCH.plates
    signals, signal = signals_of(runs)
    size = len(signal)
    c = constants(runs, signal, np.arange(size))
    times = np.full(size, np.nan)
    speed = idle_speed(runs.motor_speed, plates.gamma * runs.drag_factor / plates.z_max)
    w, v = speed * c.cell, np.zeros(size)
    for window in windows(signals, steps):
        start = window.start.take(c.signal)
        if len(start) == 0 or start.min() >= CLUTCH.current.end:
            break
        lengths = window.length
        step: Array | float = (
            lengths.take(c.signal) / steps if len(lengths) > 1 else float(lengths[0]) / steps
        )
        push, drag = increments(c, window, step)
        track = np.empty((2, steps + 1, len(start)))
        track[:, 0] = w, v
        stepper = Stepper(c, step)
        braked = stepper.may_rest(v, steps)
        for k in range(steps):
            rows = slice(2 * k, 2 * k + 3)
            (w, v), (new_w, new_v) = track[:, k], track[:, k + 1]
            stepper.step(w, v, push[rows], drag[rows], braked, new_w, new_v)
        w, v = track[:, -1]
        slip = track[0] - track[1]
        done = slip.min(axis=0) <= 0.0
        if done.any():
            (run,) = np.nonzero(done)
            k = np.argmax(slip[:, run] <= 0.0, axis=0) - 1
            h = step if isinstance(step, float) else step[run]
            times[c.run[run]] = start[run] + h * (
                k + _crossing(c.take(run), h, track[:, :, run], push[:, run], drag[:, run], k)
            )
            keep = ~done
            c, w, v = c.take(keep), w[keep], v[keep]
    times[times > CLUTCH.current.end] = np.nan
    return times


def _crossing(c: Constants, h: Array | float, track: Array, push: Array, drag: Array, k: Index):
    """Return the fraction of step `k` at which the cubic Hermite interpolant of the slip is zero."""
    stepper = Stepper(c, h)
    column = np.arange(len(k))
    slips, rates = [], []
    for node in (k, k + 1):
        w, v = track[:, node, column]
        dw, dv = np.empty_like(w), np.empty_like(v)
        stepper.rate(w, v, push[2 * node, column], drag[2 * node, column], dw, dv)
        slips.append(w - v)
        rates.append(dw - np.maximum(dv, -v))
    (s0, s1), (d0, d1) = slips, rates
    x = s0 / (s0 - s1)
    # s(x) = s0 + d0 x + c2 x^2 + c3 x^3
    c2, c3 = 3 * (s1 - s0) - 2 * d0 - d1, 2 * (s0 - s1) + d0 + d1
    for _ in range(8):
        value = s0 + x * (d0 + x * (c2 + x * c3))
        x = np.clip(x - value / (d0 + x * (2 * c2 + x * 3 * c3)), 0.0, 1.0)
    return x
