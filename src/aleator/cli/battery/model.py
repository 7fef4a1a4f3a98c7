"""Capacity of a battery cell that is cycled: it fades with the root of the cycles."""

import numpy as np

GAS = 8.314  # J/(mol K)
REFERENCE = 298.15  # K


def capacity(cycles, temperature, fade, activation):
    """Percent of the first capacity after so many cycles at a temperature in degC.

    `fade` is the loss in percent over the root of the cycles at 25 degC; `activation` (kJ/mol) says
    how much faster a warm cell fades.
    """
    kelvin = temperature + 273.15
    faster = np.exp(1e3 * activation / GAS * (1.0 / REFERENCE - 1.0 / kelvin))
    return 100.0 - fade * faster * np.sqrt(cycles)
