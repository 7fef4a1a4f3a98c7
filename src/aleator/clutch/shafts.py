"""Shafts: one step of Runge-Kutta of order 4 on the two speeds, for all runs of a block at once.

State: w = w_1 and v = R w_2, so that the slip is w - v. With q = T_c / J_1 the asynchronous phase
of the paper reads

    w' = T_1 / J_1 - q,        v' = (R^2 J_1 / J_2) q - R T_b0 / J_2 - (b / J_2) v.

The paper is silent on a load that its brake holds. Here v stays 0 until R T_c exceeds T_b0.
"""

from __future__ import annotations

import numpy as np

from aleator.clutch.converter import capacity_table
from aleator.clutch.plates import Constants
from aleator.types import Array

FADE_SPEED = 25.0  #: rad/s, slip over which a fade of the friction dies out, virtual bench only (i)


class Stepper:
    """Integrates the runs of `Constants` with one step size [s], scalar or (R,).

    It owns the arrays that every step overwrites. A state is an array (2, R) of w and v in cells;
    a rate is its derivative times the step.
    """

    def __init__(self, c: Constants, step: Array | float) -> None:
        size = len(c.run)
        self._torque = c.torque * step
        self._hold = c.hold * step
        self._spread = _shared(c.spread)
        self._viscous = _shared(c.viscous) * step
        self._fade = (c.fade, -1.0 / (c.cell * FADE_SPEED)) if c.fade.any() else None
        self._table = capacity_table()
        self._index = np.empty(size, dtype=np.intp)
        self._cells = np.empty(size, dtype=np.complex128)
        self._slip, self._whole = np.empty((2, size))
        self._at, self._rate, self._sum = np.empty((3, 2, size))

    def rate(self, state: Array, push: Array, drag: Array, out: Array) -> Array:
        """Write the rate of `state`, the load taken as moving, to `out` and return it."""
        (w, v), (dw, dv) = state, out
        q, whole = self._slip, self._whole
        np.subtract(w, v, out=q)
        if self._fade is not None:
            amount, decay = self._fade
            push = push * (1.0 - amount * np.exp(q * decay))
        np.multiply(q, drag, out=q)
        np.add(q, push, out=q)
        # T_1: linear between the nodes of the table, one cell of it being the unit of w
        np.trunc(w, out=whole)
        np.copyto(self._index, whole, casting="unsafe")
        self._table.take(self._index, out=self._cells, mode="clip")
        np.subtract(w, whole, out=dw)
        np.multiply(dw, self._cells.imag, out=dw)
        np.add(dw, self._cells.real, out=dw)
        np.multiply(dw, self._torque, out=dw)
        np.subtract(dw, q, out=dw)
        np.multiply(q, self._spread, out=dv)
        np.subtract(dv, self._hold, out=dv)
        np.multiply(v, self._viscous, out=q)
        np.subtract(dv, q, out=dv)
        return out

    def may_rest(self, state: Array, steps: int) -> bool:
        """Tell whether a load rests, or could come to rest under its brake within `steps` steps."""
        v = state[1]
        return bool(np.any(v <= steps * (self._hold + self._viscous * v)))

    def step(self, state: Array, push: Array, drag: Array, braked: bool, out: Array) -> None:
        """Write the state one step later to `out`; `push` and `drag` have the step's 3 instants.

        `braked` tells that some load may rest: only then is the brake's stiction looked at.
        """
        at, rate, total = self._at, self._rate, self._sum
        self.rate(state, push[0], drag[0], total)
        start = _hold(total[1], state[1]) if braked else None
        np.multiply(total, 0.5, out=at)
        np.add(at, state, out=at)
        for middle in (1, 2):
            self.rate(at, push[1], drag[1], rate)
            if braked:
                _hold(rate[1], at[1])
            if middle == 1:
                np.multiply(rate, 0.5, out=at)
                np.add(at, state, out=at)
            else:
                np.add(rate, state, out=at)
            np.multiply(rate, 2.0, out=rate)
            np.add(total, rate, out=total)
        self.rate(at, push[2], drag[2], rate)
        end = _hold(rate[1], at[1]) if braked else None
        np.add(total, rate, out=total)
        np.multiply(total, 1.0 / 6.0, out=total)
        np.add(state, total, out=out)
        if start is not None and end is not None:
            _release(state[1], start, end, out[1])


def _shared(values: Array) -> Array | float:
    """One number where all are the same: faster to multiply by."""
    return float(values[0]) if values.size and np.all(values == values[0]) else values


def _hold(rate: Array, v: Array) -> Array:
    """Keep the load from turning backward, in place; return a copy of the rate before that."""
    free = rate.copy()
    np.maximum(rate, -v, out=rate)
    return free


def _release(v: Array, start: Array, end: Array, new_v: Array) -> None:
    """Correct the new speed of loads that left their rest during the step, in place.

    Driving torque minus brake goes from `start` < 0 to `end` > 0 and accelerates the load from its
    zero on. The integral of the positive part, exact for a linear course, is what the load gains;
    Runge-Kutta misses it by a term of order h^2.
    """
    np.maximum(new_v, 0.0, out=new_v)
    (run,) = np.nonzero((v <= 0.0) & (start < 0.0) & (end > 0.0))
    new_v[run] = 0.5 * end[run] ** 2 / (end[run] - start[run])
