"""How far a car goes until it stands."""

GRAVITY = 9.81  # m/s^2


def distance(speed, friction, delay):
    """m, from a speed in km/h: the brakes bite after a delay (s), then the tires slide."""
    v = speed / 3.6
    return v * delay + v**2 / (2.0 * friction * GRAVITY)
