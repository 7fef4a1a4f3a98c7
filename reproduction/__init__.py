"""The paper, reproduced: every figure and table with its data, and its claims beside ours.

A guest like the wet clutch: only the command line knows it. A figure is an entry of
`registry.FIGURES`: a name and a function from the shared context to tables, a drawing, and claims.
"""

from reproduction.context import Context
from reproduction.figure import Claim, Figure, Reproduction, Verdict
from reproduction.figures import FIGURES, chosen
from reproduction.output import INDEX, Made, counts, reproduce

__all__ = [
    "reproduce",
    "chosen",
    "counts",
    "FIGURES",
    "Context",
    "Figure",
    "Reproduction",
    "Claim",
    "Verdict",
    "Made",
    "INDEX",
]
