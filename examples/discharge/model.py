"""Discharge of a lithium-ion cell: the single particle model with electrolyte of PyBaMM."""

import pybamm

CURRENT = "Current function [A]"
DIFFUSIVITY = "Negative particle diffusivity [m2.s-1]"
CONTACT = "Contact resistance [Ohm]"

cell = pybamm.lithium_ion.SPMe({"contact resistance": "true"})
values = pybamm.ParameterValues("Chen2020")  # of a 21700 cell of 5 A h
values.update(dict.fromkeys((CURRENT, DIFFUSIVITY, CONTACT), "[input]"))
simulation = pybamm.Simulation(cell, parameter_values=values)


def capacity(current, contact, diffusivity):
    """Charge in A h until the voltage is down to 2.5 V, from a full cell at 25 degC.

    `contact` is the resistance of tabs and welds in mOhm, `diffusivity` that of lithium in graphite
    in 1e-14 m2/s.
    """
    inputs = {CURRENT: current, CONTACT: 1e-3 * contact, DIFFUSIVITY: 1e-14 * diffusivity}
    found = simulation.solve([0.0, 2.0 * 3600.0 * 5.0 / current], inputs=inputs)
    return float(found["Discharge capacity [A.h]"].entries[-1])
