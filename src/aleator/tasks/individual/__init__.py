"""Identification from experiments with several observations each."""

from aleator.tasks.individual.answer import answered
from aleator.tasks.individual.identify import Asked, asked, identified, wanted
from aleator.tasks.individual.virtual import virtual_observations

__all__ = ["Asked", "answered", "asked", "identified", "virtual_observations", "wanted"]
