"""Identification by the integral over each experiment's own parameters."""

from aleator.tasks.individual.answer import answered
from aleator.tasks.individual.identify import Asked, asked, identified, wanted

__all__ = [
    "Asked",
    "answered",
    "asked",
    "identified",
    "wanted",
]
