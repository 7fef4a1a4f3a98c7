"""Identification by the integral over each experiment's own parameters."""

from aleator.tasks.individual.answer import answered
from aleator.tasks.individual.given import predicted
from aleator.tasks.individual.identify import Asked, asked, identified, wanted
from aleator.tasks.individual.virtual import virtual_observations

__all__ = [
    "Asked",
    "answered",
    "asked",
    "identified",
    "predicted",
    "virtual_observations",
    "wanted",
]
