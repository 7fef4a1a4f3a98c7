"""Shifting time of the wet clutch: from the start of the current to equal speeds of both shafts."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike

from aleator.clutch.converter import idle_speed
from aleator.clutch.hydraulics import Signals, Window, windows
from aleator.clutch.parameters import CLUTCH
from aleator.clutch.plates import Constants, constants, increments
from aleator.clutch.runs import Runs, make_runs
from aleator.clutch.shafts import Stepper
from aleator.types import Array, Indices

STEPS = 5  #: Runge-Kutta steps in a window of 10 ms
BLOCK = 10_000  #: runs that advance together: bounds the memory, some 15 MB


def shifting_time(
    *,
    pulse_duration: ArrayLike,
    hold_current: ArrayLike,
    pulse_current: ArrayLike,
    motor_speed: ArrayLike,
    brake_torque: ArrayLike,
    c2_scale: ArrayLike,
    zp_scale: ArrayLike,
    alpha_scale: ArrayLike = 1.0,
    gamma_scale: ArrayLike = 1.0,
    omega_scale: ArrayLike = 1.0,
    brake_scale: ArrayLike = 1.0,
    j2_scale: ArrayLike = 1.0,
    b_scale: ArrayLike = 1.0,
) -> Array:
    """Return the shifting time [s]: from the start of the current to equal speeds of both shafts.

    The root of w_1 = R w_2 in the paper's model of the asynchronous phase. The hydraulics do not
    depend on the speeds and are propagated exactly; Runge-Kutta of order 4 with a step of 2 ms
    integrates the speeds, and the root is that of the cubic Hermite interpolant of the slip.
    Parameters marked (i) in `aleator.clutch.parameters` were invented: the numbers are synthetic.

    Parameters
    ----------
    pulse_duration
        Delta t [s], length of the filling pulse, 0.01 < Delta t <= 3.21.
    hold_current, pulse_current
        u_0 and Delta u [A], at least 0.
    motor_speed
        w_m [rpm], more than 0.
    brake_torque
        T_b0 [N m], more than 0.
    c2_scale
        x_1 [-], scales the oil pressure bias c_2; the box of the benchmark is [0.5, 1.4].
    zp_scale
        x_2 [-], scales the contact position z_p; the box of the benchmark is [0.3, 1.2].
    alpha_scale, gamma_scale, omega_scale, brake_scale, j2_scale, b_scale
        [-], more than 0, scale friction alpha, drag gamma, the natural frequency of the hydraulics,
        brake torque T_b0, the output's inertia J_2 and its viscous friction b: further lumped
        parameters, from which a sensitivity study chooses. The result at 1 is that without them.

    Each argument is a number or an array (R,); numbers are broadcast.

    Returns
    -------
    array, shape (R,)
        Shifting times; NaN if the shafts do not synchronize within 5 s, if the clutch stalls the
        input shaft because the brake holds the load, if x_1 is not finite, or if x_2 is not in
        (0, 1.515): the plates would touch always or never.

    Raises
    ------
    SimulatorError
        Conditions outside the ranges above, or arrays that do not fit together.

    Notes
    -----
    In the box the error is below 1e-6 s, 99 % below 2e-7 s. Cost, on one core: 40 ms for a single
    run, 50 ms for 100, 0.4 s for 10,000; fewer different currents and omega_scale
    are a little cheaper. Outside the box (x_2 above 1.2) synchronization can be grazing; the
    outcome then jumps as a function of x, and next to the jump no accuracy can be promised.

    Examples
    --------
    >>> shifting_time(
    ...     pulse_duration=0.110, hold_current=0.260, pulse_current=0.070,
    ...     motor_speed=1200, brake_torque=80, c2_scale=[1.0, 0.91], zp_scale=[1.0, 0.55],
    ... ).round(5)
    array([0.8716 , 0.62697])
    """
    runs = make_runs(
        pulse_duration=pulse_duration,
        hold_current=hold_current,
        pulse_current=pulse_current,
        motor_speed=motor_speed,
        brake_torque=brake_torque,
        c2_scale=c2_scale,
        zp_scale=zp_scale,
        friction_factor=alpha_scale,
        drag_factor=gamma_scale,
        frequency_factor=omega_scale,
        brake_factor=brake_scale,
        inertia_factor=j2_scale,
        viscous_factor=b_scale,
    )
    return synchronization_time(runs)


def synchronization_time(runs: Runs, steps: int = STEPS) -> Array:
    """Return the time [s] at which w_1 = R w_2 for each run, NaN where there is none."""
    plates = CLUTCH.plates
    times = np.full(len(runs.c2_scale), np.nan)
    reach = plates.z_max / plates.z_contact
    possible = np.isfinite(runs.c2_scale) & (runs.zp_scale > 0) & (runs.zp_scale < reach)
    (todo,) = np.nonzero(possible)
    for first in range(0, len(todo), BLOCK):
        index = todo[first : first + BLOCK]
        times[index] = _block(runs.take(index), steps)
    return times


def signals_of(runs: Runs) -> tuple[Signals, Indices]:
    """Return the different currents of `runs`, and for each run the position of its own."""
    key = np.stack([getattr(runs, f.name) for f in fields(Signals)])
    different, inverse = np.unique(key, axis=1, return_inverse=True)
    return Signals(*different), inverse.reshape(-1)


def initial_speed(runs: Runs) -> Array:
    """Return w_1 [rad/s] of the steady state in which runs begin: z = 0, the load at rest."""
    plates = CLUTCH.plates
    return idle_speed(runs.motor_speed, plates.gamma * runs.drag_factor / plates.z_max)


def _block(runs: Runs, steps: int) -> Array:
    """Return the synchronization times of runs that advance together."""
    signals, signal = signals_of(runs)
    c = constants(runs, signal)
    state = np.stack([initial_speed(runs) * c.cell, np.zeros(len(signal))])
    brackets = np.full((6, len(signal)), np.nan)
    for window in windows(signals, steps):
        if len(c.run) == 0 or window.start.min() >= CLUTCH.current.end:
            break
        step = step_of(window, steps, c.signal)
        push, drag = increments(c, window, step)
        track = advance(Stepper(c, step), state, push, drag)
        state = track[-1]
        ahead = track[:, 0] > track[:, 1]
        going = np.asarray(ahead.all(axis=0))
        if not going.all():
            (done,) = np.nonzero(~going)
            node = np.argmin(ahead[:, done], axis=0) - 1
            brackets[:, c.run[done]] = _bracket(c, window, step, track, (push, drag), done, node)
            c, state = c.take(going), state[:, going]
    return _root(brackets)


def step_of(window: Window, steps: int, signal: Indices) -> Array | float:
    """Return the step [s] of each run in a window, a single number where all have the same."""
    lengths = window.length / steps
    return float(lengths[0]) if len(lengths) == 1 else lengths.take(signal)


def advance(stepper: Stepper, state: Array, push: Array, drag: Array) -> Array:
    """Return the states at the n + 1 nodes of a window, shape (n + 1, 2, R)."""
    steps = len(push) // 2
    track = np.empty((steps + 1, *state.shape))
    track[0] = state
    braked = stepper.may_rest(state, steps)
    for k in range(steps):
        instants = slice(2 * k, 2 * k + 3)
        stepper.step(track[k], push[instants], drag[instants], braked, track[k + 1])
    return track


def _bracket(
    c: Constants,
    window: Window,
    step: Array | float,
    track: Array,
    torques: tuple[Array, Array],
    done: Indices,
    node: Indices,
) -> Array:
    """Return start, length, slips and rates of slip at both ends of the steps that end the runs.

    Where the load still rests, the clutch has stalled the input shaft instead of synchronizing the
    load: the start is NaN.
    """
    length = np.broadcast_to(step, len(c.run))[done]
    stepper = Stepper(c.take(done), length)
    start = window.start.take(c.signal[done]) + node * length
    rows = [np.where(track[node + 1, 1, done] > 0.0, start, np.nan), length]
    slips, rates = [], []
    for k in (node, node + 1):
        state = track[k, :, done].T
        push, drag = (torque[2 * k, done] for torque in torques)
        dw, dv = stepper.rate(state, push, drag, np.empty_like(state))
        slips.append(state[0] - state[1])
        rates.append(dw - np.maximum(dv, -state[1]))
    return np.stack([*rows, *slips, *rates])


def _root(brackets: Array) -> Array:
    """Return the time at which the cubic Hermite interpolant of the slip is zero; NaN stays NaN."""
    start, length, s0, s1, d0, d1 = brackets
    c2, c3 = 3.0 * (s1 - s0) - 2.0 * d0 - d1, 2.0 * (s0 - s1) + d0 + d1
    low, high = np.zeros_like(start), np.ones_like(start)
    for _ in range(40):  # 2^-40 of a step is far below 1e-12 s
        x = 0.5 * (low + high)
        positive = s0 + x * (d0 + x * (c2 + x * c3)) > 0.0
        low, high = np.where(positive, x, low), np.where(positive, high, x)
    times = start + length * 0.5 * (low + high)
    return np.where(times <= CLUTCH.current.end, times, np.nan)
