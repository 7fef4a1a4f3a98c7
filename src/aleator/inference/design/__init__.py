"""The design of further experiments: which of the candidates would tell most."""

from aleator.inference.design.choice import Choice, chosen, repetitions
from aleator.inference.design.laws import possible_laws
from aleator.inference.design.plan import Plan
from aleator.inference.design.quantities import probability_gradients, quantile_gradients
from aleator.inference.design.scores import Scores, expected_scores

__all__ = [
    "Choice",
    "Plan",
    "Scores",
    "chosen",
    "expected_scores",
    "possible_laws",
    "probability_gradients",
    "quantile_gradients",
    "repetitions",
]
