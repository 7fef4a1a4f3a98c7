"""Shafts and plates: Runge-Kutta of order 4 on the two speeds, vectorized over runs.

State: w_1 and v = R w_2, so that the slip is w_1 - v. With q = T_c / J_1,

    w_1' = T_1 / J_1 - q,        v' = (R^2 J_1 / J_2) q - R T_b0 / J_2 - (b / J_2) v,

where the torque of the clutch is affine in the slip, T_c = F + G slip, and F, G follow from pressure and
piston alone. The load rests (v = 0) while the brake holds it. Speeds are counted in cells of the torque
converter's table (w_m = CELLS cells), and all rates are multiplied by the step: the innermost loop then
has no scaling left to do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aleator.clutch.converter import CELLS, capacity_table
from aleator.clutch.hydraulics import Window
from aleator.clutch.parameters import CLUTCH
from aleator.clutch.runs import Runs

Array = NDArray[np.float64]
Index = NDArray[np.intp]

FADE_SPEED = (
    25.0  #: rad/s, slip over which the fade of the friction dies out; virtual bench only (i)
)
_SHAFTS = CLUTCH.shafts
SPREAD = _SHAFTS.ratio**2 * _SHAFTS.inertia_1 / _SHAFTS.inertia_2  #: -, R^2 J_1 / J_2
VISCOUS = _SHAFTS.viscous / _SHAFTS.inertia_2  #: 1/s, b / J_2


@dataclass(frozen=True)
class Constants:
    """What stays the same during a run, shape (R,); speeds in cells, see the module."""

    run: Index  #: position among all runs
    signal: Index  #: position among the signals
    cell: Array  #: cells s/rad
    torque: Array  #: w_m^2 / J_1, cells / s per unit of f
    hold: Array  #: R T_b0 / J_2, cells / s
    friction: Array  #: alpha / J_1, cells / (s Pa)
    drag: Array  #: gamma / (J_1 (z_M - x_2 z_p)), 1 / s
    slope: Array  #: 1 / (z_M - x_2 z_p), 1 / m
    contact: Array  #: x_2 z_p / (z_M - x_2 z_p), -
    bias: Array  #: x_1 c_2 / a_5 / (z_M - x_2 z_p), -
    fade: Array  #: -

    def take(self, keep: NDArray[np.bool_]) -> Constants:
        """Return the constants of the runs to keep."""
        return Constants(*(values[keep] for values in vars(self).values()))


def constants(runs: Runs, signal: Index, run: Index) -> Constants:
    """Return the constants of `runs`, whose currents are numbered by `signal`."""
    plates, hydraulics = CLUTCH.plates, CLUTCH.hydraulics
    cell = CELLS / runs.motor_speed
    contact = plates.z_contact * runs.zp_scale
    slope = 1.0 / (plates.z_max - contact)
    return Constants(
        run=run,
        signal=signal,
        cell=cell,
        torque=runs.motor_speed**2 / _SHAFTS.inertia_1 * cell,
        hold=_SHAFTS.ratio * runs.brake_torque / _SHAFTS.inertia_2 * cell,
        friction=plates.alpha * runs.friction_factor / _SHAFTS.inertia_1 * cell,
        drag=plates.gamma * runs.drag_factor / _SHAFTS.inertia_1 * slope,
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
    # z~ = z_A + x_1 z_B with z_B = (c_2 / a_5) (exp(a_5 t) - 1), see hydraulics.bias_response
    amplitude = c.bias * np.exp(a5 * window.start).take(c.signal)
    sigma: Array = window.piston.take(c.signal, axis=1)
    sigma *= c.slope
    sigma += decay * amplitude
    sigma -= c.bias + c.contact
    np.maximum(sigma, -c.contact, out=sigma)
    _clip_above(sigma)
    return sigma


def _clip_above(sigma: Array) -> None:
    """Clip sigma to 1 in place, so that Simpson's rule stays exact where it meets the end of travel.

    Runge-Kutta weighs the values of a step by 1, 4, 1. For a ramp that is cut off at 1 inside the step
    this misses the integral by a term of order h^2, which would dominate all other errors. The value in
    the middle is corrected for it.
    """
    excess = sigma[::2] - 1.0
    np.minimum(sigma, 1.0, out=sigma)
    left, right = excess[:-1], excess[1:]
    step, run = np.nonzero((left > 0) != (right > 0))
    if len(step) == 0:
        return
    left, right = left[step, run], right[step, run]
    high, low = np.maximum(left, right), np.minimum(left, right)
    integral = 0.5 * high**2 / (high - low)
    simpson = (high + 4 * np.maximum(0.5 * (high + low), 0.0)) / 6
    sigma[2 * step + 1, run] -= 1.5 * (integral - simpson)


def increments(c: Constants, window: Window, step: Array | float) -> tuple[Array, Array]:
    """Return h F / J_1 [cells] and h G / J_1 [-] at the instants of a window, (2 n + 1, R).

    With delta = 3 sigma^2 - 2 sigma^3 for 0 < sigma < 1, the quotient (1 - delta) / (z_M - z) is
    (1 - sigma)(1 + 2 sigma) / (z_M - x_2 z_p), which is finite at z = z_M.
    """
    sigma = positions(c, window)
    closed = np.maximum(sigma, 0.0)
    push = closed * -2.0
    push += 3.0
    drag = closed * -2.0
    drag += 1.0
    drag *= closed
    drag += 1.0
    for _ in range(3):
        push *= closed
    push *= np.maximum(window.pressure, 0.0).take(c.signal, axis=1)
    push *= c.friction * step
    np.minimum(sigma, 0.0, out=sigma)
    np.subtract(1.0, sigma, out=sigma)
    drag /= sigma
    drag *= c.drag * step
    return push, drag


class Stepper:
    """One Runge-Kutta step for all runs of a block; owns the scratch arrays of a window."""

    def __init__(self, c: Constants, step: Array | float) -> None:
        size = len(c.run)
        self._torque = c.torque * step
        self._hold = c.hold * step
        self._viscous = VISCOUS * step
        self._fade = (c.fade, -1.0 / (c.cell * FADE_SPEED)) if c.fade.any() else None
        self._table = capacity_table()
        self._index = np.empty(size, dtype=np.intp)
        self._cells = np.empty(size, dtype=np.complex128)
        self._scratch = np.empty((8, size))

    def rate(self, w: Array, v: Array, push: Array, drag: Array, dw: Array, dv: Array) -> None:
        """Write the increments h w_1' and h v' of a load that moves to `dw` and `dv`."""
        q, x = self._scratch[:2]
        np.subtract(w, v, out=q)
        if self._fade is not None:
            amount, decay = self._fade
            push = push * (1.0 - amount * np.exp(q * decay))
        np.multiply(q, drag, out=q)
        np.add(q, push, out=q)
        np.trunc(w, out=x)
        np.copyto(self._index, x, casting="unsafe")
        self._table.take(self._index, out=self._cells, mode="clip")
        np.subtract(w, x, out=dw)
        np.multiply(dw, self._cells.imag, out=dw)
        np.add(dw, self._cells.real, out=dw)
        np.multiply(dw, self._torque, out=dw)
        np.subtract(dw, q, out=dw)
        np.multiply(q, SPREAD, out=dv)
        np.subtract(dv, self._hold, out=dv)
        np.multiply(v, self._viscous, out=x)
        np.subtract(dv, x, out=dv)

    def may_rest(self, v: Array, steps: int) -> bool:
        """Tell whether a load rests, or could come to rest within `steps` steps under its brake."""
        return bool(np.any(v <= steps * (self._hold + self._viscous * v)))

    def step(
        self, w: Array, v: Array, push: Array, drag: Array, braked: bool, new_w: Array, new_v: Array
    ) -> None:
        """Write the speeds one step later to `new_w` and `new_v`; `push`, `drag` have 3 rows."""
        dw, dv, at_w, at_v, sum_w, sum_v = self._scratch[2:]
        self.rate(w, v, push[0], drag[0], sum_w, sum_v)
        if braked:
            start = sum_v.copy()
            np.maximum(sum_v, -v, out=sum_v)
        dw_, dv_ = sum_w, sum_v
        for half in (True, True, False):
            for speed, change, at in ((w, dw_, at_w), (v, dv_, at_v)):
                if half:
                    np.multiply(change, 0.5, out=at)
                    np.add(at, speed, out=at)
                else:
                    np.add(change, speed, out=at)
            row = 1 if half else 2
            self.rate(at_w, at_v, push[row], drag[row], dw, dv)
            if braked:
                end = dv.copy()
                np.maximum(dv, -at_v, out=dv)
            if half:
                np.multiply(dw, 2.0, out=at_w)
                np.multiply(dv, 2.0, out=at_v)
                np.add(sum_w, at_w, out=sum_w)
                np.add(sum_v, at_v, out=sum_v)
            dw_, dv_ = dw, dv
        np.add(sum_w, dw, out=sum_w)
        np.add(sum_v, dv, out=sum_v)
        np.multiply(sum_w, 1 / 6, out=sum_w)
        np.multiply(sum_v, 1 / 6, out=sum_v)
        np.add(w, sum_w, out=new_w)
        np.add(v, sum_v, out=new_v)
        if braked:
            _release(v, start, end, new_v)


def _release(v: Array, start: Array, end: Array, new_v: Array) -> None:
    """Replace the new speed of loads that left their rest during the step, in place.

    The driving torque minus the brake's goes from `start` < 0 to `end` > 0; the load gains speed from the
    zero crossing on. The integral of the positive part is exact for a linear course, where Runge-Kutta
    would be wrong by a term of order h^2.
    """
    np.maximum(new_v, 0.0, out=new_v)
    (run,) = np.nonzero((v <= 0.0) & (start < 0.0) & (end > 0.0))
    if len(run):
        new_v[run] = 0.5 * end[run] ** 2 / (end[run] - start[run])
