"""Every number of the wet clutch, with its unit and where it comes from.

The mark (i) means *invented*: the paper gives the structure of the model, but neither its
measurements nor these parameters. Invented values were tuned together, so that the model behaves as
the paper describes: all 108 experiments synchronize, in 0.55 to 1.29 s at nominal, every factor has
a clear effect, and one experiment (number 16) has an outcome with two modes.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Current:
    """Timing and levels of the feed-forward current that three control parameters do not set."""

    flank: float = 0.010  #: s, every 'vertical' flank of the paper's figure (i)
    idle: float = 0.10  #: A, before the engagement (i)
    high: float = 0.65  #: A, during the filling pulse and after the engagement (i)
    hold_end: float = 0.30  #: s after the filling pulse, start of the second pulse (i)
    pulse: float = 0.11  #: s, length of the second pulse (i)
    fall: float = 0.27  #: s, length of the downward flank (i)
    fall_fraction: float = 0.30  #: -, part of the second pulse that is left after the flank (i)
    rise: float = 1.10  #: s, length of the final ramp to `high` (i)
    end: float = 5.0  #: s, a run that has not synchronized by then has failed (i)


@dataclass(frozen=True)
class Hydraulics:
    """Valve, hydraulic chamber and piston: the affine system of the paper's eq. pressureDyn."""

    natural_frequency: float = 14.0  #: rad/s, a1 = -196 1/s^2 (i)
    damping: float = 0.95  #: -, a2 = -26.6 1/s (i)
    gain: float = 20e5  #: Pa/A, static gain, b1 = 3.92e8 Pa/(A s^2) (i)
    zero_time: float = 0.010  #: s, b2 / b1, b2 = 3.92e6 Pa/(A s) (i)
    dead_current: float = 0.10  #: A, no pressure below it, c1 = -3.92e7 Pa/s^2 (i)
    a3: float = 3.2e-8  #: m/(Pa s), filling rate of the piston (i)
    a4: float = 3.0e-11  #: m/Pa (i)
    a5: float = -5.6  #: 1/s, return spring against flow (i)
    c2: float = -2.56e-3  #: m/s, oil pressure bias, scaled by x1; -c2/a3 = 0.8 bar of preload (i)


@dataclass(frozen=True)
class Plates:
    """The two series of friction plates."""

    z_max: float = 2.0e-3  #: m, z_M, full contact: 6 gaps of 0.33 mm (i)
    z_contact: float = 1.32e-3  #: m, z_p, first contact, scaled by x2 (i)
    alpha: float = 4.0e-4  #: N m/Pa, friction torque per plate pressure, N mu A_p R_m (i)
    gamma: float = 1.0e-4  #: N m^2 s/rad, Couette drag, N^2 (pi/2) mu_oil (r2^4 - r1^4) (i)


@dataclass(frozen=True)
class Shafts:
    """Input shaft 1, output shaft 2 with its flywheel, and the gear between clutch and output."""

    inertia_1: float = 0.30  #: kg m^2 (i)
    inertia_2: float = 2.70  #: kg m^2, flywheel 2.5 (paper) + 0.2 (i)
    ratio: float = 2.0  #: -, R = w_in / w_out (i)
    viscous: float = 0.20  #: N m s/rad, b of T_b = T_b0 + b w_2 (i)


@dataclass(frozen=True)
class Converter:
    """Torque ratio f_t and K-factor of the torque converter over the speed ratio nu = w_1 / w_m.

    The nodes are those of the automatic-transmission demonstration of MathWorks as public
    repositories reproduce them, with f_t(0.9) = 0.999 rounded to 1; the node nu = 1, where no
    torque is left, is (i).
    """

    speed_ratio: tuple[float, ...] = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)  #: -
    torque_ratio: tuple[float, ...] = (
        *(2.232, 2.075, 1.975, 1.846, 1.720, 1.564),
        *(1.409, 1.254, 1.096, 1.000, 1.000),
    )  #: -
    k_factor: tuple[float, ...] = (
        *(137.47, 137.07, 135.86, 135.66, 137.57, 140.37),
        *(145.27, 152.87, 162.98, 197.69, float("inf")),
    )  #: rpm/sqrt(N m), f_c = K pi / 30


@dataclass(frozen=True)
class Levels:
    """Levels of the full factorial design; the paper gives their number and the motor speeds."""

    pulse_duration: tuple[float, ...] = (0.070, 0.090, 0.110)  #: s, Delta t (i)
    hold_current: tuple[float, ...] = (0.248, 0.260, 0.272)  #: A, u_0 (i)
    pulse_current: tuple[float, ...] = (0.070, 0.135)  #: A, Delta u (i)
    motor_speed: tuple[float, ...] = (1200.0, 1350.0, 1500.0)  #: rpm (paper)
    brake_torque: tuple[float, ...] = (20.0, 80.0)  #: N m, T_b0 low and high (i)


@dataclass(frozen=True)
class Clutch:
    """All parameters of the model."""

    current: Current = field(default_factory=Current)
    hydraulics: Hydraulics = field(default_factory=Hydraulics)
    plates: Plates = field(default_factory=Plates)
    shafts: Shafts = field(default_factory=Shafts)
    converter: Converter = field(default_factory=Converter)
    levels: Levels = field(default_factory=Levels)


CLUTCH = Clutch()
