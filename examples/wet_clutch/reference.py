"""A second, plain implementation of the model: scipy.integrate.solve_ivp on all five states.

It exists to check `shifting_time` and to measure what its speed is worth. It shares the parameters
with it and nothing else: no matrix exponential, no fixed step, no table, the equations as the paper
writes them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from examples.wet_clutch.model import CLUTCH, Array

#: Typical size of p_hc [Pa], its rate [Pa/s], z~ [m], w_1 and w_2 [rad/s]: scales the tolerances.
_SCALE = np.array([1e5, 1e6, 1e-3, 100.0, 50.0])

_NU = np.array(CLUTCH.converter.speed_ratio)
_RATIO = PchipInterpolator(_NU, CLUTCH.converter.torque_ratio)
_INVERSE = PchipInterpolator(_NU, (np.array(CLUTCH.converter.k_factor) * math.pi / 30) ** -2.0)
# The coefficients as plain lists: scipy's call costs ten microseconds for a single number.
_RATIO_CELLS, _INVERSE_CELLS = _RATIO.c.T.tolist(), _INVERSE.c.T.tolist()


@dataclass(frozen=True)
class _Run:
    w_m: float  # rad/s
    brake_torque: float  # N m
    c2_scale: float
    zp_scale: float


def _driving_torque(w_m: float, w_1: float) -> float:
    """Return T_1 [N m] of the torque converter."""
    nu = min(max(w_1 / w_m, 0.0), 1.0)
    cell = min(int(nu * 10), 9)
    d = nu - _NU[cell]
    a, b, c, e = _RATIO_CELLS[cell]
    f_t = ((a * d + b) * d + c) * d + e
    a, b, c, e = _INVERSE_CELLS[cell]
    return float(w_m**2 * f_t * (((a * d + b) * d + c) * d + e))


def _clutch_torque(p_hc: float, z_tilde: float, zp_scale: float, slip: float) -> float:
    """Return T_c [N m] for the slip w_1 - R w_2 [rad/s]."""
    plates = CLUTCH.plates
    z, z_p = min(max(z_tilde, 0.0), plates.z_max), plates.z_contact * zp_scale
    sigma = (z - z_p) / (plates.z_max - z_p)
    pressure = max(0.0, sigma) * max(p_hc, 0.0)
    delta = 3 * sigma**2 - 2 * sigma**3 if sigma > 0 else 0.0
    gap = plates.z_max - z
    drag = (1 - delta) * plates.gamma / gap if gap > 0 else 0.0
    return delta * plates.alpha * pressure + drag * slip


def _profile(pulse_duration: float, hold: float, pulse: float) -> list[tuple[float, float]]:
    """Return the breakpoints (time [s], current [A]) of the feed-forward current."""
    c = CLUTCH.current
    points = [(0.0, c.idle), (c.flank, c.high), (pulse_duration, c.high)]
    points.append((pulse_duration + c.flank, hold))
    time = pulse_duration + c.hold_end
    points.append((time, hold))
    after = [(c.flank, hold + pulse), (c.pulse, hold + pulse)]
    after += [(c.fall, hold + c.fall_fraction * pulse), (c.rise, c.high)]
    for duration, level in after:
        time += duration
        points.append((time, level))
    return [*points, (c.end, c.high)]


def _derivative(
    p: float, dp: float, z: float, w_1: float, w_2: float, *, run: _Run, drive: float
) -> list[float]:
    """Return the derivative of the state; `drive` [A] is u + (b_2 / b_1) u' - dead band."""
    h, shafts = CLUTCH.hydraulics, CLUTCH.shafts
    omega = h.natural_frequency
    ddp = omega**2 * (h.gain * drive - p) - 2 * h.damping * omega * dp
    dz = h.a3 * p + h.a4 * dp + h.a5 * z + h.c2 * run.c2_scale
    torque = _clutch_torque(p, z, run.zp_scale, w_1 - shafts.ratio * w_2)
    dw_1 = (_driving_torque(run.w_m, w_1) - torque) / shafts.inertia_1
    dw_2 = (shafts.ratio * torque - run.brake_torque - shafts.viscous * w_2) / shafts.inertia_2
    return [dp, ddp, dz, dw_1, dw_2 if w_2 > 0 else max(dw_2, 0.0)]


def _slip(_: float, state: Array) -> float:
    return float(state[3] - CLUTCH.shafts.ratio * state[4])


_slip.terminal = True  # type: ignore[attr-defined]


def reference_shifting_time(
    *,
    pulse_duration: float,
    hold_current: float,
    pulse_current: float,
    motor_speed: float,
    brake_torque: float,
    c2_scale: float,
    zp_scale: float,
    method: str = "RK45",
    tolerance: float = 1e-9,
    max_step: float = 2e-3,
) -> float:
    """Return the shifting time [s] of one run, NaN if it does not synchronize or stalls.

    The arguments are those of `shifting_time`, one number each; `method` (RK45, DOP853 or LSODA),
    `tolerance` (relative) and `max_step` [s] go to solve_ivp, which restarts at every breakpoint of
    the current.
    """
    h = CLUTCH.hydraulics
    run = _Run(motor_speed * math.pi / 30, brake_torque, c2_scale, zp_scale)
    drag = CLUTCH.plates.gamma / CLUTCH.plates.z_max
    idle = brentq(lambda w: _driving_torque(run.w_m, w) - drag * w, 0.0, run.w_m, xtol=1e-12)
    state = np.array([0.0, 0.0, 0.0, idle, 0.0])
    points = _profile(pulse_duration, hold_current, pulse_current)
    for (begin, level), (end, next_level) in pairwise(points):
        slope = (next_level - level) / (end - begin)
        ahead = level + slope * (h.zero_time - begin) - h.dead_current
        solution = solve_ivp(
            lambda t, s, a=ahead, b=slope: _derivative(*s.tolist(), run=run, drive=a + b * t),
            (begin, end),
            state,
            method=method,
            events=_slip,
            rtol=tolerance,
            atol=tolerance * _SCALE,
            max_step=max_step,
        )
        if len(solution.t_events[0]):
            stalled = solution.y_events[0][0][4] <= 0.0
            return math.nan if stalled else float(solution.t_events[0][0])
        state = solution.y[:, -1]
    return math.nan
