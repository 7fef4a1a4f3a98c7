import numpy as np


def wear(distance, rate, run_in):
    """mm after a distance in Mm: running in over some 3 Mm, then a constant rate."""
    return run_in * (1.0 - np.exp(-distance / 3.0)) + rate * distance
