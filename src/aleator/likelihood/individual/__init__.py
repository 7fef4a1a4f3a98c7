"""The likelihood as an integral over each experiment's own parameters, at nodes adapted to it."""

from aleator.likelihood.individual.likelihood import IndividualLikelihood
from aleator.likelihood.individual.rule import GaussHermite

__all__ = ["GaussHermite", "IndividualLikelihood"]
