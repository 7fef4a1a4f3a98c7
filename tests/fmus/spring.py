"""A linear spring as an FMU; it breaks when stiff, gives up when stiffer, and can fall asleep."""

import time

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Spring(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.force, self.stiffness, self.nap, self.travel = 1.0, 2.0, 0.0, 0.0
        for name in ("force", "stiffness", "nap"):
            fixed = Fmi2Variability.fixed
            self.register_variable(Real(name, causality=Fmi2Causality.parameter, variability=fixed))
        self.register_variable(Real("travel", causality=Fmi2Causality.output))

    def do_step(self, _time, _step):
        time.sleep(self.nap)
        if self.stiffness > 1000.0:
            raise ValueError(f"the spring broke at {self.stiffness:g} N/mm")
        if self.stiffness > 100.0:
            self.log("the spring gives up")
            return False
        self.travel = self.force / self.stiffness
        return True
