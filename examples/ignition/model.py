"""Ignition of hydrogen behind a reflected shock: a reactor of constant volume of Cantera."""

import cantera as ct
import numpy as np

gas = ct.Solution("h2o2.yaml")
BRANCHING = [reaction.equation for reaction in gas.reactions()].index("H + O2 <=> O + OH")
RISE = 400.0  # K


def delay(temperature, off, branching):
    """Microseconds until the gas is 400 K hotter, from 1 atm of 2 H2 + O2 + 12 Ar.

    The shot was to have the `temperature` (K) and has `off` (K) more. `branching` multiplies the
    rate of H + O2 = O + OH.
    """
    gas.set_multiplier(branching, BRANCHING)
    start = temperature + off
    gas.TPX = start, ct.one_atm, "H2:2, O2:1, AR:12"
    reactor = ct.IdealGasReactor(gas, clone=False)
    network = ct.ReactorNet([reactor])
    network.rtol, network.atol = 1e-10, 1e-18
    before = after = (0.0, start)
    while after[1] < start + RISE:
        network.step()
        before, after = after, (network.time, reactor.T)
    return 1e6 * np.interp(start + RISE, (before[1], after[1]), (before[0], after[0]))
