"""Identification from experiments with several observations each."""

from aleator.tasks.individual.identify import identified, wanted

__all__ = ["identified", "wanted"]
