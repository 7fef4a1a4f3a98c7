"""Torque of the plates, T_c = F + G slip: affine in the slip, F and G from pressure and piston.

Speeds are counted in cells of the torque converter's table (w_m = CELLS cells) and rates are
multiplied by the step, so that the innermost loop of the integration has no scaling left to do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.clutch.converter import CELLS
from aleator.clutch.hydraulics import Window
from aleator.clutch.parameters import CLUTCH
from aleator.clutch.runs import Runs
from aleator.types import Array, Indices


@dataclass(frozen=True)
class Constants:
    """What stays the same during a run, shape (R,); speeds in cells, see the module."""

    run: Indices  #: position among all runs
    signal: Indices  #: position among the signals
    cell: Array  #: cells s/rad
    torque: Array  #: w_m^2 / J_1, cells / s per unit of T_1 / w_m^2
    hold: Array  #: R T_b0 / J_2, cells / s
    spread: Array  #: R^2 J_1 / J_2, -
    viscous: Array  #: b / J_2, 1 / s
    friction: Array  #: alpha / J_1, cells / (s Pa)
    drag: Array  #: gamma / (J_1 (z_M - x_2 z_p)), 1 / s
    slope: Array  #: 1 / (z_M - x_2 z_p), 1 / m
    contact: Array  #: x_2 z_p / (z_M - x_2 z_p), -
    bias: Array  #: x_1 c_2 / a_5 / (z_M - x_2 z_p), -
    fade: Array  #: -, see `Runs`

    def take(self, keep: NDArray[np.bool_] | Indices) -> Constants:
        """Return the constants of the runs to keep."""
        return Constants(*(values[keep] for values in vars(self).values()))


def constants(runs: Runs, signal: Indices) -> Constants:
    """Return the constants of `runs`, whose currents are numbered by `signal`."""
    plates, hydraulics, shafts = CLUTCH.plates, CLUTCH.hydraulics, CLUTCH.shafts
    cell = CELLS / runs.motor_speed
    contact = plates.z_contact * runs.zp_scale
    slope = 1.0 / (plates.z_max - contact)
    inertia = shafts.inertia_2 * runs.inertia_factor
    return Constants(
        run=np.arange(len(signal)),
        signal=signal,
        cell=cell,
        torque=runs.motor_speed**2 / shafts.inertia_1 * cell,
        hold=shafts.ratio * runs.brake_torque / inertia * cell,
        spread=shafts.ratio**2 * shafts.inertia_1 / inertia,
        viscous=shafts.viscous * runs.viscous_factor / inertia,
        friction=plates.alpha * runs.friction_factor / shafts.inertia_1 * cell,
        drag=plates.gamma * runs.drag_factor / shafts.inertia_1 * slope,
        slope=slope,
        contact=contact * slope,
        bias=runs.c2_scale * hydraulics.c2 / hydraulics.a5 * slope,
        fade=runs.fade,
    )


def positions(c: Constants, window: Window) -> Array:
    """Return sigma = (z - x_2 z_p) / (z_M - x_2 z_p) at the instants of a window, (2 n + 1, R)."""
    a5 = CLUTCH.hydraulics.a5
    decay = np.exp(a5 * np.linspace(0.0, 1.0, len(window.piston))[:, None] * window.length)
    if decay.shape[1] > 1:
        decay = decay.take(c.signal, axis=1)
    # z~ = z_A + x_1 z_B with z_B = (c_2 / a_5)(exp(a_5 t) - 1)
    amplitude = c.bias * np.exp(a5 * window.start).take(c.signal)
    sigma: Array = window.piston.take(c.signal, axis=1)
    sigma *= c.slope
    sigma += decay * amplitude
    sigma -= c.bias + c.contact
    np.maximum(sigma, -c.contact, out=sigma)
    _clip_above(sigma)
    return sigma


def _clip_above(sigma: Array) -> None:
    """Clip sigma to 1 in place, such that Simpson's rule stays right where a step meets the clip.

    Runge-Kutta weighs the three instants of a step by 1, 4, 1. For a ramp that is cut off at 1
    inside the step this misses the integral by a term of order h^2, which would dominate all other
    errors. The value in the middle of the step makes up for it.
    """
    excess = sigma[::2] - 1.0
    np.minimum(sigma, 1.0, out=sigma)
    above = excess > 0.0
    step, run = np.nonzero(above[:-1] != above[1:])
    if len(step) == 0:
        return
    left, right = excess[step, run], excess[step + 1, run]
    high, low = np.maximum(left, right), np.minimum(left, right)
    integral = 0.5 * high**2 / (high - low)
    simpson = (high + 4.0 * np.maximum(0.5 * (high + low), 0.0)) / 6.0
    sigma[2 * step + 1, run] += 1.5 * (simpson - integral)


def increments(c: Constants, window: Window, step: Array | float) -> tuple[Array, Array]:
    """Return h F / J_1 [cells] and h G / J_1 [-] at the instants of a window, (2 n + 1, R).

    With delta = 3 sigma^2 - 2 sigma^3 for 0 < sigma < 1, F = delta alpha sigma p_hc and

        (1 - delta) / (z_M - z) = (1 - sigma)(1 + 2 sigma) / (z_M - x_2 z_p),

    which stays finite at z = z_M. Before contact G = gamma / (z_M - z) and F = 0.
    """
    sigma = positions(c, window)
    closed = np.maximum(sigma, 0.0)
    push = closed * -2.0
    drag = push + 1.0
    drag *= closed
    drag += 1.0
    push += 3.0
    for _ in range(3):
        push *= closed
    push *= np.maximum(window.pressure, 0.0).take(c.signal, axis=1)
    push *= c.friction * step
    np.minimum(sigma, 0.0, out=sigma)
    np.subtract(1.0, sigma, out=sigma)
    drag /= sigma
    drag *= c.drag * step
    return push, drag
