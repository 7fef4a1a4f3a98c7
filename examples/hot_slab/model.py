"""The front face of a slab that is heated: temperature after a time of constant heat flux."""

import numpy as np

START = 25.0  # deg C
TERMS = np.arange(1, 13)


def reading(flux, thickness, time, fire, conductivity, capacity, lag, strength):
    """The temperature in deg C that a thermocouple on the front face reads.

    Conduction in a slab with an insulated back and a constant flux into its front (Carslaw and
    Jaeger, Conduction of Heat in Solids, 2nd ed. 1959, sec. 3.8). `flux` in W/m2, `thickness` in m,
    `time` in s, `conductivity` in W/(m K), `capacity` in J/(m3 K). On the test bench (fire = 0) the
    thermocouple reads a rise that is smaller by the share `lag`. In a fire (fire = 1) the true
    temperature is asked for, and the flux is `strength` times the nominal one.
    """
    heat = flux * np.where(fire == 1, strength, 1.0)
    passed = conductivity * time / (capacity * thickness**2)
    series = sum(np.exp(-((n * np.pi) ** 2) * passed) / n**2 for n in TERMS)
    rise = heat * thickness / conductivity * (passed + 1.0 / 3.0 - 2.0 / np.pi**2 * series)
    return START + rise * np.where(fire == 1, 1.0, 1.0 - lag)
