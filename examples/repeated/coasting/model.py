import numpy as np


def coasting(start, time, drag):
    """Speed and way of a trolley at all times of its test: `time` is an array, `start` a number."""
    left = np.exp(-drag * time)
    return {"speed": start * left, "way": start / drag * (1.0 - left)}
