"""A density whose logarithm is a spline, from the outcomes at the nodes."""

from aleator.densities.logspline.choice import LogSpline
from aleator.densities.logspline.fitted import FittedLogSpline

__all__ = ["FittedLogSpline", "LogSpline"]
