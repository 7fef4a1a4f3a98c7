"""A bouncing ball as an FMU: height and speed are states, whose start values are exact."""

from math import sqrt

from pythonfmu import Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Real


class Ball(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.h, self.v, self.g, self.e = 1.0, 0.0, 9.81, 0.7
        for name in ("h", "v"):
            state = {"causality": Fmi2Causality.output, "initial": Fmi2Initial.exact}
            self.register_variable(Real(name, **state))
        for name in ("g", "e"):
            fixed = Fmi2Variability.fixed
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=fixed))

    def do_step(self, _time, step):
        landing = (self.v + sqrt(self.v**2 + 2.0 * self.g * self.h)) / self.g
        while landing < step:
            step -= landing
            self.h, self.v = 0.0, self.e * (self.g * landing - self.v)
            landing = 2.0 * self.v / self.g
        self.h += self.v * step - self.g * step**2 / 2.0
        self.v -= self.g * step
        return True
