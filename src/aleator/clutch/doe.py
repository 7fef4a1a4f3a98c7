"""The design of experiments: 108 experiments, a full factorial of five conditions."""

from __future__ import annotations

import numpy as np
import pandas as pd

from aleator.clutch.parameters import CLUTCH


def design() -> pd.DataFrame:
    """Return the 108 experiments of the benchmark, one a row.

    Three filling pulses, three hold currents, two pulse currents, three motor speeds and two brake
    torques, as in the paper's section on the design of experiments. The paper gives the number of
    levels and the motor speeds; the other levels were invented.

    Returns
    -------
    DataFrame
        `id` (1 to 108) and the conditions `pulse_duration` [s], `hold_current` [A],
        `pulse_current` [A], `motor_speed` [rpm], `brake_torque` [N m]. The brake torque varies
        fastest, then hold current, filling pulse, pulse current and motor speed.

    Examples
    --------
    >>> design().set_index("id").loc[16].to_dict()  # doctest: +NORMALIZE_WHITESPACE
    {'pulse_duration': 0.11, 'hold_current': 0.26, 'pulse_current': 0.07,
     'motor_speed': 1200.0, 'brake_torque': 80.0}
    """
    levels = CLUTCH.levels
    slow_to_fast = ("motor_speed", "pulse_current", "pulse_duration", "hold_current")
    names = [*slow_to_fast, "brake_torque"]
    grids = np.meshgrid(*(getattr(levels, name) for name in names), indexing="ij")
    columns = {name: grid.ravel() for name, grid in zip(names, grids, strict=True)}
    table = pd.DataFrame(columns)[list(vars(levels))]
    table.insert(0, "id", np.arange(1, len(table) + 1))
    return table
