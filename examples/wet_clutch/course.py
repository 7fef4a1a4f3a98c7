"""The course of one engagement: every quantity of the model over time, through both phases."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator

from examples.wet_clutch.model import (
    CLUTCH,
    STEPS,
    Array,
    Runs,
    Stepper,
    advance,
    breakpoints,
    capacity,
    constants,
    increments,
    initial_speed,
    make_runs,
    positions,
    signals_of,
    synchronization_time,
    windows,
)


def trajectories(
    *,
    pulse_duration: float,
    hold_current: float,
    pulse_current: float,
    motor_speed: float,
    brake_torque: float,
    c2_scale: float = 1.0,
    zp_scale: float = 1.0,
    until: float = 2.0,
) -> pd.DataFrame:
    """The course of one engagement, from the start of the current to `until` [s], at most 5.

    The other arguments are those of `shifting_time`, one number each. Until the shafts have equal
    speeds, the equations of the paper's asynchronous phase; from then on
    (J_1 + J_2 / R^2) w_1' = T_1 - T_b(w_1 / R) / R of its synchronous phase, in which T_2 = R T_1
    by the paper's assumption of a perfect transmission. A run that does not synchronize has no
    synchronous row.

    Rows every 2 ms or less, and one at the shifting time: `time` [s], `current` [A], `pressure`
    p_hc [Pa], `plate_pressure` p [Pa], `piston` z [m], `input_torque` T_1, `clutch_torque` T_c,
    `output_torque` T_2 [N m], `input_speed` w_1, `output_speed` w_2 [rad/s], `synchronous` (True
    from the shifting time on). Raises ValueError for conditions that are not admissible, and for
    more than one run.
    """
    runs = make_runs(
        pulse_duration=pulse_duration,
        hold_current=hold_current,
        pulse_current=pulse_current,
        motor_speed=motor_speed,
        brake_torque=brake_torque,
        c2_scale=c2_scale,
        zp_scale=zp_scale,
    )
    end = CLUTCH.current.end
    if len(runs.c2_scale) != 1:
        raise ValueError("trajectories follows a single run: give one number per argument")
    if not 0.0 < until <= end:
        raise ValueError(f"until = {until:g}: use 0 < until <= {end:g} s")
    sync = float(synchronization_time(runs)[0])
    nodes = _nodes(runs, until, sync)
    late = nodes[0] > sync
    if late.any():
        first = int(np.argmax(late))
        around = nodes[:, first - 3 : first + 1]  # the asynchronous phase, one node beyond its end
        at_sync = BarycentricInterpolator(around[0], around, axis=1)(sync)
        nodes = np.insert(nodes, first, at_sync, axis=1)
        nodes[0, first] = sync
        late = np.insert(late, first, True)
        nodes[5:, late] = _synchronous_speed(runs, nodes[0, late], nodes[5:, first].mean())
    return _table(runs, nodes, late)


def _nodes(runs: Runs, until: float, sync: float) -> Array:
    """Return time, p_hc, sigma, F, G, w_1, R w_2 at the nodes, shape (7, n), in SI units.

    The speeds are those of the asynchronous phase, up to the end of the window in which it ends.
    """
    signals, signal = signals_of(runs)
    c = constants(runs, signal)
    state = np.array([initial_speed(runs) * c.cell, [0.0]])
    parts = []
    for window in windows(signals, STEPS):
        start, length = float(window.start[0]), float(window.length[0])
        if start >= until:
            break
        step = length / STEPS
        push, drag = increments(c, window, step)
        track = np.full((STEPS + 1, *state.shape), np.nan)
        track[0] = state
        if not start > sync:
            track = advance(Stepper(c, step), state, push, drag)
            state = track[-1]
        time = start + length * np.linspace(0.0, 1.0, STEPS + 1)
        per_step = CLUTCH.shafts.inertia_1 / step
        rows = [time, window.pressure[::2, 0], positions(c, window)[::2, 0]]
        rows += [push[::2, 0] * per_step / c.cell, drag[::2, 0] * per_step]
        rows += [track[:, 0, 0] / c.cell, track[:, 1, 0] / c.cell]
        parts.append(np.stack(rows)[:, :-1])
    return np.concatenate(parts, axis=1)


def _synchronous_speed(runs: Runs, time: Array, first: float) -> Array:
    """Return w_1 [rad/s] at `time` in the synchronous phase, which begins with `first`."""
    shafts, w_m = CLUTCH.shafts, runs.motor_speed
    inertia = shafts.inertia_1 + shafts.inertia_2 / shafts.ratio**2

    def derivative(_: float, w_1: Array) -> Array:
        brake = runs.brake_torque + shafts.viscous * w_1 / shafts.ratio
        return (w_m**2 * capacity(w_1 / w_m) - brake / shafts.ratio) / inertia

    span = (time[0], time[-1])
    solution = solve_ivp(derivative, span, [first], t_eval=time, rtol=1e-9, atol=1e-9)
    return np.asarray(solution.y[0])


def _table(runs: Runs, nodes: Array, late: NDArray[np.bool_]) -> pd.DataFrame:
    """Return the columns of `trajectories`."""
    plates, ratio, w_m = CLUTCH.plates, CLUTCH.shafts.ratio, runs.motor_speed
    time, pressure, sigma, push, drag, w_1, v = nodes
    contact = float(runs.zp_scale[0]) * plates.z_contact
    times, levels = breakpoints(runs.pulse_duration, runs.hold_current, runs.pulse_current)
    input_torque = w_m**2 * capacity(w_1 / w_m)
    clutch_torque = np.where(late, input_torque, push + drag * (w_1 - v))
    return pd.DataFrame(
        {
            "time": time,
            "current": np.interp(time, times[:, 0], levels[:, 0]),
            "pressure": pressure,
            "plate_pressure": np.maximum(sigma, 0.0) * np.maximum(pressure, 0.0),
            "piston": contact + sigma * (plates.z_max - contact),
            "input_torque": input_torque,
            "clutch_torque": clutch_torque,
            "output_torque": ratio * clutch_torque,
            "input_speed": w_1,
            "output_speed": v / ratio,
            "synchronous": late,
        }
    )
