"""Runs: checked conditions and parameters of R simulations, one array per quantity."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aleator.clutch.current import offsets
from aleator.clutch.parameters import CLUTCH
from aleator.errors import SimulatorError
from aleator.types import Array

#: Deviations from the model's parameters, and the bench's from the model, where nobody says: none.
_AS_MODELED = {
    "frequency_factor": 1.0,
    "drag_factor": 1.0,
    "friction_factor": 1.0,
    "brake_factor": 1.0,
    "inertia_factor": 1.0,
    "viscous_factor": 1.0,
    "delay": 0.0,
    "fade": 0.0,
}


@dataclass(frozen=True)
class Runs:
    """R runs; every field has shape (R,).

    `delay` and `fade` are deviations that only the virtual test bench has.
    """

    pulse_duration: Array  #: s, Delta t
    hold_current: Array  #: A, u_0
    pulse_current: Array  #: A, Delta u
    motor_speed: Array  #: rad/s, w_m
    brake_torque: Array  #: N m, T_b0
    c2_scale: Array  #: -, x_1
    zp_scale: Array  #: -, x_2
    frequency_factor: Array  #: -, on the natural frequency of the hydraulics
    drag_factor: Array  #: -, on gamma
    friction_factor: Array  #: -, on alpha
    brake_factor: Array  #: -, on T_b0; the brake torque includes it
    inertia_factor: Array  #: -, on J_2
    viscous_factor: Array  #: -, on b
    delay: Array  #: s, of the valve
    fade: Array  #: -, F = alpha (1 - fade exp(-slip / FADE_SPEED)) ...

    def take(self, index: NDArray[np.intp]) -> Runs:
        """Return the runs at `index`."""
        return Runs(*(values[index] for values in vars(self).values()))


def make_runs(**given: ArrayLike) -> Runs:
    """Return checked runs from the fields of `Runs`, broadcast; `motor_speed` is in rpm here.

    Raises SimulatorError for arguments that do not fit together or that no test bench could run.
    """
    names = [field.name for field in fields(Runs)]
    quantities = {**_AS_MODELED, **given}
    try:
        arrays = [np.asarray(quantities[name], dtype=np.float64) for name in names]
        broadcast = [np.atleast_1d(array) for array in np.broadcast_arrays(*arrays)]
    except (TypeError, ValueError) as error:
        raise SimulatorError(
            f"the arguments of the clutch do not fit together: {error}",
            "give numbers, or one-dimensional arrays of one length",
        ) from error
    if broadcast[0].ndim != 1:
        raise SimulatorError(
            f"the arguments of the clutch have {broadcast[0].ndim} dimensions",
            "give numbers, or one-dimensional arrays of one length",
        )
    runs = Runs(*broadcast)
    _check(runs)
    return replace(
        runs,
        motor_speed=runs.motor_speed * np.pi / 30.0,
        brake_torque=runs.brake_torque * runs.brake_factor,
    )


def _check(runs: Runs) -> None:
    """Raise SimulatorError for conditions that no test bench could run."""
    current = CLUTCH.current
    last = current.end - float(offsets()[-1])
    duration = runs.pulse_duration
    possible = (duration > current.flank) & (duration <= last)
    expected = f"use more than {current.flank:g} and at most {last:g} s"
    _require("pulse_duration", duration, possible, expected)
    for name in ("hold_current", "pulse_current"):
        values = getattr(runs, name)
        _require(name, values, (values >= 0.0) & (values < np.inf), "use a current >= 0 A")
    for name, unit in (("motor_speed", "rpm"), ("brake_torque", "N m")):
        values = getattr(runs, name)
        _require(name, values, (values > 0.0) & (values < np.inf), f"use a value > 0 {unit}")
    for name in [name for name in _AS_MODELED if name.endswith("_factor")]:
        values = getattr(runs, name)
        _require(name, values, (values > 0.0) & (values < np.inf), "use a scale > 0, about 1")


def _require(name: str, values: Array, good: NDArray[np.bool_], remedy: str) -> None:
    if not np.all(good):
        run = int(np.argmin(good))
        raise SimulatorError(f"run {run}: {name} = {values[run]:g} is not admissible", remedy)
