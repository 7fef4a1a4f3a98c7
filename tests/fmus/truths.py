"""What the FMUs of the tests return, in closed form."""

import numpy as np


def cooled(k: float, times: np.ndarray, hot: float = 400.0) -> np.ndarray:
    """Temperatures of the body that cools, at times."""
    return 300.0 + (hot - 300.0) * np.exp(-k * times)


def flown(times: np.ndarray, h: float, v: float, g: float, e: float) -> np.ndarray:
    """Heights and speeds (m, 2) of a ball, flight by flight, long before it lies still."""
    found = []
    for left in times.tolist():
        above, speed = h, v
        while (landing := (speed + np.sqrt(speed**2 + 2.0 * g * above)) / g) < left:
            left, above, speed = left - landing, 0.0, -e * (speed - g * landing)
        found.append((above + speed * left - g * left**2 / 2.0, speed - g * left))
    return np.array(found)


def column_of(*parts: np.ndarray) -> np.ndarray:
    """A column whose cells are arrays."""
    column = np.empty(len(parts), dtype=object)
    column[:] = parts
    return column
