"""A mass rings down on a rubber mount: an oscillator with a cubic spring, solved by diffrax."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)
MASS = 2.0  # kg


def rates(_time, state, mount):
    place, speed = state
    stiffness, damping, hardening = mount
    force = stiffness * place + 1e6 * hardening * place**3 + damping * speed
    return jnp.array([speed, -force / MASS])


def places(mount, times, start):
    """Place of the mass (mm) at the times (s) after it was let go at `start` (mm)."""
    found = diffrax.diffeqsolve(
        diffrax.ODETerm(rates), diffrax.Tsit5(), t0=0.0, t1=times[-1], dt0=None,
        y0=jnp.array([1e-3 * start, 0.0]), args=mount, saveat=diffrax.SaveAt(ts=times),
        stepsize_controller=diffrax.PIDController(rtol=1e-8, atol=1e-10),
        adjoint=diffrax.ForwardMode(),
    )  # fmt: skip
    return 1e3 * found.ys[:, 0]


both = jax.jit(lambda *all: (places(*all), jax.jacfwd(places)(*all)))


def place(time, start, stiffness, damping, hardening):
    """The curve of one mount and its derivatives: stiffness in N/m, damping in N s/m,
    hardening in N/m per mm2.
    """
    values, slopes = both(jnp.array([stiffness, damping, hardening]), jnp.asarray(time), start)
    return np.asarray(values), np.asarray(slopes)
