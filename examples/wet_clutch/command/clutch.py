"""The wet clutch as a program: `python3 clutch.py pulse_duration=0.11 ...` prints one number.

The asynchronous phase of the model in ../model.py, in plain Python, and integrated another way:
all five states together by the method of Dormand and Prince with steps of their own length, where
model.py propagates the hydraulics exactly and takes equal steps. It knows nothing of Aleator
and imports next to nothing, so that it starts fast. The FMU beside it runs the same equations.

Every number is that of ../model.py, which says where it comes from.
"""

import math
import sys
from bisect import bisect_right
from itertools import pairwise
from operator import mul

# Current of the valve: lengths in s, levels in A.
FLANK, HOLD_END, PULSE, FALL, RISE = 0.010, 0.30, 0.11, 0.27, 1.10
IDLE, HIGH, FALL_FRACTION = 0.10, 0.65, 0.30
END = 5.0
# Valve, chamber and piston, in SI units.
OMEGA, DAMPING, GAIN, ZERO_TIME, DEAD_CURRENT = 14.0, 0.95, 20e5, 0.010, 0.10
A3, A4, A5, C2 = 3.2e-8, 3.0e-11, -5.6, -2.56e-3
# Plates and shafts, in SI units.
Z_MAX, Z_CONTACT, ALPHA, GAMMA = 2.0e-3, 1.32e-3, 4.0e-4, 1.0e-4
INERTIA_1, INERTIA_2, RATIO, VISCOUS = 0.30, 2.70, 2.0, 0.20
# Torque converter at speed ratios 0, 0.1 ... 1: torque ratio, K-factor in rpm/sqrt(N m).
TORQUE_RATIO = (2.232, 2.075, 1.975, 1.846, 1.720, 1.564, 1.409, 1.254, 1.096, 1.000, 1.000)
K_FACTOR = (137.47, 137.07, 135.86, 135.66, 137.57, 140.37, 145.27, 152.87, 162.98, 197.69,
            math.inf)  # fmt: skip

# Dormand and Prince (1980): nodes, stages; of the error only the weights that are not zero.
NODES = (0.2, 0.3, 0.8, 8 / 9, 1.0, 1.0)
STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
SCALES = (1e6, 1e7, 1e-3, 1e2, 1e2)  # of pressure, its rate, piston and both speeds
TOLERANCE = 1e-9  # of a step's error, in these scales
LONGEST, SHORTEST = 0.01, 1e-6  # s, steps


def pchip(values):
    """Coefficients of the cubics between values at 0, 0.1 ... 1, as PchipInterpolator has them."""
    n, h = len(values) - 1, 0.1
    secants = [(b - a) / h for a, b in pairwise(values)]
    slopes = [end_slope(*secants[:2])]
    for a, b in pairwise(secants):
        slopes.append(2.0 * a * b / (a + b) if a * b > 0.0 else 0.0)
    slopes.append(end_slope(*secants[:-3:-1]))
    return [
        (
            values[k],
            slopes[k] * h,
            (3.0 * secants[k] - 2.0 * slopes[k] - slopes[k + 1]) * h,
            (slopes[k] + slopes[k + 1] - 2.0 * secants[k]) * h,
        )
        for k in range(n)
    ]


def end_slope(first, second):
    slope = 1.5 * first - 0.5 * second
    if slope * first <= 0.0:
        return 0.0
    return 3.0 * first if first * second <= 0.0 and abs(slope) > 3.0 * abs(first) else slope


CUBICS = [
    ratio + inverse
    for ratio, inverse in zip(
        pchip(TORQUE_RATIO), pchip([(k * math.pi / 30.0) ** -2.0 for k in K_FACTOR]), strict=True
    )
]


def capacity(nu):
    """Torque of the converter over the square of the motor's speed, at the speed ratio nu."""
    cell = min(max(nu, 0.0), 1.0) * 10.0
    k = min(int(cell), 9)
    s = cell - k
    a, b, c, d, e, f, g, h = CUBICS[k]
    return (a + s * (b + s * (c + s * d))) * (e + s * (f + s * (g + s * h)))


class Engagement:
    """One engagement: `state` at `time`, from the start of the current on.

    The state is pressure, its rate, piston, and the speeds of both shafts. Where the slip has
    become negative the shafts have met before; the equations go on, but mean nothing there.
    """

    def __init__(self, pulse_duration, hold_current, pulse_current, motor_speed, brake_torque,
                 c2_scale=1.0, zp_scale=1.0):  # fmt: skip
        second = pulse_duration + HOLD_END
        falling = second + FLANK + PULSE
        self.knots = [
            *(0.0, FLANK, pulse_duration, pulse_duration + FLANK, second, second + FLANK),
            *(falling, falling + FALL, falling + FALL + RISE),
        ]
        peak, fallen = hold_current + pulse_current, hold_current + FALL_FRACTION * pulse_current
        self.levels = [IDLE, HIGH, HIGH, hold_current, hold_current, peak, peak, fallen, HIGH]
        self.w_m = motor_speed * math.pi / 30.0
        self.brake_torque = brake_torque
        self.bias = C2 * c2_scale
        self.contact = Z_CONTACT * zp_scale
        self.time, self.length = 0.0, 0.001
        # At rest but for the idling input shaft.
        self.state = (0.0, 0.0, 0.0, self.idle_speed(GAMMA / Z_MAX), 0.0)

    @property
    def slip(self):
        return self.state[3] - RATIO * self.state[4]

    def shifting_time(self):
        """The time at which the slip is zero; None if it never is, or only while the load rests."""
        while self.slip > 0.0:
            if self.time >= END:
                return None
            before = self.time, self.state
            self.advance(self.time + LONGEST)
        if self.state[4] <= 0.0:
            return None
        time = self.meeting(*before)
        return time if time <= END else None

    def meeting(self, *before):
        """The time since `before` at which the slip is zero, by the Illinois method."""
        end, after = self.time, self.slip
        self.time, self.state = before
        ahead = self.slip
        while abs(self.slip) > 1e-9 and end - self.time > 1e-12:
            before = self.time, self.state
            self.advance(self.time + (end - self.time) * ahead / (ahead - after))
            if self.slip > 0.0:
                ahead, after = self.slip, 0.5 * after
            else:
                end, after = self.time, self.slip
                self.time, self.state = before
                ahead *= 0.5
        return self.time

    def advance(self, end):
        """Go on to the time `end`; no step crosses a kink of the current."""
        inside = [t for t in self.knots if self.time + 1e-9 < t < end - 1e-9]
        for stop in (*inside, end):
            while stop - self.time > 1e-12:
                rest = stop - self.time
                steps = math.ceil(rest / min(self.length, LONGEST) - 1e-9)
                while not self.take(rest / steps):
                    steps = math.ceil(rest / self.length)
            self.time = stop

    def take(self, length):
        """Make one step and tell whether its error is small enough; a forward one only if it is."""
        u, slope = self.current(self.time + 0.5 * length)
        u -= 0.5 * length * slope
        rates = [self.rates(self.state, u, slope)]
        for node, weights in zip(NODES, STAGES, strict=True):
            at = combined(self.state, length, weights, rates)
            rates.append(self.rates(at, u + node * length * slope, slope))
        errors = combined((0.0,) * 5, length, ERROR, rates)
        error = max(abs(e) / scale for e, scale in zip(errors, SCALES, strict=True)) / TOLERANCE
        self.length = length * min(max(0.9 * (error + 1e-9) ** -0.2, 0.2), 4.0)
        if error > 1.0 and length > SHORTEST:
            return False
        self.time += length
        self.state = (*at[:4], max(at[4], 0.0))
        return True

    def current(self, t):
        """The current [A] and its slope [A/s]."""
        k = bisect_right(self.knots, t) - 1
        if k >= len(self.knots) - 1:
            return self.levels[-1], 0.0
        slope = (self.levels[k + 1] - self.levels[k]) / (self.knots[k + 1] - self.knots[k])
        return self.levels[k] + slope * (t - self.knots[k]), slope

    def rates(self, state, u, slope):
        p, dp, z, w_1, w_2 = state
        ddp = OMEGA**2 * (GAIN * (u + ZERO_TIME * slope - DEAD_CURRENT) - p)
        ddp -= 2.0 * DAMPING * OMEGA * dp
        dz = A3 * p + A4 * dp + A5 * z + self.bias
        clutch = self.clutch_torque(p, z, w_1 - RATIO * w_2)
        dw_1 = (self.w_m**2 * capacity(w_1 / self.w_m) - clutch) / INERTIA_1
        dw_2 = (RATIO * clutch - self.brake_torque - VISCOUS * w_2) / INERTIA_2
        return dp, ddp, dz, dw_1, max(dw_2, 0.0) if w_2 <= 0.0 else dw_2

    def clutch_torque(self, p, z, slip):
        z = max(z, 0.0)  # the piston's free motion goes on below the stop
        gap = Z_MAX - self.contact
        sigma = min((z - self.contact) / gap, 1.0)
        if sigma <= 0.0:
            return GAMMA / (Z_MAX - z) * slip
        push = sigma**3 * (3.0 - 2.0 * sigma) * ALPHA * max(p, 0.0)
        return push + GAMMA * (1.0 - sigma) * (1.0 + 2.0 * sigma) / gap * slip

    def idle_speed(self, drag):
        low, high = 0.0, 1.0
        for _ in range(53):
            nu = 0.5 * (low + high)
            faster = self.w_m * capacity(nu) > drag * nu
            low, high = (nu, high) if faster else (low, nu)
        return self.w_m * low


def combined(state, length, weights, rates):
    """The state plus `length` times the weighted sum of the rates."""
    columns = zip(*rates, strict=True)
    return [
        y + length * sum(map(mul, weights, column))
        for y, column in zip(state, columns, strict=True)
    ]


if __name__ == "__main__":
    given = {name: float(value) for name, value in (word.split("=") for word in sys.argv[1:])}
    time = Engagement(**given).shifting_time()
    if time is None:
        sys.exit(f"the shafts do not synchronize within {END:g} s")
    print(time)
