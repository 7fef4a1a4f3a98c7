"""Torque converter: T_1 = w_m^2 f_t(nu) / f_c(nu)^2 with nu = w_1 / w_m, as in the paper."""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from aleator.clutch.parameters import CLUTCH
from aleator.types import Array

#: Cells of the lookup table. Its error, max|f''| / (8 CELLS^2), is below 1e-10 where f is of order
#: 1e-2. A multiple of 10, so that every node of the interpolants is a node of the table.
CELLS = 20_000


@functools.cache
def _interpolants() -> tuple[PchipInterpolator, PchipInterpolator]:
    converter = CLUTCH.converter
    nu = np.array(converter.speed_ratio)
    f_c = np.array(converter.k_factor) * math.pi / 30  # rpm -> rad/s
    return PchipInterpolator(nu, converter.torque_ratio), PchipInterpolator(nu, f_c**-2.0)


def capacity(nu: Array) -> Array:
    """Return f(nu) = T_1 / w_m^2 [N m s^2/rad^2]; nu is clipped to [0, 1]."""
    torque_ratio, inverse_square = _interpolants()
    nu = np.clip(nu, 0.0, 1.0)
    return np.asarray(torque_ratio(nu) * inverse_square(nu), dtype=np.float64)


@functools.cache
def capacity_table() -> NDArray[np.complex128]:
    """Return f at i / CELLS as real part and the difference to the next node as imaginary part.

    One complex number a cell means one gather, instead of two, in the innermost loop.
    """
    f = capacity(np.linspace(0.0, 1.0, CELLS + 1))
    table = f.astype(np.complex128)
    table.imag[:-1] = np.diff(f)
    table.setflags(write=False)
    return table


def idle_speed(motor_speed: Array, drag: Array) -> Array:
    """Return the speed w_1 [rad/s] at which T_1(w_m, w_1) = drag w_1, the load being at rest.

    `motor_speed` w_m is in rad/s, `drag` = gamma / z_M in N m s/rad. T_1 is zero at w_1 = w_m and
    above the drag at w_1 = 0; bisection halves [0, w_m] down to rounding.
    """
    pairs, inverse = np.unique(np.stack([motor_speed, drag]), axis=1, return_inverse=True)
    w_m, drag = pairs
    low, high = np.zeros_like(w_m), np.ones_like(w_m)
    for _ in range(53):  # bits of a float64
        nu = 0.5 * (low + high)
        faster = w_m * capacity(nu) > drag * nu
        low, high = np.where(faster, nu, low), np.where(faster, high, nu)
    return np.asarray((w_m * 0.5 * (low + high))[inverse.reshape(-1)])
