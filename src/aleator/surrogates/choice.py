"""The user's choice of response surfaces: how exact they are, and how many runs they may take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from aleator.errors import InputsError
from aleator.laws.quadrature import Cubature
from aleator.surrogates.fit import PLACES

Surfaces = Literal["none", "own", "process"]


@dataclass(frozen=True)
class ResponseSurface:
    """The choice of response surfaces: how exact they are, and how many runs they may take.

    tolerance: the estimated root-mean-square error that is allowed, divided by the standard
    deviation of the outcome, both over the region of the parameters; in (0, 1). None: the surfaces
    are made exact where the law has its mass, and only as exact as the result needs.
    max_runs: the largest number of runs for one experiment, from 4 to 4096.
    accuracy: relative accuracy of the simulator, in [0, 1); an error below accuracy times the size
    of the outcome counts as converged.
    nodes: the number of Gauss nodes per parameter, or a cubature, by which moments are computed
    from the surfaces; None lets the program choose.
    surfaces: "process": Gaussian processes over conditions and parameters learn from the runs of
    all experiments. "own": each experiment has a polynomial of its own. "none": the simulator
    itself is run at every node. None: a simulator that takes arrays gets no surfaces, any other
    gets "process", or "own" with a tolerance. A tolerance is only for surfaces of their own.
    together: the least number of runs of a round of the processes, at least 1. None: two for each
    worker. Where this exceeds what a round takes anyway, the answer depends on it.

    Raises InputsError for a value outside these ranges.

    >>> ResponseSurface(tolerance=0.01).max_runs
    1000
    """

    tolerance: float | None = None
    max_runs: int = 1000
    accuracy: float = 1e-6
    nodes: int | Cubature | None = None
    surfaces: Surfaces | None = None
    together: int | None = None

    @property
    def name(self) -> str:
        """The name of this choice in a result."""
        return "response_surface"

    def __post_init__(self) -> None:
        kinds, most = get_args(Surfaces), PLACES.candidates
        admitted = self.tolerance is None or 0.0 < self.tolerance < 1.0
        _require("tolerance", self.tolerance, admitted, "choose one in (0, 1), e.g. 0.02")
        _require("max_runs", self.max_runs, 4 <= self.max_runs <= most, f"choose 4 to {most}")
        exact = 0.0 <= self.accuracy < 1.0
        _require("accuracy", self.accuracy, exact, "choose one in [0, 1), e.g. 1e-6")
        known = self.surfaces in (None, *kinds)
        _require("surfaces", self.surfaces, known, f"choose one of {', '.join(kinds)}")
        alone = self.surfaces in (None, "own") or self.tolerance is None
        remedy = "leave out the tolerance, which is one of own surfaces"
        _require("surfaces", self.surfaces, alone, remedy)
        some = self.together is None or self.together >= 1
        _require("together", self.together, some, "choose at least 1")
        enough = not isinstance(self.nodes, int) or self.nodes >= 1
        _require("nodes", self.nodes, enough, "choose at least 1")


def by_process(choice: ResponseSurface, moments: bool) -> bool:
    """Whether Gaussian processes are in place of a simulator that has surfaces.

    They are exact where outcomes were measured. A density of `moments` rests on outcomes under the
    whole law, and gets polynomials that are exact there unless the user chooses otherwise.
    """
    if choice.surfaces is None:
        return choice.tolerance is None and not moments
    return choice.surfaces == "process"


def _require(name: str, value: object, admitted: bool, remedy: str) -> None:
    if not admitted:
        raise InputsError(f"response surface: {name} {value}", remedy)
