"""The wet clutch as an FMU. It is made, in this folder, by

    PYTHONPATH=../command pythonfmu build -f wet_clutch.py ../command/clutch.py

The equations are those of the program in ../command, which comes along inside the FMU; nothing of
Aleator does. The asynchronous phase ends where the slip is zero, between two communication points.
A few more follow for the interpolation, then time goes on and nothing moves any more.
"""

from clutch import RATIO, Engagement
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

BEYOND = 3  # communication points after the shafts have met

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
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=1.6, step_size=0.005)

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
        self.engagement = Engagement(**{name: getattr(self, name) for name in PARAMETERS})
        self.beyond = 0
        self.show()

    def do_step(self, current_time, step_size):
        if self.beyond < BEYOND:
            self.engagement.advance(current_time + step_size)
            self.show()
            self.beyond += self.slip < 0.0
        return True

    def show(self):
        self.input_speed, self.output_speed = self.engagement.state[3:]
        self.slip = self.input_speed - RATIO * self.output_speed
