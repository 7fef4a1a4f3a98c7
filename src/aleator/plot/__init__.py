"""Figures of results: whole ones as files, and charts on axes of your own. They compute nothing.

>>> from aleator import plot
>>> plot.__all__
['calibration', 'histogram', 'experiments', 'law', 'profile', 'surface', 'response']
"""

from aleator.plot.on_axes import calibration as calibration
from aleator.plot.on_axes import experiments as experiments
from aleator.plot.on_axes import histogram as histogram
from aleator.plot.on_axes import law as law
from aleator.plot.on_axes import profile as profile
from aleator.plot.on_axes import response as response
from aleator.plot.on_axes import surface as surface

__all__ = ["calibration", "histogram", "experiments", "law", "profile", "surface", "response"]
