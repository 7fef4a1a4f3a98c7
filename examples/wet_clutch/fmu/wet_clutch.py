"""The wet clutch as an FMU: `pythonfmu build -f wet_clutch.py` makes WetClutch.fmu.

The asynchronous phase of the model in aleator.clutch, with the numbers of its parameters.py, but
integrated another way: all five states together by Runge-Kutta of order 4, where aleator.clutch
propagates the hydraulics exactly. The phase ends where the slip is zero; beyond that the slip is
negative and means nothing. The process that runs the FMU must be able to import aleator.
"""

import math
from bisect import bisect_right

import numpy as np
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

from aleator.clutch.converter import capacity
from aleator.clutch.current import breakpoints
from aleator.clutch.parameters import CLUTCH

LONGEST = 0.0025  # s, of an internal step
CELLS = 2000
TABLE = capacity(np.linspace(0.0, 1.0, CELLS + 1)).tolist()

PARAMETERS = {
    "pulse_duration": (0.110, "length of the filling pulse [s]"),
    "hold_current": (0.260, "current after the pulse [A]"),
    "pulse_current": (0.070, "height of the second pulse [A]"),
    "motor_speed": (1200.0, "speed of the motor [rpm]"),
    "brake_torque": (80.0, "constant brake torque [N m]"),
    "c2_scale": (1.0, "scale of the oil pressure bias [-]"),
    "zp_scale": (1.0, "scale of the contact position [-]"),
}


class WetClutch(Fmi2Slave):
    description = "From the start of the current to equal speeds of both shafts"
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=1.6, step_size=0.01)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name, (start, text) in PARAMETERS.items():
            setattr(self, name, start)
            self.register_variable(
                Real(
                    name,
                    causality=Fmi2Causality.parameter,
                    variability=Fmi2Variability.fixed,
                    description=text,
                )
            )
        self.input_speed = self.output_speed = self.slip = 0.0
        for name in ("input_speed", "output_speed", "slip"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def exit_initialization_mode(self):
        plates = CLUTCH.plates
        times, levels = breakpoints(
            *np.array([[self.pulse_duration], [self.hold_current], [self.pulse_current]])
        )
        self.times, self.levels = times[:, 0].tolist(), levels[:, 0].tolist()
        self.w_m = self.motor_speed * math.pi / 30.0
        self.contact = plates.z_contact * self.zp_scale
        # pressure, its rate, piston, both speeds; at rest but for the idling input shaft
        self.state = [0.0, 0.0, 0.0, self.idle_speed(plates.gamma / plates.z_max), 0.0]
        self.show()

    def do_step(self, current_time, step_size):
        end = current_time + step_size
        inside = [t for t in self.times if current_time + 1e-9 < t < end - 1e-9]
        # No step across a kink of the current: there Runge-Kutta would lose its order.
        for a, b in zip([current_time, *inside], [*inside, end], strict=True):
            steps = math.ceil((b - a) / LONGEST - 1e-9)
            for k in range(steps):
                self.runge_kutta(a + k * (b - a) / steps, (b - a) / steps)
        self.show()
        return True

    def runge_kutta(self, t, h):
        y = self.state
        u, slope = self.current(t + 0.5 * h)
        before, after = u - 0.5 * h * slope, u + 0.5 * h * slope
        k1 = self.rates(y, before, slope)
        k2 = self.rates([a + 0.5 * h * b for a, b in zip(y, k1, strict=True)], u, slope)
        k3 = self.rates([a + 0.5 * h * b for a, b in zip(y, k2, strict=True)], u, slope)
        k4 = self.rates([a + h * b for a, b in zip(y, k3, strict=True)], after, slope)
        self.state = [
            a + h / 6.0 * (b + 2.0 * c + 2.0 * d + e)
            for a, b, c, d, e in zip(y, k1, k2, k3, k4, strict=True)
        ]
        self.state[4] = max(self.state[4], 0.0)

    def current(self, t):
        """The current [A] and its slope [A/s]."""
        k = bisect_right(self.times, t) - 1
        if k >= len(self.times) - 1:
            return self.levels[-1], 0.0
        slope = (self.levels[k + 1] - self.levels[k]) / (self.times[k + 1] - self.times[k])
        return self.levels[k] + slope * (t - self.times[k]), slope

    def rates(self, y, u, slope):
        h, shafts = CLUTCH.hydraulics, CLUTCH.shafts
        p, dp, z, w_1, w_2 = y
        omega2 = h.natural_frequency**2
        ddp = omega2 * (h.gain * (u + h.zero_time * slope - h.dead_current) - p)
        ddp -= 2.0 * h.damping * h.natural_frequency * dp
        dz = h.a3 * p + h.a4 * dp + h.a5 * z + h.c2 * self.c2_scale
        clutch = self.clutch_torque(p, z, w_1 - shafts.ratio * w_2)
        brake = self.brake_torque + shafts.viscous * w_2
        dw_1 = (self.w_m**2 * self.capacity(w_1 / self.w_m) - clutch) / shafts.inertia_1
        dw_2 = (shafts.ratio * clutch - brake) / shafts.inertia_2
        return dp, ddp, dz, dw_1, max(dw_2, 0.0) if w_2 <= 0.0 else dw_2

    def clutch_torque(self, p, z, slip):
        plates = CLUTCH.plates
        z = max(z, 0.0)  # the piston's free motion goes on below the stop
        sigma = min((z - self.contact) / (plates.z_max - self.contact), 1.0)
        if sigma <= 0.0:
            return plates.gamma / (plates.z_max - z) * slip
        delta = sigma**2 * (3.0 - 2.0 * sigma)
        drag = (1.0 - sigma) * (1.0 + 2.0 * sigma) / (plates.z_max - self.contact)
        return delta * plates.alpha * sigma * max(p, 0.0) + plates.gamma * drag * slip

    def capacity(self, nu):
        cell = min(max(nu, 0.0), 1.0) * CELLS
        k = min(int(cell), CELLS - 1)
        return TABLE[k] + (cell - k) * (TABLE[k + 1] - TABLE[k])

    def idle_speed(self, drag):
        low, high = 0.0, 1.0
        for _ in range(53):
            nu = 0.5 * (low + high)
            faster = self.w_m * self.capacity(nu) > drag * nu
            low, high = (nu, high) if faster else (low, nu)
        return self.w_m * low

    def show(self):
        self.input_speed, self.output_speed = self.state[3:]
        self.slip = self.input_speed - CLUTCH.shafts.ratio * self.output_speed
